// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Tasks that remember the direction of a turn.
// Reference: tp_controller/tasks/orientation.py

#pragma once

#include "task.h"

namespace {

class TurningTask : public Task {
 public:
  // `kept`: the last rotation vector (3,), and whether there is one; none where nothing turns.
  TurningTask(Law law, Kept kept) : Task(std::move(law), kept) {}

 protected:
  // Keep to the direction of the turn before.
  void follow(double *vector) {
    if (memory_[3] != 0.0) shorter_rotation(memory_.data(), vector);
    std::copy(vector, vector + 3, memory_.begin());
    memory_[3] = 1.0;
  }
};

}  // namespace
