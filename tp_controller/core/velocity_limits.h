// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Bounds on the joint velocities in one cycle, and `Limits` as Python has it.
// Reference: tp_controller/control/velocity_limits.py

#pragma once

#include "joint_limits.h"

namespace {

// Constants of the reference.
constexpr double SAME_VELOCITY = 1e-9;

// Bits of limits, in the order of `LIMITS`; the reserve follows them.
constexpr unsigned VELOCITY = 1, UPPER = 2, LOWER = 4, TRANSIENT = 8, RESERVE = 16;
constexpr unsigned ALL_TRANSIENT = ~(TRANSIENT - 1);

class Limits {
 public:
  JointLimits limits;

  Py_ssize_t size() const { return Py_ssize_t(limits.size()); }

  // What `bounded` returns of one joint, without some limits (bits of their places in `LIMITS`).
  Interval at(const JointMotion &motion, double gain, size_t j, unsigned without = 0) const {
    const Interval speed = limits.velocity.at(j), braking = limits.position.at(motion, gain, j);
    Interval box = {-INF, INF};
    if (!(without & VELOCITY)) box = speed;
    if (!(without & LOWER)) box.least = std::max(box.least, braking.least);
    if (!(without & UPPER)) box.most = std::min(box.most, braking.most);
    if (box.most < box.least) {
      // A joint must not return so fast that it cannot stop at the other end of its range.
      box.most = std::max(box.most, std::min(box.least, 0.0));
      box.least = std::min(box.least, box.most);
    }
    // Clamp to the reachable velocities, even if all of them are too fast.
    unsigned bit = TRANSIENT;
    limits.transient(motion, j, [&](const Interval &reachable) {
      if (!(without & bit)) {
        box.least = std::min(std::max(box.least, reachable.least), reachable.most);
        box.most = std::min(std::max(box.most, reachable.least), reachable.most);
      }
      bit <<= 1;
    });
    return box;
  }

  // Fill in what `bounded` returns, without transient limits where `settled`.
  void box(const JointMotion &motion, bool settled, double *lower, double *upper) const {
    const double gain = limits.position.gain_of(motion);
    for (size_t j = 0; j < limits.size(); ++j) {
      const Interval box = at(motion, gain, j, settled ? ALL_TRANSIENT : 0);
      lower[j] = box.least;
      upper[j] = box.most;
    }
  }

  // Bits of the limits that hold the bound of a joint from above, or from below, of all without some.
  unsigned holding(const JointMotion &motion, double gain, size_t j, bool up, double bound,
                   unsigned without) const {
    const auto holds = [bound](double end) { return std::fabs(end - bound) <= SAME_VELOCITY; };
    const Interval speed = limits.velocity.at(j), braking = limits.position.at(motion, gain, j);
    unsigned found = holds(up ? speed.most : speed.least) ? VELOCITY : 0;
    if (holds(up ? braking.most : -INF)) found |= UPPER;
    if (holds(up ? INF : braking.least)) found |= LOWER;
    unsigned bit = TRANSIENT;
    // If all reachable velocities are too fast, the nearer end of them is the bound.
    limits.transient(motion, j, [&](const Interval &reachable) {
      if (holds(reachable.least) || holds(reachable.most)) found |= bit;
      bit <<= 1;
    });
    found &= ~without;
    // Otherwise the bound is the speed of return from outside of the range.
    return found ? found : up ? UPPER : LOWER;
  }
};

// Limits(period, gain, {key: limits})
PyObject *make_limits(PyTypeObject *type, PyObject *given, PyObject *) {
  Limits limits;
  double period, gain;
  PyObject *values;
  if (!PyArg_ParseTuple(given, "ddO!", &period, &gain, &PyDict_Type, &values)) return nullptr;
  try {
    if (!limits.limits.read(values, period, gain))
      return refuse("limits of as many joints are needed");
    return keep<Limits>(type, std::move(limits));
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
}

// Names of the attributes of a `JointMotion`.
PyObject *POSITIONS_NAME, *VELOCITY_NAME, *ELAPSED_NAME, *PENDING_NAME, *DURATION_NAME;

// Names are interned once; false where there is no memory.
bool intern_motion_names() {
  return intern(POSITIONS_NAME, "positions") && intern(VELOCITY_NAME, "velocity")
      && intern(ELAPSED_NAME, "elapsed") && intern(PENDING_NAME, "pending")
      && intern(DURATION_NAME, "duration");
}

// A `JointMotion` of n joints that Python has; `fits` where it is one.
class GivenMotion {
 public:
  GivenMotion(PyObject *given, size_t n)
      : positions_(n), velocity_(n), upwards_(n), downwards_(n), command_(n) {
    const Held pending(PyObject_GetAttr(given, PENDING_NAME));
    fits = read(given, ELAPSED_NAME, motion.elapsed) && read(given, DURATION_NAME, motion.duration)
        && read(given, POSITIONS_NAME, positions_) && read(given, VELOCITY_NAME, velocity_)
        && pending && PyTuple_Check(pending);
    motion.count = fits ? int(PyTuple_Size(pending)) : 0;
    for (int i = 0; fits && i < motion.count; ++i) {
      fits = copy(PyTuple_GetItem(pending, i), command_);
      if (fits) add_pending(command_.data(), int(n), upwards_.data(), downwards_.data());
    }
    motion.positions = positions_.data();
    motion.velocity = velocity_.data();
    motion.upwards = upwards_.data();
    motion.downwards = downwards_.data();
    PyErr_Clear();
  }

  JointMotion motion = {};
  bool fits = false;

 private:
  static bool read(PyObject *motion, PyObject *name, double &found) {
    const Held number(PyObject_GetAttr(motion, name));
    if (number) found = PyFloat_AsDouble(number);
    return number && !(found == -1.0 && PyErr_Occurred());
  }

  static bool copy(PyObject *object, Numbers &found) {
    const Buffer buffer(object);
    if (!buffer.is(Py_ssize_t(found.size()))) return false;
    buffer.copy(found.data());
    return true;
  }

  static bool read(PyObject *motion, PyObject *name, Numbers &found) {
    const Held array(PyObject_GetAttr(motion, name));
    return array && copy(array, found);
  }

  Numbers positions_, velocity_, upwards_, downwards_, command_;
};

// box(motion, lower, upper): fill in lower and upper (n,); see `Limits::box`.
PyObject *limits_box(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  const Limits &limits = of<Limits>(self);
  const Output lower(count == 3 ? given[1] : nullptr), upper(count == 3 ? given[2] : nullptr);
  if (!lower.is(limits.size()) || !upper.is(limits.size()))
    return refuse("box(motion, lower, upper)");
  try {
    const GivenMotion its(given[0], size_t(limits.size()));
    if (!its.fits) return refuse("the motion is not one of these joints");
    limits.box(its.motion, false, lower.p(), upper.p());
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return Py_NewRef(Py_None);
}

PyMethodDef LIMITS_METHODS[] = {
    method("box", limits_box, "Return the bounds of joint velocities."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
