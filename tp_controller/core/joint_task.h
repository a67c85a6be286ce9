// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Tasks about joint positions and velocities.
// Reference: tp_controller/tasks/joint.py

#pragma once

#include "task.h"

namespace {

// The angle in [−π, π).
inline double wrap_angle(double angle) {
  const double turned = std::fmod(angle + PI, 2.0 * PI);
  return (turned < 0.0 ? turned + 2.0 * PI : turned) - PI;
}

// Columns of the joints, and whether they are all joints in their order.
struct JointColumns {
  std::vector<int> at;
  bool all = false;

  bool fit(const Motion &motion) const {
    return *std::max_element(at.begin(), at.end()) < motion.n && (!all || int(at.size()) == motion.n);
  }

  // Rows of the identity.
  void select(int n, double *J) const {
    std::fill(J, J + at.size() * n, 0.0);
    for (size_t i = 0; i < at.size(); ++i) J[i * n + at[i]] = 1.0;
  }
};

// Joints and postures; without a goal a velocity alone.
class JointTask : public Task {
 public:
  JointTask(Law law, JointColumns columns, std::vector<double> goal, std::vector<bool> wraps)
      : Task(std::move(law)), columns_(std::move(columns)), goal_(std::move(goal)),
        wraps_(std::move(wraps)) {}

  bool is_identity() const override { return columns_.all; }

  bool fits(const Motion &motion) const override { return columns_.fit(motion); }

  bool set_goal(const double *numbers, size_t count) override {
    if (goal_.empty() || count != goal_.size()) return false;
    std::copy(numbers, numbers + count, goal_.begin());
    return true;
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    for (int i = 0; i < rows(); ++i) {
      double error = goal_.empty() ? 0.0 : goal_[i] - at.positions[columns_.at[i]];
      out.error[i] = wraps_[i] ? wrap_angle(error) : error;
    }
    if (out.J) columns_.select(at.motion->n, out.J);
    return law_.demand(at.now, out.error, out.v);
  }

 private:
  JointColumns columns_;
  std::vector<double> goal_;
  std::vector<bool> wraps_;
};

}  // namespace
