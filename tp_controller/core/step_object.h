// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// `Step` as Python has it: a stack of tasks, and its cycles as rows of numbers.
// Reference: tp_controller/control/compiled_step.py

#pragma once

#include "causes_object.h"
#include "task_object.h"

namespace {

// A cycle of a stack, and the tasks that Python holds.
struct StackCycle {
  std::unique_ptr<ControlCycle> cycle;
  std::unique_ptr<CauseSearch> search;
  std::vector<PyObject *> held;
  size_t frames = 0;                     // of the robot whose tasks they are
  WithoutPython::Clock::duration cycle_took{}, search_took{};

  StackCycle() = default;
  StackCycle(StackCycle &&) = default;
  ~StackCycle() { for (PyObject *each : held) Py_DECREF(each); }
};

// ((Task or None, …), …), all of this robot; false where they are not.
bool read_groups(PyObject *object, const Motion &motion, std::vector<Group> &groups,
                 std::vector<PyObject *> &held) {
  for (Py_ssize_t l = 0; l < PyTuple_Size(object); ++l) {
    PyObject *group = PyTuple_GetItem(object, l);
    if (!PyTuple_Check(group) || PyTuple_Size(group) < 1) return false;
    groups.emplace_back();
    for (Py_ssize_t i = 0; i < PyTuple_Size(group); ++i) {
      PyObject *each = PyTuple_GetItem(group, i);
      TaskTwin *twin = find<TaskTwin>(each);
      if (each != Py_None && !(twin && fits(*twin->task, motion))) return false;
      groups.back().push_back(twin ? twin->task.get() : nullptr);
      if (twin) held.push_back(Py_NewRef(each));
    }
    const Task *first = nullptr;
    for (const Task *task : groups.back()) {
      if (!first) first = task;
      if (task && task->bounded() != first->bounded()) return false;
    }
  }
  return true;
}

// Step(solver, limits, cap or None, period, delay)
PyObject *make_step(PyTypeObject *type, PyObject *given, PyObject *) {
  PyObject *solver, *limits, *cap;
  double period;
  int delay;
  if (!PyArg_ParseTuple(given, "O!O!Odi", TYPE_OF<Solver>, &solver, TYPE_OF<Limits>, &limits, &cap,
                        &period, &delay))
    return nullptr;
  try {
    const Options &options = of<Solver>(solver).options();
    std::vector<double> capped;
    StackCycle its;
    if (delay >= 0 && delay <= MOST && of<Limits>(limits).size() == options.n
        && (cap == Py_None || (read_all(cap, capped) && capped.size() == size_t(options.n)))) {
      its.cycle.reset(new ControlCycle(options, of<Limits>(limits), std::move(capped), period,
                                       delay));
      its.search.reset(new CauseSearch(options));
      return keep<StackCycle>(type, std::move(its));
    }
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return refuse("solver, limits and cap do not fit together");
}

// set_tasks(motion, ((Task or None, …), …)): ValueError, and nothing has changed, where they are
// not of this robot.
PyObject *step_set_tasks(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  StackCycle &its = of<StackCycle>(self);
  const Motion *motion = count == 2 ? find<Motion>(given[0]) : nullptr;
  if (!motion || motion->n != its.cycle->solver.n() || !PyTuple_Check(given[1])
      || its.cycle->solver.busy) return refuse("set_tasks(motion, tasks)");
  try {
    StackCycle others;
    std::vector<Group> groups;
    if (!read_groups(given[1], *motion, groups, others.held))
      return refuse("the tasks are not those of this robot");
    its.cycle->set_groups(std::move(groups));
    its.frames = motion->frames.size();
    std::swap(its.held, others.held);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return Py_NewRef(Py_None);
}

// Whether a group with several tasks has bounds.
bool is_bounded(const Group &group, size_t first, const ControlCycle &cycle) {
  for (const Task *task : group)
    if (task) return task->bounded();
  return cycle.given[first].bounded;
}

// Read what a cycle gets from Python.
void read_cycle(ControlCycle &cycle, PyObject *memory, PyObject *levels) {
  char *numbers;
  Py_ssize_t size;
  const Py_ssize_t needed = Py_ssize_t(cycle.memory.size() * sizeof(double));
  need(PyBytes_Check(memory) && PyBytes_AsStringAndSize(memory, &numbers, &size) == 0
       && size >= needed && PyTuple_Check(levels));
  std::memcpy(cycle.memory.data(), numbers, size_t(needed));
  cycle.given.clear();
  for (Py_ssize_t l = 0; l < PyTuple_Size(levels); ++l)
    cycle.given.push_back(read_level(cycle.solver.arena, PyTuple_GetItem(levels, l),
                                     cycle.solver.n()));
  size_t next = 0;
  for (const Group &group : cycle.groups()) {
    const size_t first = next;
    for (Task *task : group)
      if (task) task->begin();
      else need(next++ < cycle.given.size());
    // Either all tasks of a level have bounds or none has.
    for (size_t l = first; l < next; ++l)
      need(cycle.given[l].bounded == is_bounded(group, first, cycle));
  }
  need(next == cycle.given.size());
}

// Call with the numbers of each level: how many tasks, whether it has bounds, is scaled, has a mask,
// has weights; the mask; rows of each task, and whether its J is the identity; J, unless it is the
// identity; v, or bounds; the weights. Then of each task that has a twin: its rows, whether these have
// keys; the error, and the keys.
template <typename Put>
void put_levels(const ControlCycle &cycle, Put put) {
  auto level = cycle.levels.begin();
  auto given = cycle.given.begin();
  for (const Group &group : cycle.groups()) {
    const double head[5] = {double(group.size()), double(level->bounded), double(level->scale),
                            double(level->joints != nullptr), double(level->weights != nullptr)};
    put(head, 5);
    if (level->joints) put(level->joints, size_t(level->n));
    for (const Task *task : group) {
      const double its[2] = {double(task ? task->rows() : given->m),
                             double(task ? task->is_identity() : given->is_identity)};
      put(its, 2);
      if (!task) ++given;
    }
    const size_t m = size_t(level->m);
    if (!level->is_identity) put(level->J, m * level->n);
    put(level->bounded ? level->lower : level->v, m);
    if (level->bounded) put(level->upper, m);
    if (level->weights) put(level->weights, m);
    ++level;
  }
}

template <typename Put>
void put_errors(const ControlCycle &cycle, Put put) {
  auto evaluation = cycle.evaluations.begin();
  for (const Group &group : cycle.groups())
    for (const Task *task : group) {
      if (!task) continue;
      const double its[2] = {double(task->rows()), double(task->keys() != nullptr)};
      put(its, 2);
      put((evaluation++)->error, size_t(task->rows()));
      if (task->keys()) put(task->keys()->data(), size_t(task->rows()));
    }
}

// One cycle as a row of doubles, which `CycleRecord` of the reference reads: memory, factor of
// uniform scaling, whether there are steps, time since the last command, where errors and steps
// begin, positions, bounds of the joints, demand where limits follow it, levels, errors, and the steps of the solver.
PyObject *write_cycle(ControlCycle &cycle, const double *positions) {
  Solver &solver = cycle.solver;
  const size_t n = size_t(solver.n());
  Record steps(solver);
  size_t size = cycle.memory.size() + CYCLE_HEAD + (cycle.demand ? 4 : 3) * n;
  const auto count = [&size](const double *, size_t more) { size += more; };
  put_levels(cycle, count);
  const double errors_at = double(size);
  put_errors(cycle, count);
  const double head[CYCLE_HEAD] = {solver.slowed, solver.looped ? 1.0 : 0.0, cycle.elapsed,
                                   errors_at, double(size)};
  if (solver.looped) size += steps.size();
  PyObject *bytes = PyBytes_FromStringAndSize(nullptr, Py_ssize_t(size * sizeof(double)));
  if (!bytes) return nullptr;
  char *at = PyBytes_AsString(bytes);
  const auto put = [&at](const double *from, size_t numbers) {
    if (numbers) std::memcpy(at, from, numbers * sizeof(double));
    at += numbers * sizeof(double);
  };
  put(cycle.memory.data(), cycle.memory.size());
  put(head, CYCLE_HEAD);
  put(positions, n);
  put(cycle.lower, n);
  put(cycle.upper, n);
  if (cycle.demand) put(cycle.demand, n);
  put_levels(cycle, put);
  put_errors(cycle, put);
  if (solver.looped) steps.write(at);
  return bytes;
}

// run(memory, motion, moved, positions, now, elapsed, levels, velocity): fill in the velocity (n,)
// and return the record of the cycle; None where the reference is needed. `moved`: the motion is at
// these positions; `elapsed`: None for the time since the last command; `levels`: those of
// the tasks that are None, in order.
PyObject *step_run(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 8)
    return refuse("run(memory, motion, moved, positions, now, elapsed, levels, velocity)");
  StackCycle &its = of<StackCycle>(self);
  ControlCycle &cycle = *its.cycle;
  Solver &solver = cycle.solver;
  Motion *motion = find<Motion>(given[1]);
  try {
    need(motion && motion->n == solver.n() && motion->frames.size() == its.frames);
    const Running running(solver);
    read_cycle(cycle, given[0], given[6]);
    const bool moved = is_true(given[2]);
    double *positions = solver.arena.take(size_t(solver.n()));
    need(read(given[3], solver.n(), LARGEST, positions));
    const double now = number(given[4]);
    const double elapsed = given[5] == Py_None ? NAN : PyFloat_AsDouble(given[5]);
    const Buffer velocity(given[7], PyBUF_STRIDES | PyBUF_FORMAT | PyBUF_WRITABLE);
    need(velocity.is(solver.n()) && !PyErr_Occurred()
         && (moved || (motion->base.empty() && motion->columns() == solver.n())));
    {
      const WithoutPython meanwhile(its.cycle_took);
      if (!moved) {
        std::copy(positions, positions + solver.n(), motion->q().data() + motion->first_row);
        motion->move(nullptr);
      }
      need(cycle.run({motion, positions, cycle.memory.velocity(), now}, elapsed));
    }
    PyObject *record = write_cycle(cycle, positions);
    if (!record) return nullptr;
    velocity.fill(solver.x);
    for (const Group &group : cycle.groups())
      for (const Task *task : group)
        if (task) task->keep();
    return record;
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  PyErr_Clear();
  return Py_NewRef(Py_None);
}

// Call with the causes in a cycle, from its record and that of the cycle before, and the number of its
// tasks.
template <typename Use>
void search_causes(StackCycle &its, PyObject *const *given, Use use) {
  CauseSearch &search = *its.search;
  const Running running(search.solver);
  RecordReader record(search.solver.arena, given[0]), before(search.solver.arena, given[1]);
  const size_t levels = its.cycle->groups().size();
  const WithoutPython meanwhile(its.search_took);
  search.in_cycle(*its.cycle, levels, record, before, use);
}

// causes(record, before, least): (kind, index, share) of the causes of each task in a cycle; None
// where the reference is needed. `least`: residuals (t,) up to which tasks are not limited.
PyObject *step_causes(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 3) return refuse("causes(record, before, least)");
  try {
    std::vector<double> least;
    std::vector<std::vector<Cause>> found;
    need(read_all(given[2], least));
    search_causes(of<StackCycle>(self), given, [&](Causes &causes, size_t tasks) {
      need(least.size() == tasks);
      for (size_t task = 0; task < tasks; ++task)
        found.push_back(causes.of(task, least[task]));
    });
    return as_tuples(found);
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  PyErr_Clear();
  return Py_NewRef(Py_None);
}

// combined_causes(record, before, task): (kind, index) of the tasks and limits that block a task, by
// its index, together; None where the reference is needed.
PyObject *step_combined_causes(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 3) return refuse("combined_causes(record, before, task)");
  try {
    std::vector<std::pair<int, int>> found;
    const Py_ssize_t task = PyLong_AsSsize_t(given[2]);
    need(!PyErr_Occurred());
    search_causes(of<StackCycle>(self), given, [&](Causes &causes, size_t tasks) {
      need(task >= 0 && size_t(task) < tasks);
      for (const Removable &each : causes.combined(size_t(task)))
        found.push_back({causes.kind_of(each), causes.index_of(each)});
    });
    return as_pairs(found);
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  PyErr_Clear();
  return Py_NewRef(Py_None);
}

PyMethodDef STEP_METHODS[] = {
    method("set_tasks", step_set_tasks, "Set the tasks of each level."),
    method("run", step_run, "Compute one cycle."),
    method("causes", step_causes, "Find the causes that limit the tasks of a cycle."),
    method("combined_causes", step_combined_causes, "Find the causes that block a task together."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
