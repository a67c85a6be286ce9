// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Damping near singularities, and its memory from cycle to cycle.
// Reference: tp_controller/solver/damping.py

#pragma once

#include "level.h"

namespace {

// Constants of the reference.
constexpr double CURVATURE = 4.0, TURNING = 2.0, ROW_TURNING = 0.5, FIRST = 0.2, MEMORY = 0.1;

struct Damping {
  double damping = 0.0, singular_region = INF, release_region = 0.0, regularisation = 0.0;

  Damping first() const {
    const double share = everywhere() ? 1.0 : FIRST;
    return {share * damping, share * singular_region, release_region, FIRST * regularisation};
  }

  bool off() const { return damping == 0.0 || singular_region == 0.0; }
  bool everywhere() const { return damping > 0.0 && singular_region == INF; }

  bool spares(double s, double c) const {
    return s >= std::max(off() ? 0.0 : singular_region, release_region) && s * s >= c;
  }

  void gains(const double *s, int count, double c, double *found) const {
    if (count == 0 || spares(s[count - 1], c)) {
      for (int i = 0; i < count; ++i) found[i] = 1.0 / s[i];
      return;
    }
    const double share = damping / singular_region;
    const double k = off() ? 1.0 : 1.0 - share * share, added = off() ? 0.0 : damping * damping;
    for (int i = 0; i < count; ++i)
      found[i] = s[i] / std::max(std::max(s[i] * s[i], k * s[i] * s[i] + added), c);
  }

  double curvature(double h, double period) const {
    return everywhere() ? 0.0 : CURVATURE * period * h;
  }

  double follow(double h, double now, double period) const {
    if (h == 0.0 && now == 0.0) return 0.0;
    h = now + (h - now) * std::exp(-period / MEMORY);
    const double least = damping != 0.0 ? singular_region : regularisation;
    return curvature(h, period) > (now > 0.0 ? 0.0 : least * least) ? h : 0.0;
  }
};

inline double bend(double size, double push) { return std::max(size, TURNING) * push; }

double bend_of_rows(const double *lengths, const double *multipliers, int rows) {
  double sum = 0.0;
  for (int i = 0; i < rows; ++i) {
    const double each = multipliers[i] * std::max(1.0, ROW_TURNING / lengths[i]);
    sum += each * each;
  }
  return std::sqrt(sum);
}

}  // namespace
