// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Rows of the distances between solids on frames: how fast both part along their normal.
// Reference: tp_controller/tasks/collision.py

#pragma once

#include "motion_object.h"

namespace {

// Jacobians (6, n) of frames, each computed once, for what is at the origin of the root.
class FrameJacobians {
 public:
  explicit FrameJacobians(const Motion &motion)
      : motion_(motion), at_(motion.frames.size(), NOT_YET) {}

  // Add the speed of a frame along a normal, times a factor, to a row (n); `turn`: p × normal.
  void add_speed(long frame, double factor, const double *normal, const double *turn, double *row) {
    const size_t n = size_t(motion_.n);
    const double *J = of(size_t(frame));
    for (int i = 0; i < 3; ++i)
      for (size_t j = 0; j < n; ++j)
        row[j] += factor * (normal[i] * J[i * n + j] + turn[i] * J[(3 + i) * n + j]);
  }

 private:
  static constexpr size_t NOT_YET = size_t(-1);

  const double *of(size_t frame) {
    if (at_[frame] == NOT_YET) {
      const double origin[3] = {};
      at_[frame] = numbers_.size();
      numbers_.resize(numbers_.size() + 6 * size_t(motion_.n));
      motion_.jacobian(int(frame), origin, &numbers_[at_[frame]]);
    }
    return &numbers_[at_[frame]];
  }

  const Motion &motion_;
  std::vector<size_t> at_;
  std::vector<double> numbers_;
};

// The frames of the pair that a list names at a place; false where they are none.
bool read_pair(const Motion &motion, PyObject *frames, PyObject *pairs, Py_ssize_t place,
               long (&found)[2]) {
  const Py_ssize_t pair = PyLong_AsSsize_t(PyList_GetItem(pairs, place));
  if (pair < 0 || pair >= PyList_Size(frames)) return false;
  PyObject *both = PyList_GetItem(frames, pair);
  if (!PyTuple_Check(both) || PyTuple_Size(both) != 2) return false;
  for (int end = 0; end < 2; ++end) {
    found[end] = frame_of(motion, PyTuple_GetItem(both, end));
    if (found[end] < 0) return false;
  }
  return true;
}

bool fill_parting(const Motion &motion, PyObject *frames, PyObject *pairs, const Buffer &normals,
                  const Buffer &points, const Output &J) {
  const Py_ssize_t m = PyList_Size(pairs);
  if (!normals.is(m, 3) || !points.is(m, 3) || !J.is(m, motion.n)) return false;
  std::fill(J.p(), J.p() + m * motion.n, 0.0);
  FrameJacobians jacobians(motion);
  for (Py_ssize_t i = 0; i < m; ++i) {
    long ends[2];
    if (!read_pair(motion, frames, pairs, i, ends)) return false;
    double normal[3], point[3], turn[3];
    for (int k = 0; k < 3; ++k) {
      normal[k] = normals.at(i, k);
      point[k] = points.at(i, k);
    }
    cross(point, normal, turn);
    jacobians.add_speed(ends[0], 1.0, normal, turn, J.p() + i * motion.n);
    jacobians.add_speed(ends[1], -1.0, normal, turn, J.p() + i * motion.n);
  }
  return true;
}

// parting(motion, frames, pairs, normals, points, J): fill in J (m, n) of the pairs with these
// indices in the list of frames [(int, int), …]; False where something does not fit.
PyObject *parting(PyObject *, PyObject *const *given, Py_ssize_t count) {
  Motion *motion = count == 6 ? find<Motion>(given[0]) : nullptr;
  if (!motion || !PyList_Check(given[1]) || !PyList_Check(given[2]))
    return refuse("parting(motion, frames, pairs, normals, points, J)");
  const Buffer normals(given[3]), points(given[4]);
  const Output J(given[5]);
  try {
    const bool fits = fill_parting(*motion, given[1], given[2], normals, points, J);
    PyErr_Clear();
    return Py_NewRef(fits ? Py_True : Py_False);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
}

}  // namespace
