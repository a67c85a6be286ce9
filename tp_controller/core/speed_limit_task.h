// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

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
