// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The polytope of the bounds and rows of all levels so far.
// Reference: tp_controller/solver/polytope.py

#pragma once

#include "active_set.h"
#include "level.h"

namespace {

struct Polytope {
  int n, count = 0;
  double *lower, *upper;
  double *rows, *row_lower, *row_upper, *lengths;

  Polytope(Arena &arena, int n, const double *lower, const double *upper, int most)
      : n(n), lower(arena.copy(lower, n)), upper(arena.copy(upper, n)),
        rows(arena.take(size_t(most) * n)), row_lower(arena.take(most)),
        row_upper(arena.take(most)), lengths(arena.take(most)) {}

  const double *row(int i) const { return rows + size_t(i) * n; }

  void clip(const double *x, double *clipped) const {
    for (int j = 0; j < n; ++j) clipped[j] = ::clip(x[j], lower[j], upper[j]);
  }

  // x without what rounding put beyond its bounds; say whether it is no farther off.
  bool fitting(const double *x, double *clipped) const {
    double excess = 0.0;
    for (int j = 0; j < n; ++j) {
      clipped[j] = ::clip(x[j], lower[j], upper[j]);
      excess += (clipped[j] - x[j]) * (clipped[j] - x[j]);
    }
    if (excess > 0.0 && std::sqrt(excess) > ROUNDING * norm(x, n)) return false;
    for (int i = 0; i < count; ++i)
      if (!within(dot(row(i), clipped, n), row_lower[i], row_upper[i], FEASIBLE)) return false;
    return true;
  }

  void narrow(const double *cap, const double *x) {
    for (int j = 0; j < n; ++j) {
      lower[j] = std::min(std::max(lower[j], -cap[j]), x[j]);
      upper[j] = std::max(std::min(upper[j], cap[j]), x[j]);
    }
  }

  void widen(const double *x) {
    for (int i = 0; i < count; ++i) {
      const double value = dot(row(i), x, n);
      row_lower[i] = std::min(row_lower[i], value);
      row_upper[i] = std::max(row_upper[i], value);
    }
  }

  // What origin + Q a has to keep, with room for more rows, and more columns, of zeros.
  Program along(Arena &arena, const double *origin, const Columns &Q, int more_rows,
                int more_columns) const {
    const int k = Q.k + more_columns, r = n + count + more_rows;
    Program program = {r, k, arena.zeros(size_t(r) * k), arena.take(r), arena.take(r)};
    for (int i = 0; i < n; ++i) {
      for (int j = 0; j < Q.k; ++j) program.A[size_t(i) * k + j] = Q[j][i];
      program.lower[i] = lower[i] - origin[i];
      program.upper[i] = upper[i] - origin[i];
    }
    for (int i = 0; i < count; ++i) {
      for (int j = 0; j < Q.k; ++j) program.A[size_t(n + i) * k + j] = dot(row(i), Q[j], n);
      const double value = dot(row(i), origin, n);
      program.lower[n + i] = row_lower[i] - value;
      program.upper[n + i] = row_upper[i] - value;
    }
    return program;
  }

  // The same, and m rows G (m, k) more; with one variable more for each of them, or none.
  Program with_rows(Arena &arena, const double *origin, const Columns &Q, int m, int more,
                    const double *G, const double *least, const double *most) const {
    Program program = along(arena, origin, Q, m, more);
    for (int i = 0; i < m; ++i) {
      const int at = n + count + i;
      double *row = program.A + size_t(at) * program.k;
      std::copy(G + size_t(i) * Q.k, G + size_t(i + 1) * Q.k, row);
      if (more) row[Q.k + i] = 1.0;
      program.lower[at] = least[i];
      program.upper[at] = most[i];
    }
    return program;
  }
};

}  // namespace
