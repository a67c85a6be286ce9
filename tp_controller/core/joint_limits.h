// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Limits of the joints: each an interval of velocities in a cycle.
// Reference: tp_controller/control/joint_limits.py

#pragma once

#include "motion_object.h"
#include "python_buffers.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace {

// Constants of the reference.
constexpr double RETURN_SHARE = 0.2, RETURN_SPEED = 1.0, LARGEST_DISTANCE = 1e6;
constexpr double UNLIMITED_ACCELERATION = 1e12;

using Numbers = std::vector<double>;

// Numbers of a limit of n joints in a dictionary; none where it is not in force.
bool read_limit(PyObject *limits, const char *key, bool required, size_t n, Numbers &found) {
  PyObject *values = PyDict_GetItemString(limits, key);
  if (!values) return !required;
  return read_all(values, found) && found.size() == n;
}

// The motion of the joints, as their limits see it.
struct JointMotion {
  const double *positions, *velocity;
  double elapsed, duration;
  // Number of pending commands, and their sums in each direction, where there are any.
  int count;
  const double *upwards, *downwards;
  // Of the last command; and the velocities that the tasks demand, where they are known.
  const double *acceleration;
  double before;
  const double *demand;
  // The same of the cycle before, where it is known; else null, or not numbers.
  const double *demanded;
  // By how much joints may move against their demand, as a share of their velocity limits.
  double compensation;
};

// Add a pending command to the sums in each direction.
inline void add_pending(const double *command, int n, double *upwards, double *downwards) {
  for (int j = 0; j < n; ++j) {
    upwards[j] += std::max(command[j], 0.0);
    downwards[j] += std::max(-command[j], 0.0);
  }
}

struct Interval {
  double least, most;
};

struct VelocityLimit {
  Numbers values;

  Interval at(size_t j) const { return {-values[j], values[j]}; }
};

// The largest K for which x[k+1] = x[k] − K x[k−delay] does not oscillate.
inline double calm_gain(double delay) {
  return std::pow(delay, delay) / std::pow(delay + 1.0, delay + 1.0);
}

// Both ends of the range of the joints.
struct PositionLimits {
  double period = 0.0, gain = 0.0;
  Numbers lower, upper, velocity, acceleration;  // of accelerations, none where empty

  // The gain at which pending commands do not make a joint stop and go.
  double gain_of(const JointMotion &motion) const {
    return motion.count ? std::min(gain, calm_gain(double(motion.count)) / motion.duration) : gain;
  }

  Interval at(const JointMotion &motion, double g, size_t j) const {
    const Interval distances = remaining(motion, j);
    return {-speed(distances.least, g, j), speed(distances.most, g, j)};
  }

  // The distances to the lower and to the upper end.
  Interval remaining(const JointMotion &motion, size_t j) const {
    const double q = motion.positions[j];
    double upwards = 0.0, downwards = 0.0;
    if (motion.count) {
      upwards = motion.duration * motion.upwards[j];
      downwards = motion.duration * motion.downwards[j];
    }
    return {felt(q - lower[j], downwards, upwards), felt(upper[j] - q, upwards, downwards)};
  }

  double strongest(size_t j) const {
    return acceleration.empty() ? UNLIMITED_ACCELERATION
        : std::min(acceleration[j], UNLIMITED_ACCELERATION);
  }

 private:
  // The distance nearest to zero that pending commands can leave.
  static double felt(double distance, double nearer, double farther) {
    distance = std::min(distance, LARGEST_DISTANCE);
    return std::max(distance - nearer, std::min(distance + farther, 0.0));
  }

  double speed(double distance, double g, size_t j) const {
    return std::max(braking_speed(distance, g, j),
                    -std::min(RETURN_SHARE * velocity[j], RETURN_SPEED));
  }

  double braking_speed(double distance, double g, size_t j) const {
    if (acceleration.empty()) return g * distance;
    const double a = strongest(j);
    const double change = a * period, slow = a / (g * g);
    const double beyond = std::max(distance - slow, 0.0) / (change * period);
    const double pieces = 1.0 + 2.0 / (g * period);
    const double steps = std::ceil(0.5 * (std::sqrt(pieces * pieces + 8.0 * beyond) - pieces));
    return (distance + steps * change * (0.5 * (steps - 1.0) * period + 1.0 / g))
        / (steps * period + 1.0 / g);
  }
};

struct AccelerationLimit {
  double period = 0.0;
  Numbers values;  // empty where it is not in force

  bool in_force() const { return !values.empty(); }

  Interval at(const JointMotion &motion, size_t j) const {
    const double change = std::min(values[j], UNLIMITED_ACCELERATION)
        * std::min(motion.elapsed, period);
    const double velocity = motion.velocity[j];
    return {velocity - change, velocity + change};
  }
};

}  // namespace
