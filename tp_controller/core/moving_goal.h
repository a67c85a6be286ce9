// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The goal of a task that follows a curve, and its velocity.
// Reference: tp_controller/references/reference.py

#pragma once

#include "python_buffers.h"
#include "spatial.h"

namespace {

// Largest number of components of a curve that is no position of joints.
constexpr int MOST_COMPONENTS = 7;
constexpr int POWERS = 6;

// A piece of a curve (6, d), the lowest power first, at a time since its start.
struct CurvePiece {
  const Buffer &coefficients;
  double u;

  double value(int i) const {
    double found = coefficients.at(POWERS - 1, i);
    for (int power = POWERS - 2; power >= 0; --power) found = found * u + coefficients.at(power, i);
    return found;
  }

  double rate(int i) const {
    double found = (POWERS - 1) * coefficients.at(POWERS - 1, i);
    for (int power = POWERS - 2; power >= 1; --power)
      found = found * u + power * coefficients.at(power, i);
    return found;
  }
};

// The rotation of a quaternion of any norm.
void rotation_of_any(const double *quat_xyzw, double *R) {
  double unit[4], square = 0.0;
  for (int i = 0; i < 4; ++i) square += quat_xyzw[i] * quat_xyzw[i];
  for (int i = 0; i < 4; ++i) unit[i] = quat_xyzw[i] / std::sqrt(square);
  rotation_of(unit, R);
}

// The angular velocity ω = 2 q_dot q* of a quaternion that changes.
void angular_velocity(const double *q, const double *rate, double *omega) {
  const double twice = 2.0 / (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
  double across[3];
  cross(q, rate, across);
  for (int i = 0; i < 3; ++i) omega[i] = twice * (q[3] * rate[i] - rate[3] * q[i] + across[i]);
}

// moving_goal(now, u, later, u_later, goal, velocity): fill in the goal at the time u since the start
// of a piece, and its velocity at another time. What they are is seen from their shapes: joints
// (d,), (d,); a point (3,), an orientation (3, 3) or a pose (4, 4) with a twist (6,). False where
// arguments do not fit.
PyObject *moving_goal(PyObject *, PyObject *const *given, Py_ssize_t count) {
  if (count != 6) return refuse("moving_goal(now, u, later, u_later, goal, velocity)");
  const Buffer one(given[0]), other(given[2]);
  const CurvePiece now{one, PyFloat_AsDouble(given[1])}, later{other, PyFloat_AsDouble(given[3])};
  const Output goal(given[4]), velocity(given[5]);
  const bool failed = PyErr_Occurred();
  PyErr_Clear();
  if (failed || one.rows(2) != POWERS || !other.is(POWERS, one.columns())) return Py_NewRef(Py_False);
  const int d = int(one.columns());
  if (goal.is(d) && velocity.is(d)) {
    for (int i = 0; i < d; ++i) {
      goal.p()[i] = now.value(i);
      velocity.p()[i] = later.rate(i);
    }
    return Py_NewRef(Py_True);
  }
  const bool is_pose = d == 7 && goal.is(4, 4), is_turn = d == 4 && goal.is(3, 3);
  if (!velocity.is(6) || !(is_pose || is_turn || (d == 3 && goal.is(3)))) return Py_NewRef(Py_False);
  double here[MOST_COMPONENTS], there[MOST_COMPONENTS], rate[MOST_COMPONENTS], R[9];
  for (int i = 0; i < d; ++i) {
    here[i] = now.value(i);
    there[i] = later.value(i);
    rate[i] = later.rate(i);
  }
  double *to = goal.p(), *twist = velocity.p();
  std::fill(twist, twist + 6, 0.0);
  if (!is_turn) std::copy(rate, rate + 3, twist);
  if (d == 3) std::copy(here, here + 3, to);
  else {
    const int at = d - 4;
    angular_velocity(there + at, rate + at, twist + 3);
    rotation_of_any(here + at, R);
  }
  if (is_turn) std::copy(R, R + 9, to);
  for (int i = 0; is_pose && i < 3; ++i) {
    std::copy(R + 3 * i, R + 3 * i + 3, to + 4 * i);
    to[4 * i + 3] = here[i];
    to[12 + i] = 0.0;
  }
  if (is_pose) to[15] = 1.0;
  return Py_NewRef(Py_True);
}

}  // namespace
