// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Time between two commands, measured with the clock of the caller.
// Reference: tp_controller/control/cycle_time.py

#pragma once

#include <algorithm>

namespace {

// Constants of the reference.
constexpr double SMOOTHING = 0.05, HOLD_RATIO = 2.0;

struct CycleTime {
  double now, mean, usual, commands;

  // Advance; return the duration for which the last command was in force.
  double advance(double measured, double period) {
    double elapsed = usual;
    if (measured > 0.0) {
      elapsed = measured / commands;
      usual = elapsed < period ? elapsed : period;
      commands = 1.0;
    } else {
      commands += 1.0;
    }
    now += elapsed;
    mean += SMOOTHING * (usual - mean);
    return elapsed;
  }

  double longest_hold(double period) const { return std::min(HOLD_RATIO * mean, period); }
};

}  // namespace
