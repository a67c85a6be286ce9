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

// `Search` as Python has it.
// Reference: tp_controller/positions/compiled.py

#pragma once

#include "search.h"
#include "step_object.h"

namespace {

// A search takes long: other threads of Python run meanwhile.
constexpr std::chrono::seconds LONG{1};

// A search, the tasks that Python holds, and the motion that they move.
struct PositionSearch {
  std::unique_ptr<Search> search;
  std::vector<PyObject *> held;
  bool busy = false;

  PositionSearch() = default;
  PositionSearch(PositionSearch &&) = default;
  ~PositionSearch() { for (PyObject *each : held) Py_DECREF(each); }
};

// Whether the coordinates of the base are those that `PositionStack` knows.
bool has_coordinates(const Motion &motion) {
  return motion.base.empty() ? motion.first_row == 0
                             : motion.first_row == 3 || motion.first_row == 7;
}

// Search(lower, upper)
PyObject *make_search(PyTypeObject *type, PyObject *given, PyObject *) {
  PyObject *low, *high;
  if (!PyArg_ParseTuple(given, "OO", &low, &high)) return nullptr;
  try {
    std::vector<double> lower, upper;
    if (read_all(low, lower) && read_all(high, upper) && !lower.empty()
        && lower.size() == upper.size()) {
      PositionSearch its;
      its.search.reset(new Search(std::move(lower), std::move(upper)));
      return keep<PositionSearch>(type, std::move(its));
    }
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return refuse("needs as many lower as upper limits");
}

// set_tasks(motion, ((Task, …), …)): ValueError, and nothing has changed, where they are not of this
// robot.
PyObject *search_set_tasks(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  PositionSearch &its = of<PositionSearch>(self);
  Motion *motion = count == 2 ? find<Motion>(given[0]) : nullptr;
  if (!motion || size_t(motion->n) != its.search->tasks.n() || !PyTuple_Check(given[1])
      || its.busy || !has_coordinates(*motion))
    return refuse("set_tasks(motion, tasks)");
  try {
    PositionSearch others;
    std::vector<Group> groups;
    bool fit = read_groups(given[1], *motion, groups, others.held);
    for (const Group &group : groups) fit = fit && !std::count(group.begin(), group.end(), nullptr);
    if (!fit || groups.empty()) return refuse("the tasks are not those of this robot");
    others.held.push_back(Py_NewRef(given[0]));
    its.search->tasks.set_tasks(*motion, std::move(groups));
    std::swap(its.held, others.held);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return Py_NewRef(Py_None);
}

// A search that is running; a nested one goes to the reference.
class Searching {
 public:
  explicit Searching(PositionSearch &its) : its_(its) {
    need(!its.busy && !its.search->tasks.groups().empty());
    its_.busy = true;
  }
  Searching(const Searching &) = delete;
  ~Searching() { its_.busy = false; }

 private:
  PositionSearch &its_;
};

// Fill in the best configuration (nq,) and the costs (L,) of its levels.
void answer(const Search &search, const Output &q, const Output &costs) {
  std::copy(search.best.q.begin(), search.best.q.end(), q.p());
  std::copy(search.best.costs.begin(), search.best.costs.end(), costs.p());
}

// find(starts, needed, seconds, q, costs): fill in the best configuration (nq,) and the costs (L,) of
// its levels, and return the number of descents, each from one of `starts` (count, nq); None where the
// reference is needed.
PyObject *search_find(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 5) return refuse("find(starts, needed, seconds, q, costs)");
  PositionSearch &its = of<PositionSearch>(self);
  Search &search = *its.search;
  try {
    const Searching running(its);
    const size_t nq = search.tasks.nq(), levels = search.tasks.groups().size();
    std::vector<double> starts;
    need(read_rows(given[0], Py_ssize_t(nq), starts) && !starts.empty()
         && finite(starts.data(), int(starts.size())));
    const Py_ssize_t needed = PyLong_AsSsize_t(given[1]);
    const double seconds = PyFloat_AsDouble(given[2]);
    const Output q(given[3]), costs(given[4]);
    need(!PyErr_Occurred() && needed >= 0 && size_t(needed) <= levels
         && q.is(Py_ssize_t(nq)) && costs.is(Py_ssize_t(levels)));
    int descents;
    {
      Descent::Clock::duration took = LONG;
      const WithoutPython meanwhile(took);
      descents = search.find(starts.data(), starts.size() / nq, size_t(needed), after(seconds));
    }
    answer(search, q, costs);
    return PyLong_FromLong(descents);
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  PyErr_Clear();
  return Py_NewRef(Py_None);
}

// finish(seconds, q, costs): reduce all levels in turn at the configuration in q (nq,), and fill in
// the one that is found and its costs (L,); false where the reference is needed.
PyObject *search_finish(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 3) return refuse("finish(seconds, q, costs)");
  PositionSearch &its = of<PositionSearch>(self);
  Search &search = *its.search;
  try {
    const Searching running(its);
    const size_t nq = search.tasks.nq();
    const double seconds = PyFloat_AsDouble(given[0]);
    const Output q(given[1]), costs(given[2]);
    need(!PyErr_Occurred() && q.is(Py_ssize_t(nq)) && finite(q.p(), int(nq))
         && costs.is(Py_ssize_t(search.tasks.groups().size())));
    {
      Descent::Clock::duration took = LONG;
      const WithoutPython meanwhile(took);
      search.finish(q.p(), after(seconds));
    }
    answer(search, q, costs);
    return Py_NewRef(Py_True);
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  PyErr_Clear();
  return Py_NewRef(Py_False);
}

// Tasks with a goal of each search: (level, index in it, goals (count, size)).
struct GoalRows {
  Task *task;
  std::vector<double> numbers;
  size_t size;
};

bool read_goals(PyObject *object, const std::vector<Group> &groups, std::vector<GoalRows> &found) {
  for (Py_ssize_t i = 0; i < PyTuple_Size(object); ++i) {
    int level, index;
    PyObject *rows;
    if (!PyArg_ParseTuple(PyTuple_GetItem(object, i), "iiO", &level, &index, &rows) || level < 0
        || index < 0 || size_t(level) >= groups.size() || size_t(index) >= groups[level].size())
      return false;
    GoalRows its = {groups[level][index], {}, 0};
    const Buffer buffer(rows);
    if (buffer.rows(2) < 1) return false;
    its.size = size_t(buffer.columns());
    if (!read_rows(rows, Py_ssize_t(its.size), its.numbers)
        || !finite(its.numbers.data(), int(its.numbers.size()))) return false;
    found.push_back(std::move(its));
  }
  return !found.empty();
}

// find_each(goals, starts, needed, seconds, q, costs): descend once for each row of the goals of
// tasks, and fill in the configurations (count, nq) and the costs (count, L); false where the
// reference is needed. `starts` (1 or count, nq); `seconds` for each.
PyObject *search_find_each(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 6 || !PyTuple_Check(given[0]))
    return refuse("find_each(goals, starts, needed, seconds, q, costs)");
  PositionSearch &its = of<PositionSearch>(self);
  Search &search = *its.search;
  try {
    const Searching running(its);
    const size_t nq = search.tasks.nq(), levels = search.tasks.groups().size();
    std::vector<GoalRows> goals;
    std::vector<double> starts;
    need(read_goals(given[0], search.tasks.groups(), goals)
         && read_rows(given[1], Py_ssize_t(nq), starts)
         && finite(starts.data(), int(starts.size())));
    const Py_ssize_t needed = PyLong_AsSsize_t(given[2]);
    const double seconds = PyFloat_AsDouble(given[3]);
    const Output q(given[4]), costs(given[5]);
    const size_t rows = goals[0].numbers.size() / goals[0].size;
    for (const GoalRows &each : goals) need(each.numbers.size() == rows * each.size);
    need(!PyErr_Occurred() && needed >= 0 && size_t(needed) <= levels
         && (starts.size() == nq || starts.size() == rows * nq)
         && q.is(Py_ssize_t(rows), Py_ssize_t(nq)) && costs.is(Py_ssize_t(rows), Py_ssize_t(levels)));
    Descent::Clock::duration took = LONG;
    const WithoutPython meanwhile(took);
    for (size_t i = 0; i < rows; ++i) {
      for (const GoalRows &each : goals)
        need(each.task->set_goal(each.numbers.data() + i * each.size, each.size));
      search.find_once(starts.data() + (starts.size() == nq ? 0 : i * nq), size_t(needed), seconds);
      std::copy(search.best.q.begin(), search.best.q.end(), q.p() + i * nq);
      std::copy(search.best.costs.begin(), search.best.costs.end(), costs.p() + i * levels);
    }
  } catch (const Unsolved &) {
    PyErr_Clear();
    return Py_NewRef(Py_False);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return Py_NewRef(Py_True);
}

PyMethodDef SEARCH_METHODS[] = {
    method("set_tasks", search_set_tasks, "Set the tasks of each level."),
    method("finish", search_finish, "Reduce all levels at a configuration in turn."),
    method("find_each", search_find_each, "Descend once for each of many goals."),
    method("find", search_find, "Find the configuration at which the tasks are met best."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
