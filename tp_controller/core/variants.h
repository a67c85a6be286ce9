// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Variants of a cycle that lasts: with some of its tasks, limits or options changed.
// Reference: tp_controller/control/variants.py

#pragma once

#include "solve.h"
#include "velocity_limits.h"

namespace {

// Constants of the reference.
constexpr int SETTLING_STEPS = 16;
constexpr double MEMORY_SETTLED = 5e-2, STEEPEST = 0.5;

// The rows of a task among those of its level.
struct Part {
  size_t level;
  int first, m;
  bool is_identity;
};

struct ActiveLimits {
  int joint;
  unsigned limits;
};

// A task by its place among all of them, or limits of a joint where that is −1.
struct Removable {
  int task;
  ActiveLimits active;

  bool operator==(const Removable &other) const {
    return task == other.task && active.joint == other.active.joint
        && active.limits == other.active.limits;
  }
};

using Removed = std::vector<Removable>;

inline bool has(const Removed &removed, const Removable &one) {
  return std::find(removed.begin(), removed.end(), one) != removed.end();
}

// A cycle that was solved, and the tasks of its levels.
struct SolvedCycle {
  std::vector<Level> levels;
  std::vector<Part> parts;
  std::vector<double> memory;            // before the cycle
  std::vector<Step> steps;               // none where the fast path solved it
  JointMotion motion;
  const double *cap, *x, *whole;
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

// What the solver found.
struct Found {
  const double *x, *whole;
  double slowed;
  std::vector<Step> steps;               // none where the fast path solved it
  std::vector<double> memory;
};

// Velocities of a cycle that is solved again with some of its tasks or limits changed.
class Variants {
 public:
  // With the solver of the cycle, and one without damping.
  Variants(Solver &solver, Solver &undamped, const Limits &limits, const SolvedCycle &cycle)
      : solver_(solver), undamped_(undamped), limits_(limits), cycle_(cycle),
        transient_(limits.limits.has_transient()) {
    for (const Step &step : cycle.steps)
      if (!step.level->bounded) solver.shared.directions.push_back(step.directions);
    solver.levels = cycle.levels;
    solver.remember_free(cycle.hold);
    double *lower = arena().take(solver.n()), *upper = arena().take(solver.n());
    limits.box(cycle.motion, true, lower, upper);
    lower_ = lower;
    upper_ = upper;
    settle();
  }

  // The solution of the cycle that lasts.
  const Found &lasting() const { return lasting_; }

  // The velocity without transient limits, with the present memory.
  const double *accelerated() const { return accelerated_; }

  // Whether the memory damps a level.
  bool remembers() const {
    return std::any_of(cycle_.memory.begin(), cycle_.memory.end(),
                       [](double h) { return h != 0.0; });
  }

  const double *straight() {
    if (straight_) return straight_;
    double *found = arena().take(solver_.n());
    Arena::Frame frame(arena());
    solve(solver_, variant_without({}), std::vector<double>(cycle_.levels.size()), 0.0);
    std::copy(solver_.x, solver_.x + solver_.n(), found);
    return straight_ = found;
  }

  const double *undamped() {
    if (undamped_velocity_) return undamped_velocity_;
    undamped_.begin();
    return undamped_velocity_ = velocity(undamped_, variant_without({}));
  }

  // Without some tasks and limits.
  const double *without(const Removed &removed) {
    for (const auto &each : without_) if (each.first == removed) return each.second;
    without_.push_back({removed, velocity(solver_, variant_without(removed))});
    return without_.back().second;
  }

  // The bound of a joint from above, or from below, without some limits.
  double bound(int j, bool up, const Removed &removed) const {
    const Interval box = limits_.at(cycle_.motion, cycle_.gain, size_t(j), bits(j, removed));
    return up ? box.most : box.least;
  }

  // Bits of the limits of a joint that are not in force: transient ones, and those removed.
  static unsigned bits(int j, const Removed &removed) {
    unsigned found = ALL_TRANSIENT;
    for (const Removable &each : removed)
      if (each.task < 0 && each.active.joint == j) found |= each.active.limits;
    return found;
  }

