// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Tasks that point an axis of a frame.
// Reference: tp_controller/tasks/pointing.py

#pragma once

#include "aim.h"
#include "orientation.h"

namespace {

// Constants of the reference.
constexpr double MIN_VERTICAL_SINE = 0.3;
constexpr double MIN_SQUARED_SINE = 1e-12;

// An axis of a frame, the axes of its rows, and those of the row that keeps it upright.
struct PointingAxis {
  int frame;
  double its[3], across[6], upright[6];
  bool is_upright;
};

class AxisTask : public Task {
 public:
  AxisTask(Law law, const PointingAxis &axis, const Aim &aim, Kept turn)
      : Task(std::move(law), turn), axis_(axis), aim_(aim) {}

  bool fits(const Motion &motion) const override {
    return std::max(axis_.frame, aim_.reference) < int(motion.frames.size());
  }

  bool set_goal(const double *numbers, size_t count) override {
    if (count != 3) return false;
    std::copy(numbers, numbers + 3, aim_.goal);
    return true;
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    Motion &motion = *at.motion;
    const size_t n = size_t(motion.n);
    double *J = motion.jacobians(), axis[3], turn[3], about[9], added[3] = {};
    const Placement its = motion.placement(axis_.frame);
    motion.jacobian(axis_.frame, its.p, J);
    const Sight sight(aim_, motion, its.p, J);
    apply(its.R, axis_.its, axis);
    turn_between(axis, sight.direction, turn);
    follow(memory_, turn);
    for (int i = 0; i < 2; ++i) {
      apply(its.R, axis_.across + 3 * i, about + 3 * i);
      out.error[i] = dot(about + 3 * i, turn);
    }
    if (axis_.is_upright) out.error[2] = upright(its.R, about + 6);
    for (size_t c = 0; c < n; ++c) {
      double w[3], relative[3];
      for (int i = 0; i < 3; ++i) w[i] = J[(3 + i) * n + c];
      sight.turning(int(c), relative);
      subtract(w, relative, relative);
      for (int i = 0; i < rows(); ++i)
        out.J[i * n + c] = dot(about + 3 * i, i < 2 ? relative : w);
    }
    if (!law_.feed_forward.empty()) {
      double w[3];
      sight.turning(law_.feed_forward.data(), w);
      for (int i = 0; i < 2; ++i) added[i] = dot(about + 3 * i, w);
    }
    return law_.demand(at.now, out.error, added, out.v);
  }

 private:
  // The turn about the axis that is left (`LookAt.observe`), and what maps an angular velocity to it.
  double upright(const double *R, double *row) const {
    double up[3], side[3], lean[3];
    apply(R, axis_.upright, up);
    apply(R, axis_.upright + 3, side);
    const double cosine = up[2], sine = side[2], reach = cosine * cosine + sine * sine;
    const double weight = std::min(1.0, reach / (MIN_VERTICAL_SINE * MIN_VERTICAL_SINE));
    const double share = weight / std::max(reach, MIN_SQUARED_SINE);
    for (int i = 0; i < 3; ++i) lean[i] = sine * up[i] - cosine * side[i];
    row[0] = share * lean[1];
    row[1] = -share * lean[0];
    row[2] = 0.0;
    return weight * std::atan2(sine, cosine);
  }

  PointingAxis axis_;
  Aim aim_;
};

}  // namespace
