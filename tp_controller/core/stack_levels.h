// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Levels of groups of tasks.
// Reference: tp_controller/tasks/stack.py

#pragma once

#include "level.h"
#include "task.h"

namespace {

// The tasks of a level; none for one that Python evaluates.
using Group = std::vector<Task *>;

inline size_t copy_rows(const Level &from, double *J, double *v, double *most) {
  if (from.is_identity)
    for (int i = 0; i < from.n; ++i)
      for (int j = 0; j < from.n; ++j) J[size_t(i) * from.n + j] = i == j ? 1.0 : 0.0;
  else
    std::copy(from.J, from.J + size_t(from.m) * from.n, J);
  const double *least = from.bounded ? from.lower : from.v;
  std::copy(least, least + from.m, v);
  if (from.bounded) std::copy(from.upper, from.upper + from.m, most);
  return size_t(from.m);
}

// The weights of the rows, m in all, of a group; none where no task has any.
inline const double *weights_of(Arena &arena, const Group &group, const std::vector<Level> &given,
                                size_t next, size_t m) {
  double *weights = nullptr;
  size_t at = 0;
  for (const Task *task : group) {
    const Level *other = task ? nullptr : &given[next++];
    const double *its = task ? task->weights() : other->weights;
    const size_t rows = size_t(task ? task->rows() : other->m);
    if (its && !weights) std::fill_n(weights = arena.take(m), m, 1.0);
    if (its) std::copy(its, its + rows, weights + at);
    at += rows;
  }
  return weights;
}

// Add the level of a group, the rows of its tasks one below the other, and the evaluations of its
// tasks; `given`, from `next` on: levels of tasks that Python evaluates. False where the reference
// has to.
bool join(Arena &arena, const Situation &at, const Group &group, const std::vector<Level> &given,
          size_t &next, std::vector<Level> &levels, std::vector<Rows> &evaluations) {
  const int n = at.motion->n;
  const size_t begin = next;
  size_t m = 0, most_rows = 0, one = next;
  for (const Task *task : group) most_rows += size_t(task ? task->most_rows() : given[one++].m);
  const Task *first = group[0];
  const Level *other = first ? nullptr : &given[next];
  const bool bounded = first ? first->bounded() : other->bounded;
  const bool identity = group.size() == 1 && first->is_identity();
  double *J = identity ? nullptr : arena.take(most_rows * n), *error = arena.take(most_rows);
  double *v = arena.take(most_rows), *most = bounded ? arena.take(most_rows) : nullptr;
  Level level = {0, n, bounded, first ? first->scale() : other->scale, identity, J,
                 bounded ? nullptr : v, bounded ? v : nullptr, most,
                 first ? first->joints() : other->joints, nullptr};
  for (Task *task : group) {
    size_t rows;
    if (task) {
      const Rows out = {error, J, v, v, most};
      if (!task->evaluate(at, out)) return false;
      evaluations.push_back(out);
      rows = size_t(task->rows());
    } else {
      rows = copy_rows(given[next++], J, v, most);
    }
    if (J) J += rows * n;
    error += rows;
    v += rows;
    if (most) most += rows;
    m += rows;
  }
  level.m = int(m);
  level.weights = weights_of(arena, group, given, begin, m);
  levels.push_back(level);
  return true;
}

}  // namespace
