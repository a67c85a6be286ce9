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

// Speed limit of a frame.
// Reference: tp_controller/tasks/speed_limit.py

#pragma once

#include "frame_task.h"

namespace {

class SpeedLimitTask : public Task {
 public:
  // `along` (m, 6): parts of the twist, `most` (m,): their largest speeds.
  SpeedLimitTask(Law law, int frame, int reference, std::vector<double> along,
                 std::vector<double> most)
      : Task(std::move(law)), frame_(frame), reference_(reference), along_(std::move(along)),
        most_(std::move(most)) {}

  bool bounded() const override { return true; }

  bool fits(const Motion &motion) const override {
    return std::max(frame_, reference_) < int(motion.frames.size());
  }

  bool evaluate(const Situation &at, const Rows &out) override {
    const int n = at.motion->n;
    double *J = at.motion->jacobians();
    placed(*at.motion, frame_, reference_, J);
    for (int i = 0; i < rows(); ++i) {
      for (int c = 0; c < n; ++c) {
        double sum = 0.0;
        for (int k = 0; k < 6; ++k) sum += along_[6 * i + k] * J[k * n + c];
        out.J[i * n + c] = sum;
      }
      out.error[i] = 0.0;
      out.lower[i] = -most_[i];
      out.upper[i] = most_[i];
    }
    return true;
  }

 private:
  int frame_, reference_;                // −1: the root
  std::vector<double> along_, most_;
};

}  // namespace
