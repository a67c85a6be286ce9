// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// One cycle of a stack: positions and the memory of the cycle before in, velocity and memory out.
// Transitions, nudges and faults are left to the reference.
// Reference: tp_controller/control/step.py

#pragma once

#include "cycle_time.h"
#include "escape.h"
#include "solve.h"
#include "stack_levels.h"
#include "standing_joints.h"
#include "velocity_limits.h"

namespace {

// What a cycle leaves to the next one: numbers in a row.
class CycleMemory {
 public:
  CycleMemory(int n, int delay) : n_(n), delay_(delay) { set_levels(0); }

  void set_levels(size_t count) { numbers_.resize(HEAD + size_t(n_) * (3 + delay_) + count); }

  size_t size() const { return numbers_.size(); }
  double *data() { return numbers_.data(); }

  // When the last command was given, on the clock of the caller; not a number before the first.
  double &commanded() { return numbers_[0]; }
  CycleTime time() const { return {numbers_[1], numbers_[2], numbers_[3], numbers_[4]}; }
  double &before() { return numbers_[8]; }
  Escape escape() const { return {numbers_[5], numbers_[6], numbers_[7]}; }
  double *velocity() { return &numbers_[HEAD]; }
  double *acceleration() { return velocity() + n_; }
  // What the tasks demanded; not numbers where that is unknown.
  double *demand() { return acceleration() + n_; }
  double *pending(int i) { return demand() + size_t(n_) * (1 + i); }
  double *damping() { return pending(delay_); }

  void put(const CycleTime &time) {
    const double its[4] = {time.now, time.mean, time.usual, time.commands};
    std::copy(its, its + 4, &numbers_[1]);
  }

  void put(const Escape &escape) {
    const double its[3] = {escape.tries, escape.nudges, escape.still_since};
    std::copy(its, its + 3, &numbers_[5]);
  }

  // Note a command, and the time `h` in which it replaces the last one.
  void command(const double *x, double h) {
    before() = h;
    for (int j = 0; j < n_; ++j) acceleration()[j] = (x[j] - velocity()[j]) / h;
    for (int i = delay_ - 1; i > 0; --i) std::copy(pending(i - 1), pending(i), pending(i));
    if (delay_) std::copy(x, x + n_, pending(0));
    std::copy(x, x + n_, velocity());
  }

 private:
  static constexpr size_t HEAD = 9;

  int n_, delay_;
  std::vector<double> numbers_;
};

class ControlCycle {
 public:
  ControlCycle(const Options &options, const Limits &limits, std::vector<double> cap,
               double period, int delay)
      : limits(limits), cap(std::move(cap)), period(period), delay(delay), solver(options),
        memory(options.n, delay) {}

  const Limits limits;
  const std::vector<double> cap;
  const double period;
  const int delay;
  Solver solver;
  CycleMemory memory;
  std::vector<Level> given;              // levels of the tasks that Python evaluates, in order
  std::vector<Rows> evaluations;         // of the other tasks, in order
  std::vector<Level> levels;             // of all tasks, with the columns of joints that stand
  double elapsed = 0.0, *lower = nullptr, *upper = nullptr;
  double *demand = nullptr;              // of tasks; none where no limit follows it

  const std::vector<Group> &groups() const { return groups_; }

  void set_groups(std::vector<Group> groups) {
    memory.set_levels(groups.size());
    groups_ = std::move(groups);
  }

  // How long a command acts before the next one takes it back, at a time.
  double hold(const CycleTime &time) const { return time.mean + limits.limits.response; }

  // The motion of the joints, as their limits see it, after the cycle that left `before`.
  JointMotion motion(Arena &arena, const double *positions, CycleMemory &before,
                     double since, const CycleTime &time) const {
    const int n = solver.n();
    double *upwards = arena.zeros(n), *downwards = arena.zeros(n);
    for (int i = 0; i < delay; ++i) add_pending(before.pending(i), n, upwards, downwards);
    return {positions, before.velocity(), since, time.longest_hold(period), delay, upwards,
            downwards, before.acceleration(), before.before(), nullptr, before.demand(), 0.0};
  }

  // Compute the cycle at positions where the robot is; `measured`: time since the last command.
  // False where the reference has to.
  bool run(const Situation &at, double measured) {
    if (!evaluate(at)) return false;
    CycleTime time = memory.time();
    elapsed = time.advance(
        std::isnan(memory.commanded()) ? (measured > 0.0 && measured < period ? measured : period)
            : std::isnan(measured) ? at.now - memory.commanded() : measured, period);
    std::copy(memory.damping(), memory.damping() + groups_.size(),
              std::back_inserter(solver.memory));
    levels = solver.levels;
    solve_within(at.positions, time);
    Escape escape = memory.escape();
    if (escape.is_due(solver.arena, solver.levels, solver.x, solver.n(), time.now)) return false;
    memory.commanded() = at.now;
    memory.put(time);
    memory.put(escape);
    memory.command(solver.x, std::min(elapsed, period));
    if (demand) std::copy(demand, demand + solver.n(), memory.demand());
    else std::fill_n(memory.demand(), solver.n(), std::nan(""));
    std::copy(solver.memory.begin(), solver.memory.end(), memory.damping());
    return true;
  }

 private:
  bool evaluate(const Situation &at) {
    size_t next = 0;
    evaluations.clear();
    for (const Group &group : groups_)
      if (group.size() == 1 && !group[0]) solver.levels.push_back(given[next++]);
      else if (!join(solver.arena, at, group, given, next, solver.levels, evaluations)) return false;
    return true;
  }

  // Solve the levels within the bounds at positions.
  void solve_within(const double *positions, const CycleTime &time) {
    lower = solver.arena.take(solver.n());
    upper = solver.arena.take(solver.n());
    JointMotion its = motion(solver.arena, positions, memory, elapsed, time);
    limits.standing(its, standing_);
    for (Level &level : solver.levels) leave_out(solver.arena, standing_, level);
    demand = nullptr;
    std::vector<double> lasting;
    if (limits.limits.follow_demand()) {
      // First without transient limits: these follow what the tasks demand.
      const std::vector<Level> levels = solver.levels;
      const std::vector<double> remembered = solver.memory;
      limits.box(its, true, lower, upper);
      solve(time);
      limits.limits.jerk.follow(its, demand = solver.x);
      limits.box(its, false, lower, upper);
      if (!solver.looped && is_within(demand)) return;
      lasting = solver.memory;
      solver.clear();
      solver.levels = levels;
      solver.memory = remembered;
    } else {
      limits.box(its, false, lower, upper);
    }
    solve(time);
    // Multipliers of a limit that follows the demand do not last.
    if (demand) solver.memory = lasting;
  }

  bool is_within(const double *x) const {
    for (int j = 0; j < solver.n(); ++j)
      if (!(x[j] >= lower[j] && x[j] <= upper[j])) return false;
    return true;
  }

  void solve(const CycleTime &time) {
    solver.solve(lower, upper, hold(time), cap.empty() ? nullptr : cap.data());
  }

  std::vector<Group> groups_;
  std::vector<int> standing_;
};

}  // namespace
