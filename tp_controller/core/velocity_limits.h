// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Bounds on the joint velocities in one cycle, and `Limits` as Python has it.
// Reference: tp_controller/control/velocity_limits.py

#pragma once

#include "jerk_limit.h"

namespace {

// Constants of the reference.
constexpr double SAME_VELOCITY = 1e-9;

// Bits of limits, in the order of `LIMITS`; the reserve follows them.
constexpr unsigned VELOCITY = 1, UPPER = 2, LOWER = 4, ACCELERATION = 8, JERK = 16, RESERVE = 32;
constexpr unsigned ALL_TRANSIENT = ACCELERATION | JERK;

// All limits in force, as `LIMITS`.
struct JointLimits {
  VelocityLimit velocity;
  PositionLimits position;
  AccelerationLimit acceleration;
  JerkLimit jerk;
  double response = 0.0;  // `VelocityLimits.response`

  size_t size() const { return velocity.values.size(); }

  // Read {key: numbers}; false where they are not those of as many joints.
  bool read(PyObject *limits, double period, double gain) {
    PyObject *first = PyDict_GetItemString(limits, "velocity");
    if (!first || !read_all(first, velocity.values)) return false;
    position.period = acceleration.period = jerk.period = period;
    position.gain = gain;
    position.velocity = velocity.values;
    if (!read_limit(limits, "lower", true, size(), position.lower)
        || !read_limit(limits, "upper", true, size(), position.upper)
        || !read_limit(limits, "acceleration", false, size(), acceleration.values)
        || !read_limit(limits, "jerk", false, size(), jerk.values)) return false;
    position.acceleration = acceleration.values;
    jerk.position = position;
    response = jerk.response();
    return true;
  }

  bool follow_demand() const { return jerk.in_force(); }
  bool has_transient() const { return acceleration.in_force() || jerk.in_force(); }

  // Call with the interval of each transient limit but those `without`, and its bit, in the order of
  // precedence.
  template <typename Clamp>
  void transient(const JointMotion &motion, double gain, size_t j, unsigned without,
                 Clamp clamp) const {
    if (acceleration.in_force() && !(without & ACCELERATION))
      clamp(acceleration.at(motion, j), ACCELERATION);
    if (jerk.in_force() && !(without & JERK)) clamp(jerk.at(motion, gain, j), JERK);
  }
};

class Limits {
 public:
  JointLimits limits;

  Py_ssize_t size() const { return Py_ssize_t(limits.size()); }

  // Find the joints that stand, and stay: those with a velocity limit of zero.
  void standing(const JointMotion &motion, std::vector<int> &found) const {
    found.clear();
    for (size_t j = 0; j < limits.size(); ++j) {
      if (limits.velocity.values[j] != 0.0) continue;
      const Interval box = at(motion, limits.position.gain_of(motion), j);
      if (box.least == 0.0 && box.most == 0.0) found.push_back(int(j));
    }
  }

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
    limits.transient(motion, gain, j, without, [&](const Interval &reachable, unsigned) {
      box.least = std::min(std::max(box.least, reachable.least), reachable.most);
      box.most = std::min(std::max(box.most, reachable.least), reachable.most);
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
    // If all reachable velocities are too fast, the nearer end of them is the bound.
    const auto note = [&](const Interval &reachable, unsigned bit) {
      if (holds(reachable.least) || holds(reachable.most)) found |= bit;
    };
    limits.transient(motion, gain, j, without, note);
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
PyObject *POSITIONS_NAME, *VELOCITY_NAME, *ELAPSED_NAME, *PENDING_NAME, *DURATION_NAME,
    *ACCELERATION_NAME, *BEFORE_NAME, *DEMAND_NAME, *DEMANDED_NAME;

// Names are interned once; false where there is no memory.
bool intern_motion_names() {
  return intern(POSITIONS_NAME, "positions") && intern(VELOCITY_NAME, "velocity")
      && intern(ELAPSED_NAME, "elapsed") && intern(PENDING_NAME, "pending")
      && intern(DURATION_NAME, "duration") && intern(ACCELERATION_NAME, "acceleration")
      && intern(BEFORE_NAME, "before") && intern(DEMAND_NAME, "demand")
      && intern(DEMANDED_NAME, "demanded");
}

// A `JointMotion` of n joints that Python has; `fits` where it is one.
class GivenMotion {
 public:
  GivenMotion(PyObject *given, size_t n)
      : positions_(n), velocity_(n), upwards_(n), downwards_(n), command_(n), acceleration_(n),
        demand_(n), demanded_(n) {
    const Held pending(PyObject_GetAttr(given, PENDING_NAME));
    fits = read(given, ELAPSED_NAME, motion.elapsed) && read(given, DURATION_NAME, motion.duration)
        && read(given, POSITIONS_NAME, positions_) && read(given, VELOCITY_NAME, velocity_)
        && read(given, BEFORE_NAME, motion.before) && pending && PyTuple_Check(pending);
    motion.count = fits ? int(PyTuple_Size(pending)) : 0;
    for (int i = 0; fits && i < motion.count; ++i) {
      fits = copy(PyTuple_GetItem(pending, i), command_);
      if (fits) add_pending(command_.data(), int(n), upwards_.data(), downwards_.data());
    }
    fits = fits && read_if_known(given, ACCELERATION_NAME, acceleration_, motion.acceleration)
        && read_if_known(given, DEMAND_NAME, demand_, motion.demand)
        && read_if_known(given, DEMANDED_NAME, demanded_, motion.demanded);
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

  static bool read_if_known(PyObject *motion, PyObject *name, Numbers &found,
                            const double *&numbers) {
    const Held array(PyObject_GetAttr(motion, name));
    if (array && array != Py_None) numbers = found.data();
    return array && (array == Py_None || copy(array, found));
  }

  Numbers positions_, velocity_, upwards_, downwards_, command_, acceleration_, demand_,
      demanded_;
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
    JointMotion motion = its.motion;
    if (motion.demand) limits.limits.jerk.follow(motion, motion.demand);
    limits.box(motion, false, lower.p(), upper.p());
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  return Py_NewRef(Py_None);
}

PyMethodDef LIMITS_METHODS[] = {
    method("box", limits_box, "Return the bounds of joint velocities."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
