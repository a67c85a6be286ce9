// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Distance from the joint limits.
// Reference: tp_controller/tasks/joint_limit_distance.py

#pragma once

#include "gradient_task.h"

namespace {

// Constants of the reference.
constexpr double MAX_CURVED = 0.8;
constexpr double MAX_RATE = 10.0;

class JointLimitDistanceTask : public GradientTask {
 public:
  // `middle`, `half` (n,): of the ranges, 0 and infinite for a joint without limits.
  JointLimitDistanceTask(Law law, double max_speed, std::vector<double> middle,
                         std::vector<double> half)
      : GradientTask(std::move(law), max_speed), middle_(std::move(middle)), half_(std::move(half)) {}

  bool fits(const Motion &motion) const override { return rows() == motion.n; }

 protected:
  double desired(int i, const Situation &at) const override {
    const double x = (at.positions[i] - middle_[i]) / half_[i];
    const double curved = std::min(std::max(x, -MAX_CURVED), MAX_CURVED);
    const double gap = 1.0 - curved * curved, reach = gap * half_[i];
    const double slope = -2.0 * curved / (gap * gap);
    return law_.gain[i] * (slope / half_[i])
        / (1.0 + 2.0 * law_.gain[i] / (MAX_RATE * (reach * reach)));
  }

 private:
  std::vector<double> middle_, half_;
};

}  // namespace
