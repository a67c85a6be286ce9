// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// One cycle: the fast path, else the levels one after the other, with damping and scaling.
// Reference: tp_controller/solver/solve.py

#pragma once

#include "bounded_hierarchy.h"
#include "min_norm.h"
#include "scaling.h"

namespace {

struct Options {
  int n;
  Damping damping;
  std::vector<double> weights;           // none where empty
  bool uniform, fast;
};

class Solver {
 public:
  explicit Solver(const Options &options) : options_(options) {}

  Arena arena;
  std::vector<Level> levels;
  std::vector<double> memory;
  std::vector<Step> steps;
  std::vector<Above> above;
  double *x = nullptr, *whole = nullptr, slowed = 1.0;
  bool looped = false, busy = false;     // not looped: the fast path did it
  // What is known of levels that are solved again; and whether their demands are those of
  // `remember_free`.
  Shared shared;
  bool same = false;

  const Options &options() const { return options_; }
  int n() const { return options_.n; }

  void begin() {
    arena.reset();
    shared = Shared();
    same = false;
    clear();
  }

  void clear() {
    levels.clear();
    memory.clear();
    steps.clear();
    slowed = 1.0;
    looped = false;
  }

  // Remember the velocity of the fast path without bounds and curvature: where there is none, or it
  // is not within the bounds, the fast path fails for the same demands.
  void remember_free(double period) {
    curved_.assign(levels.size(), 0.0);
    double *free = arena.take(options_.n);
    free_ = find_free(period, free) ? free : nullptr;
  }

  // Solve the levels; no bounds and no cap where they are null.
  void solve(const double *lower, const double *upper, double period, const double *cap) {
    const int n = options_.n;
    if (!lower || !upper) {
      double *least = arena.take(n), *most = arena.take(n);
      std::fill(least, least + n, -INF);
      std::fill(most, most + n, INF);
      lower = least;
      upper = most;
    }
    if (solve_fast(lower, upper, period, cap)) {
      for (double &h : memory) h = options_.damping.follow(h, 0.0, period);
      return;
    }
    looped = true;
    if (options_.uniform) {
      solve_uniformly(lower, upper, period);
      return;
    }
    loop(lower, upper, cap, false, x);
    remember(period);
  }

  // Whether the fast path solves the levels.
  bool solve_fast(const double *lower, const double *upper, double period, const double *cap) {
    x = whole = arena.take(options_.n);
    curved_.clear();
    for (double h : memory) curved_.push_back(options_.damping.curvature(h, period));
    return options_.fast && fast(lower, upper, period, cap);
  }

  // For levels one after the other, and then `finish`.
  BoundedHierarchy hierarchy(Polytope &allowed) {
    return BoundedHierarchy(arena, allowed, options_.damping, weights(), above, shared);
  }

  void finish(BoundedHierarchy &hierarchy, const double *lower, const double *upper) {
    looped = true;
    double *found = arena.take(options_.n);
    finish(hierarchy, found);
    x = found;
    whole = found;
    if (!options_.uniform) return;
    x = arena.take(options_.n);
    scale(lower, upper, {});
  }

 private:
  bool fast(const double *lower, const double *upper, double period, const double *cap) {
    if (same && !(free_ && fits(free_, lower, upper, cap))) return false;
    double *free = arena.take(options_.n);
    return find_free(period, free) && fits(free, lower, upper, cap);
  }

  bool find_free(double period, double *free) {
    if (std::any_of(levels.begin(), levels.end(), [](const Level &l) { return l.joints; }))
      return false;
    demands_.clear();
    demands_curved_.clear();
    for (size_t l = 0; l < levels.size(); ++l) {
      if (levels[l].bounded) continue;
      demands_.push_back(&levels[l]);
      demands_curved_.push_back(curved_[l]);
    }
    return MinNorm(arena, options_.n, options_.damping, period)
               .solve(demands_, demands_curved_, weights(), free)
        && std::isfinite(dot(free, free, options_.n));
  }

  // Whether velocities are within all bounds; x is them then.
  bool fits(const double *free, const double *lower, const double *upper, const double *cap) {
    const int n = options_.n;
    Polytope allowed(arena, n, lower, upper, 0);
    if (cap && std::count_if(levels.begin(), levels.end(),
                             [](const Level &l) { return !l.bounded; }) > 1)
      for (int j = 0; j < n; ++j) {
        allowed.lower[j] = clip(-cap[j], lower[j], upper[j]);
        allowed.upper[j] = clip(cap[j], lower[j], upper[j]);
      }
    if (!allowed.fitting(free, x)) return false;
    for (const Level &level : levels)
      if (level.bounded && !level.meets(x)) return false;
    return true;
  }

