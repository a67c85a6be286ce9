// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Inequality tasks: bounds on values, enforced as bounds on their velocities.
// Reference: tp_controller/tasks/bounded.py

#pragma once

#include "python_buffers.h"
#include "task.h"

namespace {

// Names of the reference that others have, too.
namespace bounded {

// Constants of the reference.
constexpr double RETURN_JOINT_SPEED = 0.5, FAR = 1.0, STILL = 2e-2, LOOSE = 1e-3, DRIFT = 1e-2,
    TINY = 1e-12;

// One number for all rows, or one for each.
class Each {
 public:
  explicit Each(PyObject *object)
      : buffer_(PyFloat_Check(object) ? nullptr : object), is_float_(PyFloat_Check(object)) {
    if (is_float_) all_ = PyFloat_AsDouble(object);
    else if (buffer_.is_number()) all_ = buffer_.number();
  }

  bool fits(Py_ssize_t rows) const { return is_float_ || buffer_.is_number() || buffer_.is(rows); }
  double at(Py_ssize_t i) const { return is_float_ || buffer_.is_number() ? all_ : buffer_.at(i); }

 private:
  const Buffer buffer_;
  const bool is_float_;
  double all_ = 0.0;
};

// A row of J in this cycle and in the one before, and how it moves the value.
struct Row {
  double moved, added;

  // `added`: the speed that its change adds until the next cycle; none where it has jumped.
  Row(const double *J, const double *before, const double *velocity, int n, double jump) {
    double square = 0.0, sum = 0.0, changed = 0.0;
    for (int j = 0; j < n; ++j) {
      const double change = J[j] - before[j];
      square += J[j] * J[j];
      changed += change * change;
      sum += change * velocity[j];
    }
    moved = std::sqrt(square);
    added = changed > jump * jump * square ? 0.0 : 0.5 * sum;
  }

  // A row of the identity.
  Row() : moved(1.0), added(0.0) {}
};

// How fast a row may get away whose bound is out of reach.
double drift(double back, double moved) {
  const double travel = std::fabs(back) / std::max(moved, TINY);
  const double reduced = 2.0 * RETURN_JOINT_SPEED * moved * std::max(1.0 - moved / STILL, 0.0);
  const double loose = DRIFT * std::max(LOOSE / std::max(moved, TINY) - 1.0, 0.0);
  return std::min(std::max(travel / FAR - 1.0, 0.0), 1.0) * (reduced + loose);
}

struct RowBounds {
  double error, least, most;
};

// The bounds of a row; `motion`: velocity of the value for a robot at rest.
RowBounds row_bounds(double value, double lower, double upper, double gain, double speed,
                     double motion, const Row &row) {
  const double back = std::min(speed, RETURN_JOINT_SPEED * row.moved);
  const double error = std::min(std::max(value, lower), upper) - value;
  const double lost = error == 0.0 ? 0.0 : drift(error, row.moved);
  const double from = std::min(gain * (lower - value), back) - motion - lost;
  const double to = std::max(gain * (upper - value), -back) - motion + lost;
  // Only what leads outwards needs a margin, as far as there is any.
  return {error, std::min(from - std::min(row.added, 0.0), to),
          std::max(to - std::max(row.added, 0.0), from)};
}

// bound(value, J, before, velocity, lower, upper, gain, return_speed, motion, jump, error, least,
// most): fill in `error`, `least` and `most` (m,) of a task that Python observes; False where
// something does not fit.
PyObject *bound(PyObject *, PyObject *const *given, Py_ssize_t count) {
  if (count != 13) {
    PyErr_SetString(PyExc_TypeError, "bound(value, J, before, velocity, lower, upper, gain, "
                    "return_speed, motion, jump, error, least, most)");
    return nullptr;
  }
  const Buffer value(given[0]), J(given[1]), before(given[2]), velocity(given[3]);
  const Each lower(given[4]), upper(given[5]), gain(given[6]), speed(given[7]), motion(given[8]),
      jump(given[9]);
  const Output error(given[10]), least(given[11]), most(given[12]);
  const Py_ssize_t m = value.rows(1), n = velocity.rows(1);
  if (m < 0 || n < 0 || !J.is(m, n) || !before.is(m, n) || !lower.fits(m) || !upper.fits(m)
      || !gain.fits(m) || !speed.fits(m) || !motion.fits(m) || !jump.fits(m) || !error.is(m)
      || !least.is(m) || !most.is(m)) return Py_NewRef(Py_False);
  double row[MOST], last[MOST], joints[MOST];
  velocity.copy(joints);
  for (Py_ssize_t i = 0; i < m; ++i) {
    for (Py_ssize_t j = 0; j < n; ++j) {
      row[j] = J.at(i, j);
      last[j] = before.at(i, j);
    }
    const RowBounds found = row_bounds(
        value.at(i), lower.at(i), upper.at(i), gain.at(i), speed.at(i), motion.at(i),
        Row(row, last, joints, int(n), jump.at(i)));
    error.p()[i] = found.error;
    least.p()[i] = found.least;
    most.p()[i] = found.most;
  }
  return Py_NewRef(Py_True);
}

}  // namespace bounded

// Limits of the values, the speed of their return, and what counts as a jump of a row.
struct ValueBounds {
  std::vector<double> lower, upper;
  double return_speed = 0.0, jump = 0.0;
};

class BoundedTask : public Task {
 public:
  // `history`: numbers of the last cycle, see `History`.
  BoundedTask(Law law, ValueBounds bounds, Kept history)
      : Task(std::move(law), history), bounds_(std::move(bounds)) {}

  bool bounded() const override { return true; }

  bool fits(const Motion &motion) const override {
    return memory_.size() == 1 + motion.q().size() + 2 * size_t(most_rows()) * width(motion);
  }

 protected:
  ValueBounds bounds_;

  // Columns of a row in the history.
  virtual size_t width(const Motion &motion) const { return size_t(motion.n); }

  // Error and bounds of values (m,) whose J is in `out`; `motion` (m,): their velocities for a
  // robot at rest.
  void bound(const Situation &at, const double *value, const double *motion, const Rows &out) {
    const double *before = note(at, out.J);
    for (int i = 0; i < rows(); ++i)
      bound(at, i, value[i], motion[i], before + i * at.motion->n, out);
  }

  // Error and bounds of a row; `before`: its J in the cycle before.
  void bound(const Situation &at, int i, double value, double motion, const double *before,
             const Rows &out) const {
    const int n = at.motion->n;
    const bounded::RowBounds its = bounded::row_bounds(
        value, bounds_.lower[i], bounds_.upper[i], law_.gain[i], bounds_.return_speed, motion,
        bounded::Row(out.J + i * n, before, at.velocity, n, bounds_.jump));
    out.error[i] = its.error;
    out.lower[i] = its.least;
    out.upper[i] = its.most;
  }

  // Remember the J of a cycle, perhaps not for the first time, and return that of the one before.
  const double *note(const Situation &at, const double *J) {
    const std::vector<double> &q = at.motion->q();
    const size_t size = size_t(most_rows()) * width(*at.motion);
    double &now = memory_[0], *place = &now + 1, *latest = place + q.size(), *before = latest + size;
    if (std::isnan(now)) std::copy(J, J + size, before);
    else if (now != at.now || !std::equal(q.begin(), q.end(), place))
      std::copy(latest, latest + size, before);
    now = at.now;
    std::copy(q.begin(), q.end(), place);
    std::copy(J, J + size, latest);
    return before;
  }
};

}  // namespace
