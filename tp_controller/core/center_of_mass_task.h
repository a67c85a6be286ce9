// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The centre of mass of the whole robot.
// Reference: tp_controller/tasks/center_of_mass.py

#pragma once

#include "task.h"

namespace {

class CenterOfMassTask : public Task {
 public:
  // `scale`: that of the rows of J and v.
  CenterOfMassTask(Law law, const char *axes, const double *goal, double scale)
      : Task(std::move(law)), scale_(scale) {
    std::copy(axes, axes + rows(), axes_);
    std::copy(goal, goal + 3, goal_);
  }

  bool fits(const Motion &) const override { return true; }

  bool set_goal(const double *numbers, size_t count) override {
    if (count != 3) return false;
    std::copy(numbers, numbers + 3, goal_);
    return true;
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    const size_t n = size_t(at.motion->n);
    double *J = at.motion->jacobians(), center[3];
    at.motion->center_of_mass(center, J);
    for (int i = 0; i < rows(); ++i) {
      const int axis = axes_[i];
      out.error[i] = goal_[axis] - center[axis];
      for (size_t c = 0; c < n; ++c) out.J[i * n + c] = scale_ * J[axis * n + c];
    }
    const bool lasts = law_.demand(at.now, out.error, out.v);
    for (int i = 0; i < rows(); ++i) out.v[i] *= scale_;
    return lasts;
  }

 private:
  char axes_[3];
  double goal_[3], scale_;
};

}  // namespace
