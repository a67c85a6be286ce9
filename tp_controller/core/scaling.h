// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Uniform scaling of a velocity into its bounds.
// Reference: tp_controller/solver/scaling.py

#pragma once

#include "arena.h"

namespace {

inline double slowest(double lower, double upper) { return std::min(std::max(lower, 0.0), upper); }

struct Scaled {
  double slowed = 1.0;
  int limiting = -1;
};

// x ← what `scale_uniformly` returns.
Scaled scale_uniformly(int n, const double *velocity, const double *lower, const double *upper,
                       double *x) {
  double fastest = 0.0;
  for (int j = 0; j < n; ++j)
    fastest = std::max(fastest, std::fabs(velocity[j] - slowest(lower[j], upper[j])));
  Scaled found;
  for (int j = 0; j < n; ++j) {
    const double rest = slowest(lower[j], upper[j]), change = velocity[j] - rest;
    const double allowed = (change > 0.0 ? std::max(upper[j], 0.0) : std::min(lower[j], 0.0)) - rest;
    if (!(std::fabs(change) - std::fabs(allowed) > NEGLIGIBLE * fastest)) continue;
    const double ratio = allowed / change;
    if (found.limiting < 0 || ratio < found.slowed) {
      found.slowed = ratio;
      found.limiting = j;
    }
  }
  for (int j = 0; j < n; ++j) {
    const double rest = slowest(lower[j], upper[j]), change = velocity[j] - rest;
    x[j] = clip(found.limiting < 0 ? velocity[j] : rest + found.slowed * change,
                lower[j], upper[j]);
    if (j == found.limiting) x[j] = change > 0.0 ? upper[j] : lower[j];
  }
  return found;
}

}  // namespace