  void loop(const double *lower, const double *upper, const double *cap, bool demands_only,
            double *found) {
    const int n = options_.n;
    int rows = 0;
    for (const Level &level : levels) rows += level.bounded ? level.m : 0;
    Polytope allowed(arena, n, lower, upper, rows);
    BoundedHierarchy hierarchy = this->hierarchy(allowed);
    steps.clear();
    for (size_t l = 0; l < levels.size(); ++l) {
      if (levels[l].bounded) {
        if (!demands_only) steps.push_back(hierarchy.satisfy(levels[l], curved_[l]));
        continue;
      }
      steps.push_back(hierarchy.carry_out(levels[l], curved_[l]));
      if (cap) allowed.narrow(cap, hierarchy.x());
      cap = nullptr;
    }
    finish(hierarchy, found);
  }

  void finish(BoundedHierarchy &hierarchy, double *found) const {
    const int n = options_.n;
    hierarchy.finish();
    std::copy(hierarchy.x(), hierarchy.x() + n, found);
    if (!std::isfinite(dot(found, found, n))) throw Unsolved();
  }

  void solve_uniformly(const double *lower, const double *upper, double period) {
    const int n = options_.n;
    double *least = arena.take(n), *most = arena.take(n);
    std::fill(least, least + n, -INF);
    std::fill(most, most + n, INF);
    double *free = arena.take(n);
    whole = free;
    End enlarging;
    if (std::any_of(levels.begin(), levels.end(), [](const Level &l) { return l.bounded; })) {
      // No bounds of levels are worth slowing the joints more than the demands need.
      loop(least, most, nullptr, true, free);
      const Scaled found = scale_uniformly(n, whole, lower, upper, x);
      const double share = found.slowed != 0.0 ? found.slowed : 1.0;
      for (int j = 0; j < n; ++j) {
        const double rest = slowest(lower[j], upper[j]);
        least[j] = rest + (std::min(lower[j], 0.0) - rest) / share;
        most[j] = rest + (std::max(upper[j], 0.0) - rest) / share;
      }
      enlarging = end(upper, found.limiting);
    }
    loop(least, most, nullptr, false, free);
    remember(period);
    scale(lower, upper, enlarging);
  }

  // A joint and the sign of the bound at which its velocity is; no joint: −1.
  struct End {
    int joint = -1;
    double sign = 0.0;
  };

  End end(const double *upper, int j) const {
    return {j, j >= 0 && x[j] == upper[j] ? 1.0 : -1.0};
  }

  void scale(const double *lower, const double *upper, const End &enlarging) {
    const Scaled found = scale_uniformly(options_.n, whole, lower, upper, x);
    slowed = found.slowed;
    limit(enlarging, end(upper, found.limiting));
  }

  // Give the steps the multipliers of scaled joints.
  void limit(const End &enlarging, const End &slowing) {
    const size_t n = size_t(options_.n);
    std::vector<double *> found;
    bool acts = false;
    for (const Step &step : steps) {
      found.push_back(half_signs(step));
      acts = acts || std::any_of(found.back(), found.back() + n, [](double m) { return m != 0.0; });
    }
    const bool enlarges = acts && enlarging.joint >= 0;
    for (size_t l = 0; l < steps.size(); ++l) {
      if (!steps[l].multipliers && !enlarges && slowing.joint < 0) continue;
      if (enlarges) found[l][enlarging.joint] = 0.5 * enlarging.sign;
      if (slowing.joint >= 0) found[l][slowing.joint] = slowing.sign;
      steps[l].multipliers = found[l];
    }
  }

  // Half the signs of the multipliers (n,) of a step; 0 for rounding errors.
  double *half_signs(const Step &step) {
    double *found = arena.zeros(size_t(options_.n)), most = 0.0;
    if (!step.multipliers) return found;
    for (int j = 0; j < options_.n; ++j) most = std::max(most, std::fabs(step.multipliers[j]));
    const double least = std::max(NEGLIGIBLE * most, ROUNDING);
    for (int j = 0; j < options_.n; ++j)
      if (std::fabs(step.multipliers[j]) > least)
        found[j] = step.multipliers[j] > 0.0 ? 0.5 : -0.5;
    return found;
  }

  void remember(double period) {
    for (size_t l = 0; l < levels.size(); ++l)
      memory[l] = options_.damping.follow(memory[l], steps[l].bend, period);
  }

  const double *weights() const {
    return options_.weights.empty() ? nullptr : options_.weights.data();
  }

  Options options_;
  const double *free_ = nullptr;
  std::vector<double> curved_, demands_curved_;
  std::vector<const Level *> demands_;
};

}  // namespace
