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

// Error, Jacobian and demanded velocity of a task about a frame. Another shape or type is answered
// with False, and the reference says what is wrong.
// Reference: tp_controller/tasks/frame.py

#pragma once

#include "motion_object.h"

namespace {

// The parts of a goal that there are: a position (3,), a rotation (3, 3), or a pose (4, 4).
struct Goal {
  bool is_position = false, is_rotation = false;
  double R[9] = {}, p[3] = {};

  bool read(PyObject *object) {
    double T[16];
    const Buffer given(object);
    if (given.is(3)) {
      given.copy(p);
      is_position = true;
    } else if (given.is(3, 3)) {
      given.copy_rows(R);
      is_rotation = true;
    } else if (given.is(4, 4)) {
      given.copy_rows(T);
      for (int i = 0; i < 3; ++i) {
        std::copy(T + 4 * i, T + 4 * i + 3, R + 3 * i);
        p[i] = T[4 * i + 3];
      }
      is_position = is_rotation = true;
    }
    return is_position || is_rotation;
  }
};

// A frame as a reference sees it (`RelativeFrame`), with J (6, n) in place.
Placement seen_from(Motion &motion, const Placement &its, int reference, double *J) {
  const int n = motion.n;
  const Placement from = motion.placement(reference);
  double *moves = motion.jacobians() + 6 * size_t(n), between[3];
  motion.jacobian(reference, from.p, moves);
  subtract(its.p, from.p, between);
  for (int c = 0; c < n; ++c) {
    // d/dt Rᵀ(p − p_ref) = Rᵀ(v − v_ref − ω_ref × (p − p_ref))
    double v[3], w[3], of[3], carried[3];
    for (int i = 0; i < 3; ++i) of[i] = moves[(3 + i) * n + c];
    cross(of, between, carried);
    for (int i = 0; i < 3; ++i) {
      v[i] = J[i * n + c] - moves[i * n + c] - carried[i];
      w[i] = J[(3 + i) * n + c] - of[i];
    }
    for (int i = 0; i < 3; ++i) {
      const double axis[3] = {from.R[i], from.R[3 + i], from.R[6 + i]};
      J[i * n + c] = dot(axis, v);
      J[(3 + i) * n + c] = dot(axis, w);
    }
  }
  Placement found;
  apply_transposed(from.R, between, found.p);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      found.R[3 * i + j] = from.R[i] * its.R[j] + from.R[3 + i] * its.R[3 + j]
          + from.R[6 + i] * its.R[6 + j];
  return found;
}

// The error (6,) of a frame, and J (6, n); both as a reference frame sees them, −1 the root.
const double *error_of(Motion &motion, int frame, int reference, const double *p_goal,
                       const double *R_goal, bool turns, double *error) {
  double *J = motion.jacobians();
  Placement its = motion.placement(frame);
  motion.jacobian(frame, its.p, J);
  if (reference >= 0) its = seen_from(motion, its, reference, J);
  subtract(p_goal, its.p, error);
  if (turns) {
    double turn[9];
    for (int i = 0; i < 3; ++i)
      for (int j = 0; j < 3; ++j) turn[3 * i + j] = dot(R_goal + 3 * i, its.R + 3 * j);
    rotation_vector(turn, error + 3);
  }
  return J;
}

// observe(frame, reference, rows, goal, previous, turn, gain, error, J, v): fill in error (m,),
// J (m, n) and v = gain error (m,) of some rows (bytes) of a twist, and the turn (3,) that is left
// where the goal has a rotation. `previous`: the turn of the cycle before, or None; `gain`: () or
// (m,). False where something does not fit.
PyObject *observe(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 10)
    return refuse("observe(frame, reference, rows, goal, previous, turn, gain, error, J, v)");
  Motion &motion = of<Motion>(self);
  const long frame = frame_of(motion, given[0]), reference = frame_of(motion, given[1]);
  char *rows;
  Py_ssize_t m;
  if (PyBytes_AsStringAndSize(given[2], &rows, &m) != 0) return nullptr;
  Goal goal;
  const Buffer gain(given[6]);
  const Output error(given[7]), J(given[8]), v(given[9]);
  if (frame < 0 || reference < -1 || !goal.read(given[3]) || !(gain.is_number() || gain.is(m))
      || !error.is(m) || !J.is(m, motion.n) || !v.is(m)) return Py_NewRef(Py_False);
  double e[6] = {};
  const double *all = error_of(motion, int(frame), int(reference), goal.p, goal.R,
                               goal.is_rotation, e);
  if (goal.is_rotation) {
    double previous[3];
    if (given[4] != Py_None) {
      if (!read(given[4], 3, HUGE_VAL, previous)) return Py_NewRef(Py_False);
      follow(previous, e + 3);
    }
    const Output turn(given[5]);
    if (!turn.is(3)) return Py_NewRef(Py_False);
    std::copy(e + 3, e + 6, turn.p());
  }
  for (Py_ssize_t i = 0; i < m; ++i) {
    const int row = rows[i];
    if (row < 0 || row > 5 || !(row < 3 ? goal.is_position : goal.is_rotation))
      return Py_NewRef(Py_False);
    error.p()[i] = e[row];
    v.p()[i] = (gain.is_number() ? gain.number() : gain.at(i)) * e[row];
    std::copy(all + size_t(row) * motion.n, all + size_t(row + 1) * motion.n,
              J.p() + i * motion.n);
  }
  return Py_NewRef(Py_True);
}

PyMethodDef MOTION_METHODS[] = {
    method("move", move, "Move to other positions."),
    method("place", place, "Place a frame."),
    method("jacobian", jacobian, "Return the Jacobian of a frame."),
    method("observe", observe, "Return error, Jacobian and demand of a task about a frame."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
