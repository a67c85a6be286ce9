// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Cones that an axis of a frame stays in.
// Reference: tp_controller/tasks/cone.py

#pragma once

#include "aim.h"
#include "bounded_task.h"

namespace {

// Constant of the reference.
constexpr double ROUNDED_SHARE = 0.5;

class ConeTask : public BoundedTask {
 public:
  // `axis`: of the frame.
  ConeTask(Law law, ValueBounds bounds, Kept history, int frame, const double *axis,
           const Aim &aim)
      : BoundedTask(std::move(law), std::move(bounds), history), frame_(frame), aim_(aim),
        core_(ROUNDED_SHARE * bounds_.upper[0]) {
    std::copy(axis, axis + 3, axis_);
  }

  bool fits(const Motion &motion) const override {
    return BoundedTask::fits(motion)
        && std::max(frame_, aim_.reference) < int(motion.frames.size());
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    const bool moves = !law_.feed_forward.empty();
    if (moves && !law_.feeds(at.now)) return false;
    Motion &motion = *at.motion;
    const size_t n = size_t(motion.n);
    double *J = motion.jacobians(), axis[3], normal[3], w[3], rate = 0.0;
    const Placement its = motion.placement(frame_);
    motion.jacobian(frame_, its.p, J);
    const Sight sight(aim_, motion, its.p, J);
    apply(its.R, axis_, axis);
    turn_between(axis, sight.direction, normal);
    const double angle = std::sqrt(dot(normal, normal)), longer = std::max(angle, core_);
    const double value = angle > core_ ? angle : 0.5 * (angle * angle / core_ + core_);
    for (int i = 0; i < 3; ++i) normal[i] /= longer;
    for (size_t c = 0; c < n; ++c) {
      sight.turning(int(c), w);
      for (int i = 0; i < 3; ++i) w[i] -= J[(3 + i) * n + c];
      out.J[c] = dot(normal, w);
    }
    if (moves) {
      sight.turning(law_.feed_forward.data(), w);
      rate = dot(normal, w);
    }
    bound(at, &value, &rate, out);
    return true;
  }

 private:
  int frame_;
  double axis_[3];
  Aim aim_;
  double core_;
};

}  // namespace
