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

// Variants of a solved cycle: without some tasks or limits, or without damping.
// Reference: tp_controller/control/variants.py

#pragma once

#include "solve.h"
#include "velocity_limits.h"

namespace {

// The rows of a task among those of its level.
struct Part {
  size_t level;
  int first, m;
  bool is_identity;
};

struct ActiveLimits {
  int joint;
  unsigned limits;

  bool operator==(const ActiveLimits &other) const {
    return joint == other.joint && limits == other.limits;
  }
};

// A cycle that was solved, and the tasks of its levels.
struct SolvedCycle {
  std::vector<Level> levels;
  std::vector<Part> parts;
  std::vector<double> memory;
  std::vector<Step> steps;               // none where the fast path solved it
  JointMotion motion;
  const double *lower, *upper, *cap, *x;
  double gain, hold, slowed;             // gain: of position limits

  // The level of a task alone.
  Level of(const Part &part) const {
    Level level = levels[part.level];
    const auto from = [&part](const double *rows, int width) {
      return rows ? rows + size_t(part.first) * width : nullptr;
    };
    level.m = part.m;
    level.J = from(level.J, level.n);
    level.v = from(level.v, 1);
    level.lower = from(level.lower, 1);
    level.upper = from(level.upper, 1);
    return level;
  }
};

// Velocities of a cycle that is solved again with some of its tasks or limits changed.
class Variants {
 public:
  // With the solver of the cycle, and one without damping.
  Variants(Solver &solver, Solver &undamped, const Limits &limits, const SolvedCycle &cycle)
      : solver_(solver), undamped_(undamped), limits_(limits), cycle_(cycle),
        without_(cycle.parts.size()) {
    for (const Step &step : cycle.steps)
      if (!step.level->bounded) solver.shared.directions.push_back(step.directions);
    solver.levels = cycle.levels;
    solver.remember_free(cycle.hold);
  }

  const double *without(const ActiveLimits &removed) {
    for (const auto &each : limited_) if (each.first == removed) return each.second;
    Variant variant = unchanged();
    const size_t j = size_t(removed.joint);
    const Interval box = limits_.at(cycle_.motion, cycle_.gain, j, removed.limits);
    variant.lower = with(cycle_.lower, j, box.least);
    variant.upper = with(cycle_.upper, j, box.most);
    // A velocity limit includes its cap.
    if (removed.limits & (RESERVE | VELOCITY) && cycle_.cap)
      variant.cap = with(cycle_.cap, j, INF);
    limited_.push_back({removed, velocity(variant)});
    return limited_.back().second;
  }

  const double *without(size_t part) {
    if (!without_[part]) without_[part] = without_task(cycle_.parts[part]);
    return without_[part];
  }

  // With other rows of J (m, n) of a task.
  const double *with_rows(const Part &part, const double *rows) {
    Variant variant = unchanged();
    Level &level = change(variant, part.level);
    double *J = arena().copy(level.J, size_t(level.m) * level.n);
    std::copy(rows, rows + size_t(part.m) * level.n, J + size_t(part.first) * level.n);
    level.J = J;
    return velocity(variant);
  }

  const double *undamped() {
    if (undamped_velocity_) return undamped_velocity_;
    undamped_.begin();
    undamped_.levels = cycle_.levels;
    undamped_.memory.assign(cycle_.levels.size(), 0.0);
    undamped_.solve(cycle_.lower, cycle_.upper, 0.0, cycle_.cap);
    return undamped_velocity_ = arena().copy(undamped_.x, solver_.n());
  }

 private:
  struct Variant {
    std::vector<Level> levels;
    std::vector<size_t> kept;            // indices of these levels in the stack
    const double *lower, *upper, *cap;
    size_t shared;                       // demands before the first that has changed
    bool same;                           // no demand has changed
  };

  Arena &arena() const { return solver_.arena; }

