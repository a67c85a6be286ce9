// Copyright 2026 tp_controller contributors
//
// Licensed under the Apache License, Version 2.0 (the "License");
// you may not use this file except in compliance with the License.
// You may obtain a copy of the License at
//
//     http://www.apache.org/licenses/LICENSE-2.0
//
// Unless required by applicable law or agreed to in writing, software
// distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
// See the License for the specific language governing permissions and
// limitations under the License.

// Bounds on joint velocities from position, velocity and acceleration limits.
// Reference: tp_controller/control/velocity_limits.py

#pragma once

#include "python_buffers.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace {

// Constants of the reference.
constexpr double RETURN_SHARE = 0.2, RETURN_SPEED = 1.0, LARGEST_DISTANCE = 1e6;

class Limits {
 public:
  double period = 0.0, gain = 0.0;
  bool endless = false;                  // there are joints without position limits
  std::vector<double> lower, upper, velocity, acceleration;  // of accelerations, none where empty

  static constexpr int ROWS = 8;

  // Fill in what `bounded` returns (8, n).
  void at(const Buffer &q, const Buffer &previous, double elapsed, const Buffer &pending,
          double duration, double *rows) const {
    const size_t n = lower.size();
    const double delay = double(pending.rows(2));
    const double g = delay > 0.0 ? std::min(gain, calm_gain(delay) / duration) : gain;
    for (size_t j = 0; j < n; ++j) {
      double *row = rows + j;
      const double back = std::min(RETURN_SHARE * velocity[j], RETURN_SPEED);
      double upwards = 0.0, downwards = 0.0;
      for (Py_ssize_t i = 0; i < pending.rows(2); ++i) {
        upwards += std::max(pending.at(i, j), 0.0);
        downwards += std::max(-pending.at(i, j), 0.0);
      }
      upwards *= duration;
      downwards *= duration;
      const double above = felt(upper[j] - q.at(j), upwards, downwards);
      const double below = felt(q.at(j) - lower[j], downwards, upwards);
      const double up = std::max(braking_speed(above, g, j), -back);
      const double down = std::max(braking_speed(below, g, j), -back);
      double most = std::min(up, velocity[j]), least = -std::min(down, velocity[j]);
      if (most < least) {
        // Coming back from outside must not be faster than it can stop at the other end.
        most = std::max(most, std::min(least, 0.0));
        least = std::min(least, most);
      }
      row[2 * n] = least;
      row[3 * n] = most;
      row[4 * n] = up;
      row[5 * n] = down;
      row[6 * n] = up;
      row[7 * n] = down;
      if (!acceleration.empty()) {
        const double change = acceleration[j] * std::min(elapsed, period);
        const double slowest = previous.at(j) - change, fastest = previous.at(j) + change;
        most = std::min(std::max(most, slowest), fastest);
        least = std::min(std::max(least, slowest), fastest);
        row[6 * n] = slowest;
        row[7 * n] = fastest;
      }
      row[0] = least;
      row[n] = most;
    }
  }

 private:
  // The distance nearest to zero that commands under way can leave.
  double felt(double distance, double towards, double away) const {
    if (endless) distance = std::min(distance, LARGEST_DISTANCE);
    return std::max(distance - towards, std::min(distance + away, 0.0));
  }

  // The largest K for which x[k+1] = x[k] − K x[k−delay] does not oscillate.
  static double calm_gain(double delay) {
    return std::pow(delay, delay) / std::pow(delay + 1.0, delay + 1.0);
  }

  double braking_speed(double distance, double g, size_t j) const {
    if (acceleration.empty()) return g * distance;
    const double change = acceleration[j] * period, slow = acceleration[j] / (g * g);
    const double beyond = std::max(distance - slow, 0.0) / (change * period);
    const double pieces = 1.0 + 2.0 / (g * period);
    const double steps = std::ceil(0.5 * (std::sqrt(pieces * pieces + 8.0 * beyond) - pieces));
    return (distance + steps * change * (0.5 * (steps - 1.0) * period + 1.0 / g))
        / (steps * period + 1.0 / g);
  }
};

}  // namespace
