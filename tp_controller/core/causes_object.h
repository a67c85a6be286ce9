// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The search for causes as Python has it: the record of a cycle in, causes of its tasks out.
// Reference: tp_controller/control/cycle_record.py

#pragma once

#include "causes.h"
#include "solver_object.h"
#include "step.h"

namespace {

// Numbers between the memory and the arrays of a cycle.
constexpr size_t CYCLE_HEAD = 5;
// More rows of a level than any has.
constexpr int MOST_ROWS = 1 << 20;

// Reads a record from its begin to its end; `Unsolved` where it is none.
class RecordReader {
 public:
  RecordReader(Arena &arena, PyObject *record) {
    char *bytes;
    Py_ssize_t size;
    need(PyBytes_Check(record) && PyBytes_AsStringAndSize(record, &bytes, &size) == 0);
    left_ = size_t(size) / sizeof(double);
    at_ = arena.take(left_);
    std::memcpy(at_, bytes, left_ * sizeof(double));
  }

  double *take(size_t count) {
    need(count <= left_);
    double *found = at_;
    at_ += count;
    left_ -= count;
    return found;
  }

  int count(double number) const {
    int found;
    need(whole(number, 0, MOST_ROWS, found));
    return found;
  }

  // The next step, as `Record` writes it.
  Step step(const Level &level) {
    const double *head = take(9);
    const int n = level.n, rank = count(head[1]);
    Step found;
    Directions &its = found.directions;
    its.m = level.bounded ? 0 : level.m;
    its.rank = rank;
    its.size = head[7];
    its.Q = {nullptr, n, count(head[2])};
    need(rank <= std::min(its.m, its.Q.k) && its.Q.k <= n);
    found.level = &level;
    found.is_relaxed = head[3] >= 0.0;
    found.bend = head[8];
    found.velocity = take(n);
    its.U = take(size_t(its.m) * rank);
    its.s = take(rank);
    its.Q.p = take(size_t(n) * its.Q.k);
    found.followed = take(rank);
    if (found.is_relaxed) found.relaxed = {take(size_t(n) * count(head[3])), n, count(head[3])};
    if (head[4] != 0.0) found.multipliers = take(n);
    if (head[5] >= 0.0) found.row_multipliers = take(found.rows = count(head[5]));
    if (head[6] != 0.0) found.origin = take(n);
    return found;
  }

  // The next level, and its tasks.
  void level(int n, SolvedCycle &cycle) {
    const double *head = take(5);
    const int tasks = count(head[0]);
    need(tasks > 0);
    Level its = {0, n, head[1] != 0.0, head[2] != 0.0, false, nullptr, nullptr, nullptr, nullptr};
    if (head[3] != 0.0) its.joints = take(n);
    for (int i = 0; i < tasks; ++i) {
      const double *part = take(2);
      cycle.parts.push_back({cycle.levels.size(), its.m, count(part[0]), part[1] != 0.0});
      its.m += count(part[0]);
      need(its.m <= MOST_ROWS && (part[1] == 0.0 || (part[0] == n && !its.bounded)));
    }
    its.is_identity = tasks == 1 && cycle.parts.back().is_identity;
    if (!its.is_identity) its.J = take(size_t(its.m) * n);
    (its.bounded ? its.lower : its.v) = take(its.m);
    if (its.bounded) its.upper = take(its.m);
    if (head[4] != 0.0) its.weights = take(its.m);
    cycle.levels.push_back(its);
  }

 private:
  double *at_;
  size_t left_;
};

// A solver with its options, but for damping.
Options without_damping(Options options) {
  options.damping.damping = 0.0;
  return options;
}

// The search for causes in cycles of a stack.
struct CauseSearch {
  explicit CauseSearch(const Options &options)
      : solver(options), undamped(without_damping(options)) {}

  Solver solver, undamped;

  // Call with the causes in a cycle that `kind` computed, and the number of its tasks.
  template <typename Use>
  void in_cycle(const ControlCycle &kind, size_t levels, RecordReader &record,
                RecordReader &before, Use use) {
    const int n = solver.n();
    CycleMemory memory(n, kind.delay), after(n, kind.delay);
    for (CycleMemory *each : {&memory, &after}) {
      each->set_levels(levels);
      const double *numbers = (each == &memory ? before : record).take(each->size());
      std::copy(numbers, numbers + each->size(), each->data());
    }
    const double *head = record.take(CYCLE_HEAD), *positions = record.take(n);
    SolvedCycle cycle;
    cycle.motion = kind.motion(solver.arena, positions, memory, head[2], after.time());
    cycle.gain = kind.limits.limits.position.gain_of(cycle.motion);
    cycle.hold = kind.hold(after.time());
    cycle.slowed = head[0];
    cycle.x = cycle.whole = after.velocity();
    // Bounds, transient ones among them, and the demand that they follow.
    record.take(size_t(kind.limits.limits.follow_demand() ? 3 : 2) * n);
    cycle.cap = kind.cap.empty() ? nullptr : kind.cap.data();
    cycle.memory.assign(memory.damping(), memory.damping() + levels);
    for (size_t l = 0; l < levels; ++l) record.level(n, cycle);
    cycle.whole_levels = cycle.levels;
    kind.limits.standing(cycle.motion, cycle.standing);
    for (Level &level : cycle.levels) leave_out(solver.arena, cycle.standing, level);
    record.take(record.count(head[4] - head[3]));
    if (head[1] != 0.0) {
      cycle.whole = record.take(n);
      record.take(2 * levels);
      for (const Level &level : cycle.levels) cycle.steps.push_back(record.step(level));
    }
    Variants variants(solver, undamped, kind.limits, cycle);
    Causes causes(solver.arena, variants, kind.limits, cycle);
    use(causes, cycle.parts.size());
  }
};

// A tuple of what `make` returns for each of some items.
template <typename Item, typename Make>
PyObject *tuple_of(const std::vector<Item> &items, Make make) {
  Held all(PyTuple_New(Py_ssize_t(items.size())));
  if (!all) return nullptr;
  for (size_t i = 0; i < items.size(); ++i) {
    PyObject *made = make(items[i]);
    if (!made || PyTuple_SetItem(all, Py_ssize_t(i), made) != 0) return nullptr;
  }
  return all.release();
}

// ((kind, index), …)
PyObject *as_pairs(const std::vector<std::pair<int, int>> &found) {
  return tuple_of(found, [](const std::pair<int, int> &each) {
    return Py_BuildValue("(ii)", each.first, each.second);
  });
}

// ((kind, index, share), …) of each task
PyObject *as_tuples(const std::vector<std::vector<Cause>> &found) {
  return tuple_of(found, [](const std::vector<Cause> &causes) {
    return tuple_of(causes, [](const Cause &each) {
      return Py_BuildValue("(iid)", each.kind, each.index, each.share);
    });
  });
}

}  // namespace
