// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// `Search` as Python has it.
// Reference: tp_controller/positions/compiled.py

#pragma once

#include "choice.h"
#include "step_object.h"

namespace {

// A search takes long: other threads of Python run meanwhile.
constexpr std::chrono::seconds LONG{1};

// A search, the tasks that Python holds, and the motion that they move.
struct PositionSearch {
  std::unique_ptr<Search> search;
  std::unique_ptr<Choice> choice;
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

// Search(lower, upper, turning, nudges): limits of the positions (n,), 1 for joints that turn, 0 for
// others (n,), and changes of the positions (N, n).
PyObject *make_search(PyTypeObject *type, PyObject *given, PyObject *) {
  PyObject *low, *high, *turns, *nearby;
  if (!PyArg_ParseTuple(given, "OOOO", &low, &high, &turns, &nearby)) return nullptr;
  try {
    std::vector<double> lower, upper, turning, nudges;
    if (read_all(low, lower) && read_all(high, upper) && read_all(turns, turning)
        && !lower.empty() && lower.size() == upper.size() && lower.size() == turning.size()
        && read_rows(nearby, Py_ssize_t(lower.size()), nudges)) {
      PositionSearch its;
      its.search.reset(new Search(std::move(lower), std::move(upper), std::move(nudges)));
      its.choice.reset(new Choice(*its.search, std::move(turning)));
      return keep<PositionSearch>(type, std::move(its));
    }
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return refuse("needs as many lower as upper limits, and marks and nudges of them");
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

// Fill in the configurations (nq,) that were found, and the costs (L,) of their levels.
void answer(const Search &search, double *q, double *costs) {
  for (size_t i = 0; i < search.count; ++i) {
    q = std::copy(search.found[i].q.begin(), search.found[i].q.end(), q);
    costs = std::copy(search.found[i].costs.begin(), search.found[i].costs.end(), costs);
  }
}

// find(starts, needed, seconds, q, costs): descend from each of `starts` (count, nq) until as many
// configurations are found as `q` (wanted, nq) has rows; fill these in and the costs (wanted, L) of
// their levels, and return their number and that of the descents; None where the reference is needed.
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
    const Py_ssize_t wanted = q.rows(2);
    need(!PyErr_Occurred() && needed >= 0 && size_t(needed) <= levels && wanted > 0
         && q.is(wanted, Py_ssize_t(nq)) && costs.is(wanted, Py_ssize_t(levels)));
    {
      Descent::Clock::duration took = LONG;
      const WithoutPython meanwhile(took);
      search.find(starts.data(), starts.size() / nq, size_t(needed), size_t(wanted),
                  after(seconds));
    }
    answer(search, q.p(), costs.p());
    return Py_BuildValue("ni", Py_ssize_t(search.count), search.descents);
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
    answer(search, q.p(), costs.p());
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

// The largest error of the first levels, of tasks that are bounds or have goals; 0 where all are met.
double largest_error(const Search &search, size_t needed, const std::vector<GoalRows> &goals) {
  const Point &point = search.found[0];
  double largest = 0.0;
  for (size_t l = 0; l < needed && point.cost(0, needed) > MET; ++l) {
    const double *error = point.errors[l];
    for (const Task *task : search.tasks.groups()[l]) {
      const bool counts = task->bounded()
          || std::any_of(goals.begin(), goals.end(), [&](auto &its) { return its.task == task; });
      for (int i = 0; i < task->rows(); ++i, ++error)
        if (counts) largest = std::max(largest, std::fabs(*error));
    }
  }
  return largest;
}

// find_each(goals, starts, others, needed, wanted, seconds, q, numbers): search for each row of the
// goals of tasks: descend from its start, then from `others` (O, nq) until `wanted` configurations
// are found; fill in the nearest of these (count, nq), and the number of the descents and the largest
// error (count, 2); no descents where the reference is needed; false where it is for all. `starts`
// (1 or count, nq); `seconds` for each.
PyObject *search_find_each(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 8 || !PyTuple_Check(given[0]))
    return refuse("find_each(goals, starts, others, needed, wanted, seconds, q, numbers)");
  PositionSearch &its = of<PositionSearch>(self);
  Search &search = *its.search;
  try {
    const Searching running(its);
    const size_t nq = search.tasks.nq(), levels = search.tasks.groups().size();
    std::vector<GoalRows> goals;
    std::vector<double> starts, others;
    need(read_goals(given[0], search.tasks.groups(), goals)
         && read_rows(given[1], Py_ssize_t(nq), starts)
         && read_rows(given[2], Py_ssize_t(nq), others)
         && finite(starts.data(), int(starts.size()))
         && finite(others.data(), int(others.size())));
    const Py_ssize_t needed = PyLong_AsSsize_t(given[3]), wanted = PyLong_AsSsize_t(given[4]);
    const double seconds = PyFloat_AsDouble(given[5]);
    const Output q(given[6]), numbers(given[7]);
    const size_t rows = goals[0].numbers.size() / goals[0].size;
    for (const GoalRows &each : goals) need(each.numbers.size() == rows * each.size);
    need(!PyErr_Occurred() && needed >= 0 && size_t(needed) <= levels && wanted > 0
         && (starts.size() == nq || starts.size() == rows * nq)
         && q.is(Py_ssize_t(rows), Py_ssize_t(nq)) && numbers.is(Py_ssize_t(rows), 2));
    Descent::Clock::duration took = LONG;
    const WithoutPython meanwhile(took);
    for (size_t i = 0; i < rows; ++i) {
      for (const GoalRows &each : goals)
        need(each.task->set_goal(each.numbers.data() + i * each.size, each.size));
      const double *const start = starts.data() + (starts.size() == nq ? 0 : i * nq);
      double *const its_numbers = numbers.p() + 2 * i;
      try {
        search.find(start, others, size_t(needed), size_t(wanted), after(seconds));
        its.choice->nearest(start);
        std::copy(search.found[0].q.begin(), search.found[0].q.end(), q.p() + i * nq);
        its_numbers[0] = double(search.descents);
        its_numbers[1] = largest_error(search, size_t(needed), goals);
      } catch (const Unsolved &) {
        its_numbers[0] = its_numbers[1] = 0.0;
      }
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
