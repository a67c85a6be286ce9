// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// `Solver` as Python has it: levels are read from Python objects, steps written as one row of
// doubles (`Record` in the reference).
// Reference: tp_controller/solver/compiled.py

#pragma once

#include "python_buffers.h"
#include "solve.h"

namespace {

// Names of the attributes of a `Level`.
PyObject *J_NAME, *V_NAME, *MODE_NAME, *LOWER_NAME, *UPPER_NAME, *IDENTITY_NAME, *JOINTS_NAME,
    *WEIGHTS_NAME;

void need(bool fine) {
  if (!fine) throw Unsolved();
}

bool finite(const double *values, int count) {
  double sum = 0.0;
  for (int i = 0; i < count; ++i) sum += 0.0 * values[i];
  return sum == 0.0;
}

const double *read(Arena &arena, PyObject *object, int size) {
  const Buffer buffer(object);
  need(buffer.is(size));
  double *found = arena.take(size);
  buffer.copy(found);
  return found;
}

bool is_true(PyObject *object) {
  const int found = PyObject_IsTrue(object);
  if (found < 0) PyErr_Clear();
  need(found >= 0);
  return found == 1;
}

double number(PyObject *object) {
  const double found = PyFloat_AsDouble(object);
  if (found == -1.0 && PyErr_Occurred()) {
    PyErr_Clear();
    throw Unsolved();
  }
  need(std::isfinite(found));
  return found;
}

void read_bounds(Arena &arena, PyObject *low, PyObject *high, int size, const double *&lower,
                 const double *&upper) {
  lower = read(arena, low, size);
  upper = read(arena, high, size);
  for (int i = 0; i < size; ++i)
    need(lower[i] <= upper[i] && lower[i] < INF && upper[i] > -INF);
}

Level read_level(Arena &arena, PyObject *object, int n) {
  const Held J(PyObject_GetAttr(object, J_NAME)), v(PyObject_GetAttr(object, V_NAME));
  const Held mode(PyObject_GetAttr(object, MODE_NAME));
  const Held identity(PyObject_GetAttr(object, IDENTITY_NAME));
  const Held joints(PyObject_GetAttr(object, JOINTS_NAME));
  const Held weights(PyObject_GetAttr(object, WEIGHTS_NAME));
  if (!J || !v || !mode || !identity || !joints || !weights) {
    PyErr_Clear();
    throw Unsolved();
  }
  need(PyUnicode_Check(mode));
  Level level = {0, n, v == Py_None, false, false, nullptr, nullptr, nullptr, nullptr};
  level.scale = PyUnicode_CompareWithASCIIString(mode, "scale") == 0;
  level.is_identity = is_true(identity);
  if (joints != Py_None) {
    double *mask = arena.take(n);
    need(read_mask(joints, n, mask));
    level.joints = mask;
  }
  {
    const Buffer buffer(J);
    need(buffer.rows(2) >= 0);
    level.m = int(buffer.rows(2));
    need(buffer.is(level.m, n) && !(level.is_identity && (level.m != n || level.bounded)));
    if (!level.is_identity) {
      double *rows = arena.take(size_t(level.m) * n);
      buffer.copy_rows(rows);
      need(finite(rows, level.m * n));
      level.J = rows;
    }
  }
  if (weights != Py_None) {
    level.weights = read(arena, weights, level.m);
    for (int i = 0; i < level.m; ++i) need(level.weights[i] > 0.0 && level.weights[i] < INF);
  }
  if (!level.bounded) {
    level.v = read(arena, v, level.m);
    need(finite(level.v, level.m));
    return level;
  }
  const Held lower(PyObject_GetAttr(object, LOWER_NAME));
  const Held upper(PyObject_GetAttr(object, UPPER_NAME));
  if (!lower || !upper) PyErr_Clear();
  need(lower && upper);
  read_bounds(arena, lower, upper, level.m, level.lower, level.upper);
  return level;
}

// All steps as one row of doubles; `Record` in compiled.py reads it.
class Record {
 public:
  explicit Record(const Solver &solver) : solver_(solver), n_(solver.n()) {
    size_ = n_ + 2 * solver.steps.size();
    for (const Step &step : solver.steps) size_ += count(step);
  }

  size_t size() const { return size_; }

  void write(char *to) {
    at_ = to;
    put(solver_.whole, n_);
    for (const Step &step : solver_.steps) put(&step.bend, 1);
    double begin = double(n_ + 2 * solver_.steps.size());
    for (const Step &step : solver_.steps) {
      put(&begin, 1);
      begin += double(count(step));
    }
    for (const Step &step : solver_.steps) put(step);
  }

  PyObject *bytes() {
    PyObject *found = PyBytes_FromStringAndSize(nullptr, Py_ssize_t(size_ * sizeof(double)));
    if (found) write(PyBytes_AsString(found));
    return found;
  }

 private:
  static constexpr int HEAD = 9;

  size_t count(const Step &step) const {
    const Directions &its = step.directions;
    return HEAD + n_ + size_t(its.m + 2) * its.rank
        + size_t(n_) * (step.level->bounded ? 0 : its.Q.k)
        + (step.is_relaxed ? size_t(n_) * step.relaxed.k : 0)
        + (step.multipliers ? n_ : 0) + (step.row_multipliers ? step.rows : 0)
        + (step.origin ? n_ : 0);
  }

