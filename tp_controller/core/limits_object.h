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

// `Limits` as Python has it.
// Reference: tp_controller/control/velocity_limits.py

#pragma once

#include "motion_object.h"
#include "velocity_limits.h"

namespace {

// Limits(period, gain, endless, lower, upper, velocity, acceleration)
PyObject *make_limits(PyTypeObject *type, PyObject *given, PyObject *) {
  Limits limits;
  PyObject *lower, *upper, *velocity, *acceleration;
  int endless;
  if (!PyArg_ParseTuple(given, "ddpOOOO", &limits.period, &limits.gain, &endless, &lower, &upper,
                        &velocity, &acceleration)) return nullptr;
  limits.endless = endless;
  try {
    const bool given_all = read_all(lower, limits.lower) && read_all(upper, limits.upper)
        && read_all(velocity, limits.velocity)
        && (acceleration == Py_None || read_all(acceleration, limits.acceleration));
    const size_t n = limits.lower.size();
    if (!given_all || limits.upper.size() != n || limits.velocity.size() != n
        || (acceleration != Py_None && limits.acceleration.size() != n))
      return refuse("limits of as many joints are needed");
    return keep<Limits>(type, std::move(limits));
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
}

// at(q, previous, elapsed, pending, duration, rows): fill in rows (8, n); see `Limits::at`.
PyObject *limits_at(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  const Limits &limits = of<Limits>(self);
  const Py_ssize_t n = Py_ssize_t(limits.lower.size());
  const bool all = count == 6;
  const Buffer q(all ? given[0] : nullptr), previous(all ? given[1] : nullptr),
      pending(all ? given[3] : nullptr);
  const Output rows(all ? given[5] : nullptr);
  if (!q.is(n) || !previous.is(n) || !pending.is(pending.rows(2), n)
      || !rows.is(Limits::ROWS, n))
    return refuse("at(q, previous, elapsed, pending, duration, rows)");
  const double elapsed = PyFloat_AsDouble(given[2]), duration = PyFloat_AsDouble(given[4]);
  if ((elapsed == -1.0 || duration == -1.0) && PyErr_Occurred()) return nullptr;
  limits.at(q, previous, elapsed, pending, duration, rows.p());
  return Py_NewRef(Py_None);
}

PyMethodDef LIMITS_METHODS[] = {
    method("at", limits_at, "Return the bounds of joint velocities."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
