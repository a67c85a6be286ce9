// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Stop of a joint with a bounded jerk, in closed form.
// Reference: tp_controller/control/stopping.py

#pragma once

#include <algorithm>
#include <cmath>

namespace {

struct StopLaw {
  double jerk, acceleration, period, tail;

  double ease_off(double velocity) const {
    const double slow = jerk * tail * tail, v = std::max(velocity, 0.0);
    return std::min(v <= slow ? v / tail : std::sqrt(jerk * (2.0 * v - slow)), acceleration);
  }

  double distance(double velocity, double acceleration_now) const {
    const double a = std::max(acceleration_now, -ease_off(velocity));
    // Velocity at which the acceleration is zero, if it had been increased with this jerk.
    const double top = std::max(velocity + 0.5 * a * a / jerk, 0.0);
    const double slow = jerk * tail * tail;
    const double reached = top >= 1.5 * slow ? std::sqrt(jerk * (top - 0.5 * slow))
        : 2.0 * top / (std::sqrt(tail * tail + 2.0 * top / jerk) + tail);
    const double b = std::min(reached, acceleration);
    // Until the deceleration is b, at b, and from there to rest.
    double t = std::max(a + b, 0.0) / jerk;
    double moved = t * (velocity + t * (0.5 * a - jerk * t / 6.0));
    const double full_from = top - 0.5 * b * b / jerk;
    t = std::max(b / jerk - tail, 0.0);
    const double last = t > 0.0 ? 0.5 * (b * b / jerk + slow) : b * tail;
    if (reached > b) moved += 0.5 * (full_from * full_from - last * last) / acceleration;
    const double eased = last - t * (b - 0.5 * jerk * t);
    moved += t * (last - t * (0.5 * b - jerk * t / 6.0)) + eased * tail;
    return moved + period * (a > 0.0 ? top : velocity);
  }
};

}  // namespace
