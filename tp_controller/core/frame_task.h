// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Tasks about the pose of a frame of the robot relative to another frame.
// Reference: tp_controller/tasks/frame.py

#pragma once

#include "orientation.h"

namespace {

// A frame as a reference sees it (`RelativeFrame`), with J (6, n) in place.
Placement seen_from(Motion &motion, const Placement &its, int reference, double *J) {
  const int n = motion.n;
  const Placement from = motion.placement(reference);
  double *moves = motion.jacobians() + 6 * size_t(n), between[3];
  motion.jacobian(reference, from.p, moves);
  subtract(its.p, from.p, between);
  for (int c = 0; c < n; ++c) {
    // d/dt Rᵀ(p − p_ref) = Rᵀ(v − v_ref − ω_ref × (p − p_ref))
    double v[3], w[3], of[3], carried[3];
    for (int i = 0; i < 3; ++i) of[i] = moves[(3 + i) * n + c];
    cross(of, between, carried);
    for (int i = 0; i < 3; ++i) {
      v[i] = J[i * n + c] - moves[i * n + c] - carried[i];
      w[i] = J[(3 + i) * n + c] - of[i];
    }
    for (int i = 0; i < 3; ++i) {
      const double axis[3] = {from.R[i], from.R[3 + i], from.R[6 + i]};
      J[i * n + c] = dot(axis, v);
      J[(3 + i) * n + c] = dot(axis, w);
    }
  }
  Placement found;
  apply_transposed(from.R, between, found.p);
  multiply_transposed(from.R, its.R, found.R);
  return found;
}

// A frame in its reference, −1 the root, with J (6, n).
Placement placed(Motion &motion, int frame, int reference, double *J) {
  const Placement its = motion.placement(frame);
  motion.jacobian(frame, its.p, J);
  return reference < 0 ? its : seen_from(motion, its, reference, J);
}

// The parts of a goal that there are: a position, a rotation, both, or neither.
struct FrameGoal {
  bool is_position = false, is_rotation = false;
  double R[9] = {}, p[3] = {};
};

// Pose, position and orientation; without a goal a velocity alone.
class FrameTask : public Task {
 public:
  FrameTask(Law law, int frame, int reference, const char *rows, const FrameGoal &goal, Kept turn)
      : Task(std::move(law), turn), frame_(frame), reference_(reference), goal_(goal) {
    std::copy(rows, rows + Task::rows(), rows_);
  }

  bool fits(const Motion &motion) const override {
    return std::max(frame_, reference_) < int(motion.frames.size());
  }

  // A position (3,), a rotation (3, 3) or a pose (4, 4), as the goal before.
  bool set_goal(const double *numbers, size_t count) override {
    const bool both = goal_.is_position && goal_.is_rotation;
    if (count != (both ? 16u : goal_.is_position ? 3u : goal_.is_rotation ? 9u : 0u)) return false;
    if (count == 3) std::copy(numbers, numbers + 3, goal_.p);
    if (count == 9) std::copy(numbers, numbers + 9, goal_.R);
    for (int i = 0; both && i < 3; ++i) {
      std::copy(numbers + 4 * i, numbers + 4 * i + 3, goal_.R + 3 * i);
      goal_.p[i] = numbers[4 * i + 3];
    }
    return true;
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    Motion &motion = *at.motion;
    double *J = motion.jacobians(), error[6] = {};
    const Placement its = placed(motion, frame_, reference_, J);
    if (goal_.is_position) subtract(goal_.p, its.p, error);
    if (goal_.is_rotation) turn_left(its, error + 3);
    for (int i = 0; i < rows(); ++i) {
      const int row = rows_[i];
      out.error[i] = error[row];
      std::copy(J + size_t(row) * motion.n, J + size_t(row + 1) * motion.n,
                out.J + size_t(i) * motion.n);
    }
    return law_.demand(at.now, out.error, out.v);
  }

 private:
  // The rotation vector to the goal.
  void turn_left(const Placement &its, double *vector) {
    double turn[9];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) turn[3 * i + j] = dot(goal_.R + 3 * i, its.R + 3 * j);
    rotation_vector(turn, vector);
    follow(memory_, vector);
  }

  int frame_, reference_;                // −1: the root
  char rows_[6];
  FrameGoal goal_;
};

}  // namespace
