// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Escape from singularities at which the robot rests exactly: when the reference begins one.
// Reference: tp_controller/control/escape.py

#pragma once

#include "null_space.h"

namespace {

// Constants of the reference.
constexpr double STUCK_SPEED = 1e-3, LEAST_DEMAND = 1e-2, SINGULAR_RATIO = 1e-6,
    STUCK_SECONDS = 0.2;
constexpr int MOST_NUDGES = 3;

// Say whether a level by itself is singular.
bool is_singular(Arena &arena, const Level &level) {
  if (level.is_identity) return false;
  const Arena::Frame frame(arena);
  Columns all = {arena.zeros(size_t(level.n) * level.n), level.n, level.n};
  for (int j = 0; j < level.n; ++j) all[j][j] = 1.0;
  const Directions its = Decomposition(arena, level, all, true, true).found();
  const int most = std::min(level.m, level.n);
  // Twice the ratio: the reference decides.
  return its.rank < most || (most && its.s[most - 1] <= 2.0 * SINGULAR_RATIO * its.s[0]);
}

struct Escape {
  double tries, nudges, still_since;     // not a number while the robot moves

  // Remember since when the robot rests; say whether the reference may have to nudge it.
  bool is_due(Arena &arena, const std::vector<Level> &levels, const double *x, int n, double now) {
    if (tries >= MOST_NUDGES) return false;
    if (norm(x, n) > STUCK_SPEED) {
      still_since = NAN;
      return false;
    }
    if (std::isnan(still_since)) still_since = now;
    if (now - still_since < STUCK_SECONDS) return false;
    return std::any_of(levels.begin(), levels.end(), [&arena](const Level &level) {
      return !level.bounded && norm(level.v, level.m) > LEAST_DEMAND && is_singular(arena, level);
    });
  }
};

}  // namespace