  void put(const Step &step) {
    const Directions &its = step.directions;
    const bool demand = !step.level->bounded;
    const double head[HEAD] = {
        demand ? double(its.m) : -1.0, double(its.rank), demand ? double(its.Q.k) : 0.0,
        step.is_relaxed ? double(step.relaxed.k) : -1.0, step.multipliers ? 1.0 : 0.0,
        step.row_multipliers ? double(step.rows) : -1.0, step.origin ? 1.0 : 0.0, its.size,
        step.bend};
    put(head, HEAD);
    put(step.velocity, n_);
    put(its.U, size_t(its.m) * its.rank);
    put(its.s, its.rank);
    if (demand) put(its.Q.p, size_t(n_) * its.Q.k);
    put(step.followed, its.rank);
    if (step.is_relaxed) put(step.relaxed.p, size_t(n_) * step.relaxed.k);
    if (step.multipliers) put(step.multipliers, n_);
    if (step.row_multipliers) put(step.row_multipliers, step.rows);
    if (step.origin) put(step.origin, n_);
  }

  void put(const double *from, size_t count) {
    if (count) std::memcpy(at_, from, count * sizeof(double));
    at_ += count * sizeof(double);
  }

  const Solver &solver_;
  int n_;
  size_t size_;
  char *at_ = nullptr;
};

// A solver in use; a nested call, from an attribute that is computed, goes to the reference.
class Running {
 public:
  explicit Running(Solver &solver) : solver_(solver) {
    need(!solver.busy);
    solver.busy = true;
    solver.begin();
  }
  Running(const Running &) = delete;
  ~Running() { solver_.busy = false; }

 private:
  Solver &solver_;
};

// Solves one cycle.
class Call {
 public:
  explicit Call(Solver &solver) : running_(solver), solver_(solver) {}

  PyObject *solve(PyObject *const *given) {
    PyObject *levels = given[0], *memory = given[5];
    need(PyList_Check(levels) && PyTuple_Check(memory));
    Arena &arena = solver_.arena;
    for (Py_ssize_t l = 0; l < PyList_Size(levels); ++l) {
      const Held level(Py_NewRef(PyList_GetItem(levels, l)));
      solver_.levels.push_back(read_level(arena, level, solver_.n()));
      solver_.memory.push_back(
          l < PyTuple_Size(memory) ? number(PyTuple_GetItem(memory, l)) : 0.0);
    }
    const double *lower = nullptr, *upper = nullptr, *cap = nullptr;
    if (given[1] != Py_None && given[2] != Py_None)
      read_bounds(arena, given[1], given[2], solver_.n(), lower, upper);
    if (given[4] != Py_None) cap = read(arena, given[4], solver_.n());
    for (int j = 0; cap && j < solver_.n(); ++j) need(cap[j] >= 0.0);
    const Buffer velocity(given[6], PyBUF_STRIDES | PyBUF_FORMAT | PyBUF_WRITABLE);
    need(velocity.is(solver_.n()));
    solver_.solve(lower, upper, number(given[3]), cap);
    velocity.fill(solver_.x);
    return answer();
  }

 private:
  // (memory, steps or None, slowed)
  PyObject *answer() const {
    Held memory(PyTuple_New(Py_ssize_t(solver_.memory.size())));
    if (!memory) return nullptr;
    for (size_t l = 0; l < solver_.memory.size(); ++l) {
      PyObject *h = PyFloat_FromDouble(solver_.memory[l]);
      if (!h || PyTuple_SetItem(memory, Py_ssize_t(l), h) != 0) return nullptr;
    }
    const Held steps(solver_.looped ? Record(solver_).bytes() : Py_NewRef(Py_None));
    const Held slowed(PyFloat_FromDouble(solver_.slowed));
    if (!steps || !slowed) return nullptr;
    return PyTuple_Pack(3, static_cast<PyObject *>(memory), static_cast<PyObject *>(steps),
                        static_cast<PyObject *>(slowed));
  }

  const Running running_;
  Solver &solver_;
};

// solve(levels, lower, upper, period, cap, memory, velocity): None where the reference is needed.
PyObject *solve(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 7) {
    PyErr_SetString(PyExc_TypeError,
                    "solve(levels, lower, upper, period, speed_cap, memory, velocity)");
    return nullptr;
  }
  try {
    return Call(of<Solver>(self)).solve(given);
  } catch (const Unsolved &) {
  } catch (const std::bad_alloc &) {
  }
  return Py_NewRef(Py_None);
}

bool read_weights(PyObject *object, int n, std::vector<double> &weights) {
  if (object == Py_None) return true;
  const Buffer buffer(object);
  if (!buffer.is(n)) return false;
  for (int j = 0; j < n; ++j) weights.push_back(buffer.at(j));
  return true;
}

PyObject *make_solver(PyTypeObject *type, PyObject *given, PyObject *) {
  Options options;
  Damping &damping = options.damping;
  PyObject *weights;
  int uniform, fast;
  if (!PyArg_ParseTuple(given, "iddddOpp", &options.n, &damping.damping, &damping.singular_region,
                        &damping.release_region, &damping.regularisation, &weights, &uniform,
                        &fast)) return nullptr;
  options.uniform = uniform;
  options.fast = fast;
  try {
    if (options.n >= 1 && options.n <= MOST && read_weights(weights, options.n, options.weights))
      return keep<Solver>(type, options);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  PyErr_SetString(PyExc_ValueError, "needs joints, and as many weights or None");
  return nullptr;
}

PyMethodDef SOLVER_METHODS[] = {
    method("solve", solve, "Solve one cycle."),
    {nullptr, nullptr, 0, nullptr}};

// Names are interned once; false where there is no memory.
bool intern_level_names() {
  return intern(J_NAME, "J") && intern(V_NAME, "v") && intern(MODE_NAME, "mode")
      && intern(LOWER_NAME, "lower") && intern(UPPER_NAME, "upper")
      && intern(IDENTITY_NAME, "is_identity") && intern(JOINTS_NAME, "joints")
      && intern(WEIGHTS_NAME, "weights");
}

}  // namespace
