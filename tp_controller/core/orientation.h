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
