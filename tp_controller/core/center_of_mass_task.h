// Copyright 2026 tp_controller contributors
//
// Licensed under the Apache License, Version 2.0 (the "License");
// you may not use this file except in compliance with the License.
// You may obtain a copy of the License at
//
//     http://www.apache.org/licenses/LICENSE-2.0
//
// Unless required by applicable law or agreed to in writing, software
// distributed under the License is distributed on an "AS IS" BASIS,
// WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
// See the License for the specific language governing permissions and
// limitations under the License.

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
