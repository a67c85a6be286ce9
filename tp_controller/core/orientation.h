// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Tasks that remember the direction of a turn.
// Reference: tp_controller/tasks/orientation.py

#pragma once

#include "task.h"

namespace {

// Keep to the direction of the turn before; `memory`: the last rotation vector (3,), and whether there
// is one.
void follow(Memory &memory, double *vector) {
  if (memory[3] != 0.0) shorter_rotation(memory.data(), vector);
  std::copy(vector, vector + 3, memory.data());
  memory[3] = 1.0;
}

}  // namespace
