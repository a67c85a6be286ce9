// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Variants of a cycle that lasts: with some of its tasks, limits or options changed.
// Reference: tp_controller/control/variants.py

#pragma once

#include "settling.h"
#include "standing_joints.h"
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
};

// A task by its place among all of them, or limits of a joint where that is −1; a joint that stands is
// removed with its velocity limit.
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
  std::vector<Level> levels, whole_levels;  // without the columns of joints that stand, and with them
  std::vector<int> standing;
  std::vector<Part> parts;
  std::vector<double> memory;            // before the cycle
  std::vector<Step> steps;               // none where the fast path solved it
  JointMotion motion;
  const double *cap, *x, *whole;
  double gain, hold, slowed;             // gain: of position limits

  // The level of a task alone, with the columns of joints that stand.
  Level of(const Part &part) const {
    Level level = whole_levels[part.level];
    const auto from = [&part](const double *rows, int width) {
      return rows ? rows + size_t(part.first) * width : nullptr;
    };
    level.m = part.m;
    level.J = from(level.J, level.n);
    level.v = from(level.v, 1);
    level.lower = from(level.lower, 1);
    level.upper = from(level.upper, 1);
    level.weights = from(level.weights, 1);
    return level;
  }
};

// Velocities of a cycle that is solved again with some of its tasks or limits changed.
class Variants {
 public:
  // With the solver of the cycle, and one without damping.
  Variants(Solver &solver, Solver &undamped, const Limits &limits, const SolvedCycle &cycle)
      : solver_(solver), undamped_(undamped), limits_(limits), cycle_(cycle),
        transient_(limits.limits.has_transient()), settling_(solver) {
    ::share(cycle.steps, solver.shared.directions);
    solver.levels = cycle.levels;
    solver.remember_free(cycle.hold);
    double *lower = arena().take(solver.n()), *upper = arena().take(solver.n());
    limits.box(cycle.motion, true, lower, upper);
    lower_ = lower;
    upper_ = upper;
    share(variant_without({}));
    settling_.begin({cycle.levels, cycle.memory, lower_, upper_, cycle.cap, cycle.hold});
  }

  // The solution of the cycle that lasts.
  const Found &lasting() const { return settling_.first(); }

  // The velocity without transient limits, with the present memory.
  const double *accelerated() {
    if (accelerated_) return accelerated_;
    if (!transient_) return accelerated_ = cycle_.x;
    return accelerated_ = lasting().moved ? solve_once(cycle_.memory, cycle_.hold) : lasting().x;
  }

  // Whether the memory damps a level.
  bool remembers() const {
    return std::any_of(cycle_.memory.begin(), cycle_.memory.end(),
                       [](double h) { return h != 0.0; });
  }

  const double *straight() {
    if (!straight_) straight_ = solve_once(std::vector<double>(cycle_.levels.size()), 0.0);
    return straight_;
  }

  const double *undamped() {
    if (undamped_velocity_) return undamped_velocity_;
    undamped_.begin();
    Settling settling(undamped_);
    return undamped_velocity_ = velocity(settling, variant_without({}), 0);
  }

  // Without some tasks and limits.
  const double *without(const Removed &removed) {
    for (const auto &each : without_) if (each.first == removed) return each.second;
    const Variant variant = variant_without(removed);
    without_.push_back({removed, velocity(settling_, variant, same_levels(removed))});
    return without_.back().second;
  }

