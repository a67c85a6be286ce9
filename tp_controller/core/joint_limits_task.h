// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Margin to the joint position limits.
// Reference: tp_controller/tasks/joint_limits.py

#pragma once

#include "bounded_task.h"
#include "joint_task.h"

namespace {

class JointLimitsTask : public Task {
 public:
  JointLimitsTask(Law law, JointColumns columns, std::vector<double> lower,
                  std::vector<double> upper, double return_speed)
      : Task(std::move(law)), columns_(std::move(columns)), lower_(std::move(lower)),
        upper_(std::move(upper)), return_speed_(return_speed) {}

  bool bounded() const override { return true; }

  bool fits(const Motion &motion) const override { return columns_.fit(motion); }

  bool evaluate(const Situation &at, const Rows &out) override {
    for (int i = 0; i < rows(); ++i) {
      const bounded::RowBounds its = bounded::row_bounds(
          at.positions[columns_.at[i]], lower_[i], upper_[i], law_.gain[i], return_speed_, 0.0,
          bounded::Row());
      out.error[i] = its.error;
      out.lower[i] = its.least;
      out.upper[i] = its.most;
    }
    columns_.select(at.motion->n, out.J);
    return true;
  }

 private:
  JointColumns columns_;
  std::vector<double> lower_, upper_;
  double return_speed_;
};

}  // namespace
