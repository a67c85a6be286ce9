// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Scalar objectives of the joints.
// Reference: tp_controller/tasks/gradient.py

#pragma once

#include "task.h"

namespace {

class GradientTask : public Task {
 public:
  GradientTask(Law law, double max_speed) : Task(std::move(law)), max_speed_(max_speed) {}

  bool is_identity() const override { return true; }
  bool is_objective() const override { return true; }

  bool evaluate(const Situation &at, const Rows &out) override {
    const int n = rows();
    double square = 0.0;
    for (int i = 0; i < n; ++i) {
      out.error[i] = desired(i, at);
      square += out.error[i] * out.error[i];
    }
    const double speed = std::sqrt(square), share = speed <= max_speed_ ? 1.0 : max_speed_ / speed;
    for (int i = 0; i < n; ++i) out.v[i] = out.error[i] *= share;
    if (out.J)
      for (int i = 0; i < n * n; ++i) out.J[i] = i % (n + 1) == 0;
    return true;
  }

 protected:
  // The gain times the gradient of a joint, reduced where it changes fast.
  virtual double desired(int joint, const Situation &at) const = 0;

 private:
  double max_speed_;
};

}  // namespace
