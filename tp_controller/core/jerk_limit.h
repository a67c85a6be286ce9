// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Jerk limit: bounds on the second difference of the commands, with the look-ahead that they need.
// Reference: tp_controller/control/jerk_limit.py

#pragma once

#include "joint_limits.h"
#include "stopping.h"

#include <limits>

namespace {

// Constants of the reference.
constexpr int BOUNDARY_STEPS = 5;
constexpr double SHORTEST_TAIL = 1e-9;
constexpr double FALL = 0.5, COMPENSATION = 0.5, LAG = 0.03;

struct JerkLimit {
  double period = 0.0;
  Numbers values;  // empty where it is not in force
  PositionLimits position;

  bool in_force() const { return !values.empty(); }

  // Let the joints follow velocities that the tasks demand.
  void follow(JointMotion &motion, const double *demand) const {
    motion.demand = demand;
    motion.compensation = 0.0;
    for (size_t j = 0; j < values.size(); ++j)
      if (speed(j) > 0.0)
        motion.compensation = std::max(motion.compensation,
                                       COMPENSATION * std::fabs(demand[j]) / speed(j));
  }

  // Time by which commands lag behind what the tasks demand.
  double response() const {
    double longest = 0.0;
    for (size_t j = 0; j < values.size(); ++j) {
      if (std::isinf(values[j])) continue;
      const double largest = std::min(position.strongest(j),
                                      std::sqrt(values[j] * position.velocity[j]));
      if (largest < UNLIMITED_ACCELERATION) longest = std::max(longest, largest / values[j]);
    }
    return LAG * longest;
  }

  Interval at(const JointMotion &motion, double gain, size_t j) const {
    const double jerk = values[j];
    if (std::isinf(jerk)) return {-jerk, jerk};
    const double h = std::min(motion.elapsed, period), last = motion.velocity[j];
    const double strongest = position.strongest(j), most_speed = position.velocity[j];
    const Interval reachable = its_reachable(motion, j, h, jerk, strongest);
    const double least = reachable.least, most = reachable.most;
    const StopLaw law = {jerk, strongest, period, std::max(1.0 / gain - period, SHORTEST_TAIL)};
    const Interval distances = position.remaining(motion, j);
    double upper = std::min(stopping(law, distances.most, h, least, most, last),
                            approach(most_speed - last, h, jerk));
    double lower = -std::min(stopping(law, distances.least, h, -most, -least, -last),
                             approach(most_speed + last, h, jerk));
    upper = std::min(std::max(upper, least), most);
    lower = std::min(std::max(lower, least), most);
    // Rounding alone makes them cross.
    const double middle = 0.5 * (upper + lower);
    upper = std::max(upper, middle);
    lower = std::min(lower, middle);
    if (motion.demand) {
      const Interval its = following(motion, j, h, jerk);
      const double high = upper;
      upper = std::min(std::max(its.most, lower), high);
      lower = std::min(std::max(its.least, lower), high);
    }
    return {last + h * lower, last + h * upper};
  }

 private:
  // The least and largest accelerations in a cycle of time h.
  Interval its_reachable(const JointMotion &motion, size_t j, double h, double jerk,
                         double strongest) const {
    const double a = motion.acceleration
        ? std::min(std::max(motion.acceleration[j], -strongest), strongest) : 0.0;
    const double change = 0.5 * jerk * (h + std::min(motion.before, period));
    return {std::max(a - change, -strongest), std::min(a + change, strongest)};
  }

  // The least and largest accelerations that follow what the tasks demand.
  Interval following(const JointMotion &motion, size_t j, double h, double jerk) const {
    const double demand = motion.demand[j], last = motion.velocity[j], free = jerk * h;
    const double rate = fall(motion, j, h);
    const double wanted = rate + approach(demand - last - h * rate, h, jerk);
    // The other way: as much acceleration as one cycle takes back, up to a velocity in a share of
    // the largest demand, so that joints at rest come to rest.
    const double more = 0.5 * free + motion.compensation * speed(j) / h;
    const double up = std::min(std::max((demand - last) / h + more, 0.0), free);
    const double down = std::min(std::max((last - demand) / h + more, 0.0), free);
    return {std::min(wanted, rate - down), std::max(wanted, rate + up)};
  }

  // Zero where it is not limited; a joint that is locked demands nothing.
  double speed(size_t j) const {
    return std::isinf(position.velocity[j]) ? 0.0 : position.velocity[j];
  }

  // The rate at which the demand is expected to fall as the joint moves.
  double fall(const JointMotion &motion, size_t j, double h) const {
    if (!motion.demanded || std::isnan(motion.demanded[j])) return 0.0;
    const double last = motion.velocity[j], change = motion.demand[j] - motion.demanded[j];
    if (!(change * last < 0.0)) return 0.0;
    return -std::copysign(std::min(FALL * std::fabs(change) / motion.elapsed,
                                   std::min(position.strongest(j), std::fabs(last) / h)), last);
  }

  // The acceleration that ends soonest, without overshoot, at another velocity.
  static double approach(double gap, double h, double jerk) {
    const double size = std::fabs(gap), step = jerk * h;
    return std::copysign(
        size <= 0.5 * step * h ? size / h : std::sqrt(2.0 * jerk * size) - 0.5 * step, gap);
  }

  // The largest acceleration towards a limit from which the joint can stop.
  static double stopping(const StopLaw &law, double distance, double h, double least, double most,
                         double last) {
    const double left = std::max(distance, 0.0), half = 0.5 * law.jerk * h;
    const auto excess = [&](double a) { return law.distance(last + h * a, a - half) - left; };
    // A joint that does not go forwards, nor accelerates forwards, has stopped.
    const double stopped = std::min(-last / h, half);
    double low = std::min(std::max(stopped, least), most), high = most;
    double f_high = excess(high);
    if (f_high <= 0.0) return high;
    double f_low = excess(low), side = 0.0;
    if (f_low > 0.0) return low;
    for (int i = 0; i < BOUNDARY_STEPS; ++i) {
      const double middle = (low * f_high - high * f_low) / (f_high - f_low);
      const double f = excess(middle);
      // The same end twice in a row: halve the other one.
      if (f <= 0.0) {
        low = middle;
        f_low = f;
        if (side > 0.0) f_high *= 0.5;
        side = 1.0;
      } else {
        high = middle;
        f_high = f;
        if (side < 0.0) f_low *= 0.5;
        side = -1.0;
      }
    }
    return low;
  }
};

}  // namespace