  // With other rows of J (m, n) of a task.
  const double *with_rows(const Part &part, const double *rows) {
    Variant variant = variant_without({});
    Level &level = variant.levels[part.level];
    note_change(variant, part.level);
    double *J = arena().copy(level.J, size_t(level.m) * level.n);
    std::copy(rows, rows + size_t(part.m) * level.n, J + size_t(part.first) * level.n);
    level.J = J;
    return velocity(solver_, variant);
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

  // The cycle without some tasks and limits.
  Variant variant_without(const Removed &removed) const {
    Variant variant = {{}, {}, lower_, upper_, cycle_.cap, solver_.shared.directions.size(), true};
    auto part = cycle_.parts.begin();
    for (size_t l = 0; l < cycle_.levels.size(); ++l) {
      std::vector<const Part *> left;
      bool whole = true;
      for (; part != cycle_.parts.end() && part->level == l; ++part) {
        if (has(removed, {int(part - cycle_.parts.begin()), {}})) whole = false;
        else left.push_back(&*part);
      }
      if (!whole) note_change(variant, l);
      if (left.empty()) continue;
      variant.kept.push_back(l);
      variant.levels.push_back(whole ? cycle_.levels[l] : level_of(left));
    }
    for (const Removable &each : removed)
      if (each.task < 0) remove_limits(variant, each.active, removed);
    return variant;
  }

  // Levels below one whose demands change are decomposed anew.
  void note_change(Variant &variant, size_t index) const {
    if (cycle_.levels[index].bounded) return;
    size_t above = 0;
    for (size_t l = 0; l < index; ++l) above += !cycle_.levels[l].bounded;
    variant.shared = std::min(variant.shared, above);
    variant.same = false;
  }

  void remove_limits(Variant &variant, const ActiveLimits &active, const Removed &removed) const {
    const size_t j = size_t(active.joint);
    variant.lower = with(variant.lower, j, bound(active.joint, false, removed));
    variant.upper = with(variant.upper, j, bound(active.joint, true, removed));
    // A velocity limit includes its cap.
    if (active.limits & (RESERVE | VELOCITY) && variant.cap) variant.cap = with(variant.cap, j, INF);
  }

  const double *with(const double *numbers, size_t j, double number) const {
    double *found = arena().copy(numbers, solver_.n());
    found[j] = number;
    return found;
  }

  // A level of some tasks of one.
  Level level_of(const std::vector<const Part *> &parts) const {
    Level found = cycle_.of(*parts[0]);
    found.is_identity = parts[0]->is_identity;
    if (parts.size() == 1) return found;
    const Level &whole = cycle_.levels[parts[0]->level];
    found = whole;
    found.m = 0;
    for (const Part *part : parts) found.m += part->m;
    found.J = joined(whole.J, parts, found.m, whole.n);
    found.v = joined(whole.v, parts, found.m, 1);
    found.lower = joined(whole.lower, parts, found.m, 1);
    found.upper = joined(whole.upper, parts, found.m, 1);
    return found;
  }

  // The rows of some tasks, m in all, of those of a level.
  const double *joined(const double *rows, const std::vector<const Part *> &parts, int m,
                       int width) const {
    if (!rows) return nullptr;
    double *found = arena().take(size_t(m) * width), *to = found;
    for (const Part *part : parts) {
      const double *from = rows + size_t(part->first) * width;
      to = std::copy(from, from + size_t(part->m) * width, to);
    }
    return found;
  }

  // Find the cycle that lasts. Without transient limits the present one is its first step.
  void settle() {
    const Variant variant = variant_without({});
    Settling its = {cycle_.memory, {}, {}};
    for (int i = 0; i < SETTLING_STEPS; ++i) {
      if (i == 0 && !transient_) {
        lasting_ = {cycle_.x, cycle_.whole, cycle_.slowed, cycle_.steps, {}};
      } else {
        solve(solver_, variant, its.memory, cycle_.hold);
        lasting_ = {solver_.x, solver_.whole, solver_.slowed, {}, {}};
        if (solver_.looped) lasting_.steps = solver_.steps;
        // The levels of the solver are those of a variant later.
        for (size_t l = 0; l < lasting_.steps.size(); ++l)
          lasting_.steps[l].level = &cycle_.levels[l];
      }
      if (i == 0) accelerated_ = lasting_.x;
      if (has_settled(lasting_.steps, variant, its)) break;
    }
    lasting_.memory = its.memory;
  }

  // A memory on its way, and what the last cycle left of it.
  struct Settling {
    std::vector<double> memory, before, left;
  };

  // Whether the memory is what a cycle leaves, at most the present one; otherwise it moves towards
  // that.
  bool has_settled(const std::vector<Step> &steps, const Variant &variant, Settling &its) const {
    const auto now = [&](size_t l) {
      return steps.empty() ? 0.0 : std::min(steps[l].bend, cycle_.memory[variant.kept[l]]);
    };
    bool settled = true;
    for (size_t l = 0; l < its.memory.size(); ++l)
      settled = settled && std::fabs(now(l) - its.memory[l]) <= MEMORY_SETTLED * its.memory[l];
    if (settled) return true;
    const bool first = its.left.empty();
    its.before.resize(its.memory.size());
    its.left.resize(its.memory.size());
    for (size_t l = 0; l < its.memory.size(); ++l) {
      const double old = its.memory[l], left = now(l);
      const double slope = first || old == its.before[l] ? 0.0
          : std::min((left - its.left[l]) / (old - its.before[l]), STEEPEST);
      its.memory[l] = std::min(std::max(old + (left - old) / (1.0 - slope), 0.0),
                               cycle_.memory[variant.kept[l]]);
      its.before[l] = old;
      its.left[l] = left;
    }
    return false;
  }

  // The velocities (n,) of a variant whose memory has settled.
  const double *velocity(Solver &solver, const Variant &variant) {
    double *found = arena().take(solver.n());
    Settling its;
    for (size_t index : variant.kept) its.memory.push_back(lasting_.memory[index]);
    Arena::Frame frame(solver.arena);
    for (int i = 0; i < SETTLING_STEPS; ++i) {
      solve(solver, variant, its.memory, cycle_.hold);
      if (has_settled(solver.looped ? solver.steps : none_, variant, its)) break;
    }
    std::copy(solver.x, solver.x + solver.n(), found);
    return found;
  }

  void solve(Solver &solver, const Variant &variant, const std::vector<double> &memory,
             double hold) const {
    solver.clear();
    solver.levels = variant.levels;
    solver.memory = memory;
    if (&solver == &solver_) {
      solver.shared.count = variant.shared;
      solver.same = variant.same;
    }
    solver.solve(variant.lower, variant.upper, hold, variant.cap);
  }

  Solver &solver_, &undamped_;
  const Limits &limits_;
  const SolvedCycle &cycle_;
  const bool transient_;
  const double *lower_ = nullptr, *upper_ = nullptr;
  Found lasting_;
  const std::vector<Step> none_;
  std::vector<std::pair<Removed, const double *>> without_;
  const double *accelerated_ = nullptr, *straight_ = nullptr, *undamped_velocity_ = nullptr;
};

}  // namespace
