// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Descent from a configuration to one nearby at which the errors of a stack are least.
// Reference: tp_controller/positions/descent.py

#pragma once

#include "position_stack.h"
#include "solve.h"

#include <chrono>

namespace {

// Constants of the reference.
constexpr double MET = 1e-13, KEPT = 5e-7;
constexpr double FIRST_RADIUS = 0.6, LARGEST_RADIUS = 1.5, LEAST_RADIUS = 1e-5;
constexpr double LEAST_GAIN = 0.05, WELL_PREDICTED = 0.7, SHRINK = 0.35, GROW = 2.0;
constexpr double LEAST_REDUCTION = 1e-4, LAST_REDUCTION = 1e-8;
constexpr double STALLED = 0.7, LEAST_SLOPE = 1e-4;
constexpr int STALLED_STEPS = 7, CORRECTIONS = 4, MOST_STEPS = 200, ROUNDS = 3;

// What a level may cost while others are reduced.
double kept_cost(double cost) {
  const double error = std::sqrt(cost) + KEPT;
  return error * error;
}

class Descent {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Descent(PositionStack &tasks) : tasks_(tasks), solver_(undamped(int(tasks.n()))) {}

  Clock::time_point stop;

  bool out_of_time() const { return Clock::now() > stop; }
  void begin() { steps_ = 0; }

  // Reduce the first levels together; in turn if they cannot be met together.
  void approach(Point &point, size_t needed) {
    reduce(point, 0, needed, false);
    if (needed > 1 && point.cost(0, needed) > MET)
      for (size_t l = 0; l < needed; ++l) reduce(point, l, l + 1, false);
  }

  // Reduce all levels in turn.
  void finish(Point &point) {
    for (int i = 0; i < ROUNDS; ++i) {
      bool moved = false;
      for (size_t l = 0; l < point.levels.size(); ++l)
        moved |= tasks_.is_objective(l) ? maximize(point, l) : reduce(point, l, l + 1, true);
      if (!moved) break;
    }
  }

 private:
  static Options undamped(int n) {
    Options options;
    options.n = n;
    options.uniform = false;
    options.fast = true;
    return options;
  }

  // Reduce the cost of the levels `first` to `last` − 1; a patient descent goes on while
  // there is any progress. Whether the point has moved.
  bool reduce(Point &point, size_t first, size_t last, bool patient) {
    double radius = FIRST_RADIUS, cost = point.cost(first, last);
    int slow = 0;
    bool moved = false;
    const std::vector<double> kept = kept_costs(point, first);
    while (cost > MET && steps_ < MOST_STEPS && !out_of_time()) {
      ++steps_;
      const double *step = solve(point, last, radius);
      double left = 0.0;
      for (size_t l = first; l < last; ++l)
        left += linear_cost(point.levels[l], point.errors[l], step, scratch_);
      const double reduction = cost - left;
      if (reduction <= (patient ? LAST_REDUCTION : LEAST_REDUCTION) * cost) break;
      const double longest = largest(step);
      tasks_.move(point, step, trial_);
      correct(point, first);
      const double after = trial_.cost(first, last);
      const double gain = holds(trial_, kept) ? (cost - after) / reduction : -1.0;
      if (!(gain > LEAST_GAIN)) {
        radius = SHRINK * longest;
        if (radius < LEAST_RADIUS) break;
        continue;
      }
      if (gain > WELL_PREDICTED) radius = std::min(GROW * radius, LARGEST_RADIUS);
      slow = after > STALLED * cost ? slow + 1 : 0;
      std::swap(point, trial_);
      cost = after;
      moved = true;
      if (slow == STALLED_STEPS && !patient) break;
    }
    return moved;
  }

  // Follow the slope of an objective, without a change of the levels above it. Whether the point has
  // moved.
  bool maximize(Point &point, size_t l) {
    const int n = int(tasks_.n());
    const std::vector<double> kept = kept_costs(point, l);
    double radius = FIRST_RADIUS;
    bool moved = false;
    while (steps_ < MOST_STEPS && !out_of_time()) {
      ++steps_;
      const double *slope = point.errors[l];
      const double steepest = largest(slope);
      if (steepest == 0.0) break;
      // The slope tells the direction, the region the length.
      double *demand = point.arena.zeros(size_t(n));
      add(radius / steepest, slope, demand, n);
      point.levels[l].v = demand;
      const double *step = solve(point, l + 1, radius);
      const double rise = dot(slope, step, n), length = largest(step);
      if (length < LEAST_RADIUS || rise <= LEAST_SLOPE * steepest * length) break;
      step = scratch_.copy(step, size_t(n));
      tasks_.move(point, step, trial_);
      correct(point, l);
      // The mean of the slopes at both ends, along the step.
      const double gain = holds(trial_, kept)
          ? 0.5 + 0.5 * dot(trial_.errors[l], step, n) / rise : -1.0;
      scratch_.reset();
      if (!(gain > LEAST_GAIN)) {
        radius = SHRINK * length;
        continue;
      }
      if (gain > WELL_PREDICTED) radius = std::min(GROW * radius, LARGEST_RADIUS);
      std::swap(point, trial_);
      moved = true;
    }
    return moved;
  }

  double largest(const double *numbers) const {
    double found = 0.0;
    for (size_t j = 0; j < tasks_.n(); ++j) found = std::max(found, std::fabs(numbers[j]));
    return found;
  }

  // What the first levels may cost while others are reduced.
  static std::vector<double> kept_costs(const Point &point, size_t count) {
    std::vector<double> kept(point.costs.begin(), point.costs.begin() + long(count));
    for (double &each : kept) each = kept_cost(each);
    return kept;
  }

  // The change of the positions for the first levels; valid until the next one.
  const double *solve(const Point &point, size_t count, double radius) {
    const size_t n = tasks_.n();
    solver_.begin();
    solver_.levels.assign(point.levels.begin(), point.levels.begin() + long(count));
    solver_.memory.assign(count, 0.0);
    double *lower = solver_.arena.take(n), *upper = solver_.arena.take(n);
    for (size_t j = 0; j < n; ++j) {
      lower[j] = std::min(std::max(tasks_.to_lower(point, j), -radius), 0.0);
      upper[j] = std::max(std::min(tasks_.to_upper(point, j), radius), 0.0);
    }
    solver_.solve(lower, upper, 0.0, nullptr);
    return solver_.x;
  }

  // Lead the trial back to where the first levels cost what they did before.
  void correct(const Point &before, size_t count) {
    std::vector<double> allowed(before.costs.begin(), before.costs.begin() + long(count));
    for (double &each : allowed) each = std::max(each, MET);
    for (int i = 0; i < CORRECTIONS && !holds(trial_, allowed); ++i) {
      const double *step = solve(trial_, count, LARGEST_RADIUS);
      tasks_.move(trial_, step, corrected_);
      std::swap(trial_, corrected_);
    }
  }

  // Whether the first levels cost at most so much.
  static bool holds(const Point &point, const std::vector<double> &most) {
    for (size_t l = 0; l < most.size(); ++l)
      if (!(point.costs[l] <= most[l])) return false;
    return true;
  }

  PositionStack &tasks_;
  Solver solver_;
  Point trial_, corrected_;
  Arena scratch_;
  int steps_ = 0;
};

}  // namespace