  Variant unchanged() const {
    Variant variant = {cycle_.levels, {}, cycle_.lower, cycle_.upper, cycle_.cap,
                       solver_.shared.directions.size(), true};
    for (size_t l = 0; l < cycle_.levels.size(); ++l) variant.kept.push_back(l);
    return variant;
  }

  // The level of a variant that is going to change.
  Level &change(Variant &variant, size_t index) const {
    Level &level = variant.levels[index];
    if (!level.bounded) {
      size_t above = 0;
      for (size_t l = 0; l < index; ++l) above += !variant.levels[l].bounded;
      variant.shared = std::min(variant.shared, above);
      variant.same = false;
    }
    return level;
  }

  const double *with(const double *numbers, size_t j, double number) const {
    double *found = arena().copy(numbers, solver_.n());
    found[j] = number;
    return found;
  }

  const double *without_task(const Part &removed) {
    Variant variant = unchanged();
    Level &level = change(variant, removed.level);
    std::vector<Part> left;
    for (const Part &each : cycle_.parts)
      if (each.level == removed.level && &each != &removed) left.push_back(each);
    if (left.empty()) {
      variant.levels.erase(variant.levels.begin() + long(removed.level));
      variant.kept.erase(variant.kept.begin() + long(removed.level));
    } else if (left.size() == 1) {
      level = cycle_.of(left[0]);
      level.is_identity = left[0].is_identity;
    } else {
      level.m -= removed.m;
      cut(level.J, removed, level.m, level.n);
      cut(level.v, removed, level.m, 1);
      cut(level.lower, removed, level.m, 1);
      cut(level.upper, removed, level.m, 1);
    }
    return velocity(variant);
  }

  // Replace rows by those that are left of them.
  void cut(const double *&rows, const Part &removed, int left, int width) const {
    if (!rows) return;
    double *found = arena().take(size_t(left) * width);
    const double *end = std::copy(rows, rows + size_t(removed.first) * width, found);
    const double *from = rows + size_t(removed.first + removed.m) * width;
    std::copy(from, from + (found + size_t(left) * width - end), found + (end - found));
    rows = found;
  }

  const double *velocity(const Variant &variant) {
    double *found = arena().take(solver_.n());
    std::vector<double> memory;
    for (size_t index : variant.kept) memory.push_back(cycle_.memory[index]);
    Arena::Frame frame(arena());
    if (std::any_of(memory.begin(), memory.end(), [](double h) { return h != 0.0; })) {
      // The memory follows from earlier cycles and is not a cause of its own.
      if (bends_.empty()) bends_ = bends(unchanged());
      const std::vector<double> after = bends(variant);
      for (size_t l = 0; l < memory.size(); ++l) {
        const double before = bends_[variant.kept[l]];
        if (after[l] < before) memory[l] *= after[l] / before;
      }
    }
    solve(variant, memory);
    std::copy(solver_.x, solver_.x + solver_.n(), found);
    return found;
  }

  // h of each level, from one cycle alone.
  std::vector<double> bends(const Variant &variant) {
    std::vector<double> found(variant.levels.size());
    solve(variant, found);
    if (solver_.looped)
      for (size_t l = 0; l < found.size(); ++l) found[l] = solver_.steps[l].bend;
    return found;
  }

  void solve(const Variant &variant, const std::vector<double> &memory) {
    solver_.clear();
    solver_.levels = variant.levels;
    solver_.memory = memory;
    solver_.shared.count = variant.shared;
    solver_.same = variant.same;
    solver_.solve(variant.lower, variant.upper, cycle_.hold, variant.cap);
  }

  Solver &solver_, &undamped_;
  const Limits &limits_;
  const SolvedCycle &cycle_;
  std::vector<double> bends_;
  std::vector<std::pair<ActiveLimits, const double *>> limited_;
  std::vector<const double *> without_;
  const double *undamped_velocity_ = nullptr;
};

}  // namespace
