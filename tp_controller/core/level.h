// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// A level: the demand or the bounds of its rows.
// Reference: tp_controller/solver/level.py

#pragma once

#include "arena.h"

namespace {

// Constants of the reference.
constexpr double NEGLIGIBLE = 1e-9, ROUNDING = 1e-12, FEASIBLE = 1e-11;

struct Level {
  int m, n;
  bool bounded, scale, is_identity;
  const double *J, *v, *lower, *upper;   // J row by row; none where it is the identity
  const double *joints = nullptr;        // 0 for those that its step may not move; none: it may all
  const double *weights = nullptr;       // of its rows; none: all weigh the same

  const double *row(int i) const { return J + size_t(i) * n; }

  // y ← J x
  void times(const double *x, double *y) const {
    if (is_identity) std::copy(x, x + n, y);
    else for (int i = 0; i < m; ++i) y[i] = dot(row(i), x, n);
  }

  // y ← y + f Jᵀ w
  void add_transposed(double f, const double *w, double *y) const {
    if (is_identity) add(f, w, y, n);
    else for (int i = 0; i < m; ++i) add(f * w[i], row(i), y, n);
  }

  // The roots of the weights, the smallest of them 1.
  const double *root(Arena &arena) const {
    double *found = arena.take(m), least = INF;
    for (int i = 0; i < m; ++i) least = std::min(least, weights ? weights[i] : 1.0);
    for (int i = 0; i < m; ++i) found[i] = weights ? std::sqrt(weights[i] / least) : 1.0;
    return found;
  }

  double size() const { return is_identity ? std::sqrt(double(n)) : norm(J, m * n); }

  bool meets(const double *x) const {
    for (int i = 0; i < m; ++i) {
      const double value = is_identity ? x[i] : dot(row(i), x, n);
      if (!within(value, lower[i], upper[i], FEASIBLE)) return false;
    }
    return true;
  }
};

}  // namespace
