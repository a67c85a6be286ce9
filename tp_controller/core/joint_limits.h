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
    const double q = motion.positions[j];
    double upwards = 0.0, downwards = 0.0;
    if (motion.count) {
      upwards = motion.duration * motion.upwards[j];
      downwards = motion.duration * motion.downwards[j];
    }
    return {-speed(felt(q - lower[j], downwards, upwards), g, j),
            speed(felt(upper[j] - q, upwards, downwards), g, j)};
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
    const double a = std::min(acceleration[j], UNLIMITED_ACCELERATION);
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

// All limits in force, as `LIMITS`.
struct JointLimits {
  VelocityLimit velocity;
  PositionLimits position;
  AccelerationLimit acceleration;

  size_t size() const { return velocity.values.size(); }

  // Read {key: numbers}; false where they are not those of as many joints.
  bool read(PyObject *limits, double period, double gain) {
    PyObject *first = PyDict_GetItemString(limits, "velocity");
    if (!first || !read_all(first, velocity.values)) return false;
    position.period = acceleration.period = period;
    position.gain = gain;
    position.velocity = velocity.values;
    const bool fit = read_limit(limits, "lower", true, size(), position.lower)
        && read_limit(limits, "upper", true, size(), position.upper)
        && read_limit(limits, "acceleration", false, size(), acceleration.values);
    position.acceleration = acceleration.values;
    return fit;
  }

  // Call with the interval of each transient limit, in the order of precedence.
  template <typename Clamp>
  void transient(const JointMotion &motion, size_t j, Clamp clamp) const {
    if (acceleration.in_force()) clamp(acceleration.at(motion, j));
  }
};

}  // namespace