  // With a level that may move all joints.
  const double *with_all_joints(size_t l) {
    Variant variant = variant_without({});
    note_change(variant, l);
    variant.levels[l].joints = nullptr;
    return velocity(settling_, variant, l);
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
    Level level = cycle_.whole_levels[part.level];
    note_change(variant, part.level);
    double *J = arena().copy(level.J, size_t(level.m) * level.n);
    std::copy(rows, rows + size_t(part.m) * level.n, J + size_t(part.first) * level.n);
    level.J = J;
    leave_out(arena(), cycle_.standing, level);
    variant.levels[part.level] = level;
    return velocity(settling_, variant, part.level);
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

  // The joints that stand without some limits.
  std::vector<int> standing_without(const Removed &removed) const {
    std::vector<int> found;
    for (int j : cycle_.standing) if (!has(removed, {-1, {j, VELOCITY}})) found.push_back(j);
    return found;
  }

  // The cycle without some tasks and limits.
  Variant variant_without(const Removed &removed) const {
    Variant variant = {{}, {}, lower_, upper_, cycle_.cap, solver_.shared.directions.size(), true};
    const std::vector<int> standing = standing_without(removed);
    const bool same_joints = standing.size() == cycle_.standing.size();
    auto part = cycle_.parts.begin();
    for (size_t l = 0; l < cycle_.levels.size(); ++l) {
      std::vector<const Part *> left;
      bool whole = true;
      for (; part != cycle_.parts.end() && part->level == l; ++part) {
        if (has(removed, {int(part - cycle_.parts.begin()), {}})) whole = false;
        else left.push_back(&*part);
      }
      if (!whole || !same_joints) note_change(variant, l);
      if (left.empty()) continue;
      variant.kept.push_back(l);
      variant.levels.push_back(cycle_.levels[l]);
      if (whole && same_joints) continue;
      variant.levels.back() = whole ? cycle_.whole_levels[l] : level_of(left);
      leave_out(arena(), standing, variant.levels.back());
    }
    for (const Removable &each : removed)
      if (each.task < 0) remove_limits(variant, each.active, removed);
    return variant;
  }

  // Levels below one whose demands change are decomposed anew.
  void note_change(Variant &variant, size_t index) const {
    // The fast path solves no level with a mask.
    if (cycle_.levels[index].joints) variant.same = false;
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
    const Level &whole = cycle_.whole_levels[parts[0]->level];
    found = whole;
    found.m = 0;
    for (const Part *part : parts) found.m += part->m;
    found.J = joined(whole.J, parts, found.m, whole.n);
    found.v = joined(whole.v, parts, found.m, 1);
    found.lower = joined(whole.lower, parts, found.m, 1);
    found.upper = joined(whole.upper, parts, found.m, 1);
    found.weights = joined(whole.weights, parts, found.m, 1);
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

  // The number of levels that depend on none of some tasks and limits.
  size_t same_levels(const Removed &removed) const {
    if (standing_without(removed).size() < cycle_.standing.size()) return 0;
    size_t count = cycle_.levels.size();
    for (const Removable &each : removed)
      count = std::min(count, each.task < 0 ? settling_.independent_of(each.active.joint)
                                            : cycle_.parts[size_t(each.task)].level);
    return count;
  }

  // The velocities (n,) of a variant whose memory has settled; `same`: its first levels have not
  // changed.
  const double *velocity(Settling &settling, const Variant &variant, size_t same) {
    double *found = arena().take(solver_.n());
    std::vector<double> memory;
    for (size_t index : variant.kept) memory.push_back(cycle_.memory[index]);
    Arena::Frame frame(arena()), other(undamped_.arena);
    share(variant);
    const double *x = settling.solve(
        {variant.levels, memory, variant.lower, variant.upper, variant.cap, cycle_.hold}, same);
    std::copy(x, x + solver_.n(), found);
    return found;
  }

  // The velocities (n,) of the cycle with a memory that stays.
  const double *solve_once(const std::vector<double> &memory, double hold) {
    double *found = arena().take(solver_.n());
    Arena::Frame frame(arena());
    const Variant variant = variant_without({});
    share(variant);
    solver_.clear();
    solver_.levels = variant.levels;
    solver_.memory = memory;
    solver_.solve(variant.lower, variant.upper, hold, variant.cap);
    std::copy(solver_.x, solver_.x + solver_.n(), found);
    return found;
  }

  // Decompose no level anew whose demands, and those of levels above, are the same.
  void share(const Variant &variant) {
    solver_.shared.count = variant.shared;
    solver_.same = variant.same;
  }

  Solver &solver_, &undamped_;
  const Limits &limits_;
  const SolvedCycle &cycle_;
  const bool transient_;
  const double *lower_ = nullptr, *upper_ = nullptr;
  Settling settling_;
  std::vector<std::pair<Removed, const double *>> without_;
  const double *accelerated_ = nullptr, *straight_ = nullptr, *undamped_velocity_ = nullptr;
};

}  // namespace
