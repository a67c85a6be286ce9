// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The next joint state of a publisher, as it is expected.
// Reference: tp_controller/ros/loop/expected_state.py

#pragma once

#include <cmath>
#include <vector>

#include "python_buffers.h"

namespace {

// Offsets of the stamp and of the names in a message, and how it begins.
constexpr Py_ssize_t STAMP = 4, BEGIN = 12;
constexpr char LITTLE_ENDIAN_HEAD[] = {0, 1};

class ExpectedState {
 public:
  // The last message, of `size` bytes, and the mask of what counts before its positions.
  ExpectedState(const char *raw, Py_ssize_t size, const char *mask, Py_ssize_t length)
      : size_(size), begin_(BEGIN + length), names_(raw + BEGIN, raw + begin_),
        mask_(mask, mask + length) {}
  ExpectedState(const ExpectedState &) = delete;
  ~ExpectedState() {
    if (held_.obj) PyBuffer_Release(&held_);
  }

  // False where these do not fit together.
  bool set(PyObject *source, PyObject *rows, PyObject *reference, PyObject *passable,
           PyObject *positions) {
    if (PyObject_GetBuffer(positions, &held_, PyBUF_C_CONTIGUOUS | PyBUF_FORMAT
                           | PyBUF_WRITABLE) != 0) return false;
    const Py_ssize_t k = PySequence_Size(source), count = (size_ - begin_) / 8;
    if (k < 0 || !is_double(held_) || held_.ndim != 1
        || reinterpret_cast<std::uintptr_t>(held_.buf) % alignof(double) != 0
        || PySequence_Size(rows) != k || PySequence_Size(reference) != k
        || PySequence_Size(passable) != k) return false;
    for (Py_ssize_t i = 0; i < k; ++i) {
      joints_.push_back({Py_ssize_t(number(source, i)), Py_ssize_t(number(rows, i)),
                         number(reference, i), number(passable, i), 0.0});
      const Joint &joint = joints_.back();
      if (PyErr_Occurred() || joint.source < 0 || joint.source >= count || joint.row < 0
          || joint.row >= held_.shape[0]) return false;
    }
    return true;
  }

  // Store the positions of a message and find its stamp; false if it is not as expected.
  bool read(const char *raw, Py_ssize_t size, double received, double offset, double limit,
            double newest, double &stamp) {
    if (size != size_ || std::memcmp(raw, LITTLE_ENDIAN_HEAD, 2) != 0 || !is_named(raw))
      return false;
    std::int32_t seconds;
    std::uint32_t nanoseconds;
    std::memcpy(&seconds, raw + STAMP, sizeof seconds);
    std::memcpy(&nanoseconds, raw + STAMP + sizeof seconds, sizeof nanoseconds);
    stamp = seconds + 1e-9 * nanoseconds;
    if (stamp != 0.0 && !(std::fabs(received - stamp - offset) <= limit && stamp >= newest))
      return false;
    double *positions = static_cast<double *>(held_.buf);
    for (Joint &joint : joints_) {
      std::memcpy(&joint.found, raw + begin_ + 8 * joint.source, sizeof joint.found);
      if (!(std::fabs(joint.found - positions[joint.row]) <= joint.passable
            && std::fabs(joint.found - joint.reference) <= joint.passable)) return false;
    }
    for (const Joint &joint : joints_) positions[joint.row] = joint.found;
    return true;
  }

 private:
  struct Joint {
    Py_ssize_t source, row;
    double reference, passable, found;
  };

  bool is_named(const char *raw) const {
    char different = 0;
    for (size_t i = 0; i < mask_.size(); ++i)
      different |= char((raw[BEGIN + Py_ssize_t(i)] ^ names_[i]) & mask_[i]);
    return different == 0;
  }

  static double number(PyObject *sequence, Py_ssize_t i) {
    const Held item(PySequence_GetItem(sequence, i));
    return item ? PyFloat_AsDouble(item) : -1.0;
  }

  Py_ssize_t size_, begin_;
  std::vector<char> names_, mask_;
  std::vector<Joint> joints_;
  Py_buffer held_ = {};                  // the positions of the buffer
};

// ExpectedState(raw, mask, source, rows, reference, passable, positions)
PyObject *make_expected(PyTypeObject *type, PyObject *given, PyObject *) {
  const char *raw, *mask;
  Py_ssize_t size, length;
  PyObject *source, *rows, *reference, *passable, *positions;
  if (!PyArg_ParseTuple(given, "y#y#OOOOO", &raw, &size, &mask, &length, &source, &rows, &reference,
                        &passable, &positions)) return nullptr;
  try {
    if (BEGIN + length <= size) {
      const Held self(keep<ExpectedState>(type, raw, size, mask, length));
      if (!self) return nullptr;
      if (of<ExpectedState>(self).set(source, rows, reference, passable, positions))
        return Py_NewRef(self);
    }
    PyErr_Clear();
    PyErr_SetString(PyExc_ValueError, "joints and message do not fit together");
    return nullptr;
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
}

// read(raw, received, offset, limit, newest): the stamp; None for any other message.
PyObject *read_expected(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  char *raw;
  Py_ssize_t size;
  if (count != 5) {
    PyErr_SetString(PyExc_TypeError, "read(raw, received, offset, limit, newest)");
    return nullptr;
  }
  if (PyBytes_AsStringAndSize(given[0], &raw, &size) != 0) return nullptr;
  double times[4], stamp;
  for (int i = 0; i < 4; ++i) times[i] = PyFloat_AsDouble(given[i + 1]);
  if (PyErr_Occurred()) return nullptr;
  if (!of<ExpectedState>(self).read(raw, size, times[0], times[1], times[2], times[3], stamp))
    return Py_NewRef(Py_None);
  return PyFloat_FromDouble(stamp);
}

PyMethodDef EXPECTED_METHODS[] = {
    method("read", read_expected, "Store the positions of a message that is as expected."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
