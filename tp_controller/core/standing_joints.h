// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Joints that stand and stay where they are, as their velocity limit is zero.
// Reference: tp_controller/control/standing_joints.py

#pragma once

#include "level.h"

#include <vector>

namespace {

// Norm of a row without joints, as a share of that with them.
inline double share_without(const Level &level, int i, const std::vector<int> &joints) {
  const double *row = level.row(i);
  const double whole = dot(row, row, level.n);
  if (whole == 0.0) return 1.0;
  double left = 0.0;
  for (int j = 0; j < level.n; ++j)
    if (!std::count(joints.begin(), joints.end(), j)) left += row[j] * row[j];
  return std::sqrt(left / whole);
}

// Turn a level into that of a robot whose joints stand still.
inline void leave_out(Arena &arena, const std::vector<int> &joints, Level &level) {
  if (joints.empty()) return;
  const size_t m = size_t(level.m);
  if (level.is_identity) {
    double *v = arena.copy(level.v, m);
    for (int j : joints) v[j] = 0.0;
    level.v = v;
    return;
  }
  double *v = level.bounded ? nullptr : arena.copy(level.v, m);
  double *lower = level.bounded ? arena.copy(level.lower, m) : nullptr;
  double *upper = level.bounded ? arena.copy(level.upper, m) : nullptr;
  for (int i = 0; i < level.m; ++i) {
    const double share = share_without(level, i, joints);
    if (v && share == 0.0) v[i] = 0.0;
    if (lower && lower[i] > 0.0) lower[i] *= share;
    if (upper && upper[i] < 0.0) upper[i] *= share;
  }
  double *J = arena.copy(level.J, m * size_t(level.n));
  for (size_t i = 0; i < m; ++i)
    for (int j : joints) J[i * size_t(level.n) + size_t(j)] = 0.0;
  level.J = J;
  level.v = v;
  level.lower = lower;
  level.upper = upper;
}

}  // namespace
