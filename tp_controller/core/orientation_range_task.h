// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Range of the orientation of a frame about a desired one.
// Reference: tp_controller/tasks/orientation_range.py

#pragma once

#include "bounded_task.h"
#include "frame_task.h"

namespace {

class OrientationRangeTask : public BoundedTask {
 public:
  // `axes`: those of the goal R that have bounds.
  OrientationRangeTask(Law law, ValueBounds bounds, Kept history, Kept turn, int frame,
                       int reference, const char *axes, const double *R)
      : BoundedTask(std::move(law), std::move(bounds), history), turn_(turn), frame_(frame),
        reference_(reference) {
    std::copy(axes, axes + rows(), axes_);
    std::copy(R, R + 9, R_);
  }

  bool fits(const Motion &motion) const override {
    return BoundedTask::fits(motion)
        && std::max(frame_, reference_) < int(motion.frames.size());
  }

  void begin() override {
    BoundedTask::begin();
    turn_.begin();
  }

  void keep() const override {
    BoundedTask::keep();
    turn_.keep();
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    const bool moves = !law_.feed_forward.empty();
    if (moves && !law_.feeds(at.now)) return false;
    const int n = at.motion->n;
    double *J = at.motion->jacobians(), *J_turn = J + 3 * size_t(n);
    const Placement its = placed(*at.motion, frame_, reference_, J);
    double R[9], turn[3], rates[9], row[3], values[3], motion[3] = {};
    multiply_transposed(R_, its.R, R);
    rotation_vector(R, turn);
    follow(turn_, turn);
    vector_rate_matrix(turn, rates);
    for (int i = 0; i < rows(); ++i) {
      apply(R_, rates + 3 * axes_[i], row);
      values[i] = turn[int(axes_[i])];
      for (int c = 0; c < n; ++c)
        out.J[i * n + c] = row[0] * J_turn[c] + row[1] * J_turn[n + c] + row[2] * J_turn[2 * n + c];
      if (moves) motion[i] = -dot(row, law_.feed_forward.data() + 3);
    }
    bound(at, values, motion, out);
    return true;
  }

 private:
  Memory turn_;
  int frame_, reference_;                // −1: the root
  char axes_[3];
  double R_[9];
};

}  // namespace
