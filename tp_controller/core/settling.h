// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Memory of the solver after a cycle has lasted.
// Reference: tp_controller/control/settling.py

#pragma once

#include "solve.h"

namespace {

// Constants of the reference.
constexpr int SETTLING_STEPS = 16;
constexpr double MEMORY_SETTLED = 2e-2, SAME_MOTION = 1e-3, STEEPEST = 0.9, FAR_APART = 10.0,
    INNERMOST = 0.05;

// Search for the memory that a level keeps, by the secant method.
class SettlingMemory {
 public:
  SettlingMemory(double most, int n) : memory(most), most_(most), n_(n) {}

  double memory;

  // Whether the memory has settled; it moves on otherwise.
  bool has_settled(double bend, const double *velocity) {
    bend = std::min(bend, most_);
    const double old = memory;
    ++steps_;
    const Point last = above_, here = {old, bend, velocity};
    const double slope = last.velocity ? (bend - last.bend) / (old - last.memory) : STEEPEST;
    if (std::fabs(bend - old) <= MEMORY_SETTLED * old * (1.0 - clip(slope, 0.0, STEEPEST))
        || steps_ >= SETTLING_STEPS)
      return true;
    (bend > old ? below_ : above_) = here;
    if (below_.velocity && above_.velocity) return is_between();
    memory = !last.velocity ? bend
        : std::max(old + (bend - old) / (1.0 - std::min(slope, STEEPEST)), 0.0);
    return false;
  }

 private:
  struct Point {
    double memory, bend;
    const double *velocity;
  };

  // Whether the two memories are close, or move the robot alike; otherwise one between is next.
  bool is_between() {
    double apart = 0.0, fastest = 0.0;
    for (int j = 0; j < n_; ++j) {
      const double slow = below_.velocity[j], fast = above_.velocity[j];
      apart = std::max(apart, std::fabs(slow - fast));
      fastest = std::max(fastest, std::max(std::fabs(slow), std::fabs(fast)));
    }
    const double least = below_.memory, most = above_.memory;
    if (most - least <= MEMORY_SETTLED * most || apart <= SAME_MOTION * fastest) return true;
    if (least > 0.0 && most > FAR_APART * least) {
      memory = std::sqrt(least * most);
      return false;
    }
    const double rise = below_.bend - least, fall = above_.bend - most;
    double share = rise / (rise - fall);
    if (least > 0.0) share = std::min(std::max(share, INNERMOST), 1.0 - INNERMOST);
    memory = least + share * (most - least);
    return false;
  }

  const double most_;
  const int n_;
  int steps_ = 0;
  // At the lowest memory above the root, and the highest below.
  Point above_ = {0.0, 0.0, nullptr}, below_ = {0.0, 0.0, nullptr};
};

// A cycle whose memory settles.
struct Lasting {
  const std::vector<Level> &levels;
  const std::vector<double> &memory;     // the present one
  const double *lower, *upper, *cap;
  double hold;
};

// What the solver found.
struct Found {
  const double *x, *whole;
  double slowed;
  std::vector<Step> steps;               // none where the fast path solved it
  bool moved;                            // the memory
};

// Solves cycles that last: a first one, and others that have its first levels.
class Settling {
 public:
  explicit Settling(Solver &solver) : solver_(solver), n_(solver.n()) {}

  // Solve the first cycle, and keep all that depends on its first levels.
  const Found &begin(const Lasting &its) {
    solve(its, 0, true);
    found_ = {solver_.x, solver_.whole, solver_.slowed, {}, moved_};
    if (!solver_.looped) return found_;
    found_.steps = solver_.steps;
    // Those of the solver may be levels of another cycle later.
    for (size_t l = 0; l < its.levels.size(); ++l) found_.steps[l].level = &its.levels[l];
    settled_ = memory_;
    above_ = solver_.above;
    std::vector<Directions> &directions = solver_.shared.directions;
    if (directions.empty()) share(found_.steps, directions);
    return found_;
  }

  const Found &first() const { return found_; }

  // The number of levels of the first cycle that do not depend on a limit of a joint.
  size_t independent_of(int j) const {
    size_t count = 0;
    while (count < states_.size() && !states_[count].touched[j]) ++count;
    return count;
  }

  // Solve a cycle whose first levels, `same` of them, are those of the first one.
  const double *solve(const Lasting &its, size_t same) {
    solve(its, std::min(same, states_.size()), false);
    return solver_.x;
  }

 private:
  // After a level of the first cycle.
  struct State {
    Progress progress;
    const double *rows, *lengths;
    const int *touched;
  };

  void solve(const Lasting &its, size_t same, bool keep) {
    solver_.clear();
    solver_.levels = its.levels;
    solver_.memory = its.memory;
    moved_ = false;
    if (same == 0 && solver_.solve_fast(its.lower, its.upper, its.hold, its.cap)) return;
    const bool uniform = solver_.options().uniform;
    if (uniform && std::any_of(its.levels.begin(), its.levels.end(),
                               [](const Level &level) { return level.bounded; }))
      settle_together(its);
    else
      settle(its, same, keep, uniform);
  }

