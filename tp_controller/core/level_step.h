// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Result of one level, and what the levels so far leave to the next one.
// Reference: tp_controller/solver/solution.py

#pragma once

#include "null_space.h"

namespace {

struct Step {
  const Level *level = nullptr;
  const double *velocity = nullptr, *followed = nullptr;
  Directions directions;
  Columns relaxed;
  bool is_relaxed = false;
  const double *multipliers = nullptr, *row_multipliers = nullptr;
  int rows = 0;
  double bend = 0.0;
  const double *origin = nullptr;
};

// Levels with a demand, and what they could move.
struct Above {
  const Level *level;
  Directions its;
};

// What the first levels with a demand can move, where they were solved before.
struct Shared {
  std::vector<Directions> directions;
  size_t count = 0;
};

// What the levels so far have left.
struct Progress {
  const double *x;
  Columns Z;
  bool relaxed;
  size_t above;
  int rows;
  const double *row_lower, *row_upper, *own;
  bool shortened;
};

// Add the directions of the first levels with a demand, down to one with a mask: it has others.
inline void share(const std::vector<Step> &steps, std::vector<Directions> &directions) {
  for (const Step &step : steps) {
    if (step.level->bounded) continue;
    if (step.level->joints) return;
    directions.push_back(step.directions);
  }
}

}  // namespace