  // Where all levels depend on all memories, these settle together.
  void settle_together(const Lasting &its) {
    std::vector<double> memory = its.memory;
    std::vector<SettlingMemory> searches;
    for (double most : memory) searches.push_back({most, n_});
    for (;;) {
      solver_.clear();
      solver_.levels = its.levels;
      solver_.memory = memory;
      solver_.solve(its.lower, its.upper, its.hold, its.cap);
      if (!solver_.looped) return;
      bool settled = true;
      for (size_t l = 0; l < memory.size(); ++l) {
        const Step &step = solver_.steps[l];
        settled &= searches[l].has_settled(step.bend, step.velocity);
        memory[l] = searches[l].memory;
      }
      if (settled) return;
      moved_ = true;
    }
  }

  void settle(const Lasting &its, size_t same, bool keep, bool uniform) {
    Arena &arena = solver_.arena;
    int rows = 0;
    for (const Level &level : its.levels) rows += level.bounded ? level.m : 0;
    double *least = arena.take(n_), *most = arena.take(n_);
    std::fill(least, least + n_, -INF);
    std::fill(most, most + n_, INF);
    Polytope allowed(arena, n_, uniform ? least : its.lower, uniform ? most : its.upper, rows);
    BoundedHierarchy hierarchy = solver_.hierarchy(allowed);
    const double *cap = uniform ? nullptr : its.cap;
    if (same > 0) {
      const State &state = states_[same - 1];
      std::copy(state.rows, state.rows + size_t(state.progress.rows) * n_, allowed.rows);
      std::copy(state.lengths, state.lengths + state.progress.rows, allowed.lengths);
      solver_.above = above_;
      hierarchy.return_to(state.progress);
    }
    memory_ = its.memory;
    std::copy(settled_.begin(), settled_.begin() + std::ptrdiff_t(same), memory_.begin());
    // Whether the fast path solves the cycle once it has forgotten all.
    solver_.memory.assign(its.levels.size(), 0.0);
    forgotten_ = solver_.solve_fast(its.lower, its.upper, its.hold, its.cap);
    for (size_t l = 0; l < its.levels.size(); ++l) {
      const Level &level = its.levels[l];
      if (l >= same) solver_.steps.push_back(settle_level(hierarchy, its, l, keep));
      if (l >= same && is_fast_) {
        states_.clear();
        solver_.steps.clear();
        return;
      }
      const double *x = l < same ? found_.steps[l].velocity : hierarchy.x();
      if (l >= same && keep)
        states_.push_back({hierarchy.progress(), allowed.rows, allowed.lengths, touched_});
      if (level.bounded || !cap) continue;
      allowed.narrow(cap, x);
      cap = nullptr;
    }
    solver_.finish(hierarchy, its.lower, its.upper);
  }

  Step settle_level(BoundedHierarchy &hierarchy, const Lasting &its, size_t l, bool keep) {
    const Level &level = its.levels[l];
    const Progress before = hierarchy.progress();
    SettlingMemory search(its.memory[l], n_);
    if (keep) {
      touched_ = solver_.arena.integers(n_);
      // The first level begins at rest, or next to it.
      for (int j = 0; j < n_; ++j)
        touched_[j] = l == 0 && !(its.lower[j] <= 0.0 && its.upper[j] >= 0.0);
      hierarchy.watch(touched_);
    }
    Directions known;
    for (bool again = false;; again = true) {
      memory_[l] = search.memory;
      is_fast_ = forgotten_ && is_fast(its);
      const double c = solver_.options().damping.curvature(search.memory, its.hold);
      const Step step = is_fast_ ? Step() : level.bounded ? hierarchy.satisfy(level, c)
          : hierarchy.carry_out(level, c, known.m ? &known : nullptr);
      if (search.has_settled(step.bend, is_fast_ ? solver_.x : step.velocity)) {
        moved_ = moved_ || again;
        return step;
      }
      if (is_fast_) continue;
      if (!level.joints) known = step.directions;
      hierarchy.return_to(before);
    }
  }

  // Whether the fast path solves the cycle with the memory so far.
  bool is_fast(const Lasting &its) {
    solver_.memory = memory_;
    return solver_.solve_fast(its.lower, its.upper, its.hold, its.cap);
  }

  Solver &solver_;
  const int n_;
  bool moved_ = false, forgotten_ = false, is_fast_ = false;
  std::vector<double> memory_, settled_; // of the levels now, and at the end of the first cycle
  int *touched_ = nullptr;
  Found found_;
  std::vector<State> states_;
  std::vector<Above> above_;
};

}  // namespace
