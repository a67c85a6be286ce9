// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// `Motion` as Python has it: where frames are, and how joints move them.
// Reference: tp_controller/model/compiled.py

#pragma once

#include "kinematics.h"
#include "python_buffers.h"

namespace {

// Numbers that a matrix holds, row by row; false where the object is no such matrix.
bool read_rows(PyObject *object, Py_ssize_t columns, std::vector<double> &found) {
  const Buffer buffer(object);
  const Py_ssize_t rows = buffer.rows(2);
  if (!buffer.is(rows, columns)) return false;
  found.resize(size_t(rows * columns));
  buffer.copy_rows(found.data());
  return true;
}

bool read_all(PyObject *object, std::vector<double> &found) {
  const Buffer buffer(object);
  if (buffer.rows(1) < 0) return false;
  found.resize(size_t(buffer.rows(1)));
  buffer.copy(found.data());
  return true;
}

// Up to MOST numbers of an array; false where it has another size or numbers beyond `largest`.
bool read(PyObject *object, Py_ssize_t size, double largest, double *found) {
  const Buffer buffer(object);
  if (!buffer.is(size)) return false;
  buffer.copy(found);
  for (Py_ssize_t i = 0; i < size; ++i)
    if (!(std::fabs(found[i]) <= largest)) return false;
  return true;
}

bool read(PyObject *object, double largest, std::vector<double> &found) {
  return read(object, Py_ssize_t(found.size()), largest, found.data());
}

PyObject *refuse(const char *what) {
  PyErr_SetString(PyExc_ValueError, what);
  return nullptr;
}

// Say whether a number is a whole one from `least` to `most`, and find it.
bool whole(double number, int least, int most, int &found) {
  if (!(number >= least && number <= most)) return false;
  found = int(number);
  return found == number;
}

constexpr int OF_BODY = 23, OF_FRAME = 13;

bool read_base(const std::vector<double> &rows, Motion &motion) {
  motion.base.resize(rows.size());
  motion.first_column = int(rows.size());
  for (size_t i = 0; i < rows.size(); ++i)
    if (!whole(rows[i], 0, 5, motion.base[i])) return false;
  return true;
}

bool read_bodies(const std::vector<double> &rows, Motion &motion) {
  for (size_t b = 0; b * OF_BODY < rows.size(); ++b) {
    const double *row = &rows[b * OF_BODY];
    const int before = std::max(int(b) - 1, 0);
    Body body;
    int kind;
    // The root alone stands still; each other body hangs on one before it.
    if (!whole(row[0], b ? FREE : STILL, b ? SLIDES : STILL, kind)
        || !whole(row[1], 0, before, body.parent)
        || !whole(row[2], -1, motion.columns() - 1, body.column)
        || (kind == FREE && motion.base.empty())) return false;
    body.kind = Kind(kind);
    body.share = row[3];
    std::copy(row + 4, row + 7, body.axis);
    std::copy(row + 7, row + 16, body.R);
    std::copy(row + 16, row + 19, body.p);
    body.mass = row[19];
    std::copy(row + 20, row + 23, body.center);
    motion.bodies.push_back(body);
  }
  return !motion.bodies.empty();
}

bool read_frames(const std::vector<double> &rows, Motion &motion) {
  for (size_t f = 0; f * OF_FRAME < rows.size(); ++f) {
    const double *row = &rows[f * OF_FRAME];
    Frame frame;
    if (!whole(row[0], 0, int(motion.bodies.size()) - 1, frame.body)) return false;
    std::copy(row + 1, row + 10, frame.R);
    std::copy(row + 10, row + 13, frame.p);
    motion.frames.push_back(frame);
  }
  return true;
}

// Motion(n, first_row, base, bodies, frames)
PyObject *make_motion(PyTypeObject *type, PyObject *given, PyObject *) {
  Motion motion;
  std::vector<double> rows;
  PyObject *base, *bodies, *frames;
  if (!PyArg_ParseTuple(given, "iiOOO", &motion.n, &motion.first_row, &base, &bodies, &frames))
    return nullptr;
  try {
    if (!read_all(base, rows) || !read_base(rows, motion))
      return refuse("a base has the rows 0 to 5 of a twist");
    if (motion.n < motion.first_column || motion.n > MOST
        || motion.first_row < 0 || motion.first_row > MOST
        || !read_rows(bodies, OF_BODY, rows) || !read_bodies(rows, motion)
        || !read_rows(frames, OF_FRAME, rows) || !read_frames(rows, motion))
      return refuse("bodies and frames do not fit together");
    motion.prepare();
    return keep<Motion>(type, std::move(motion));
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
}

// move(q, offset, placement): ValueError where these are no positions, and nothing has changed.
PyObject *move(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 3) return refuse("move(q, offset, placement)");
  Motion &motion = of<Motion>(self);
  double placement[7], *base = given[2] == Py_None ? nullptr : placement;
  if (!read(given[0], LARGEST, motion.q()) || !read(given[1], HUGE_VAL, motion.offset())
      || (base && !read(given[2], 7, HUGE_VAL, base)) || !base != motion.base.empty())
    return refuse("these are no positions of the robot");
  motion.move(base);
  return Py_NewRef(Py_None);
}

// The index of a frame, −1 the root; −2 where it is none.
long frame_of(const Motion &motion, PyObject *object) {
  const long frame = PyLong_AsLong(object);
  if (frame == -1 && PyErr_Occurred()) {
    PyErr_Clear();
    return -2;
  }
  return frame >= -1 && frame < long(motion.frames.size()) ? frame : -2;
}

// place(frame, T): fill in T_root_frame (4, 4).
PyObject *place(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  const Motion &motion = of<Motion>(self);
  const long frame = count == 2 ? frame_of(motion, given[0]) : -1;
  const Output T(frame < 0 ? nullptr : given[1]);
  if (!T.is(4, 4)) return refuse("place(frame, T)");
  const Placement its = motion.placement(int(frame));
  for (int i = 0; i < 3; ++i) {
    std::copy(its.R + 3 * i, its.R + 3 * i + 3, T.p() + 4 * i);
    T.p()[4 * i + 3] = its.p[i];
    T.p()[12 + i] = 0.0;
  }
  T.p()[15] = 1.0;
  return Py_NewRef(Py_None);
}

// jacobian(frame, J): fill in J (6, n), in the axes of the root.
PyObject *jacobian(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  const Motion &motion = of<Motion>(self);
  const long frame = count == 2 ? frame_of(motion, given[0]) : -1;
  const Output J(frame < 0 ? nullptr : given[1]);
  if (!J.is(6, motion.n)) return refuse("jacobian(frame, J)");
  motion.jacobian(int(frame), motion.placement(int(frame)).p, J.p());
  return Py_NewRef(Py_None);
}

PyMethodDef MOTION_METHODS[] = {
    method("move", move, "Move to other positions."),
    method("place", place, "Place a frame."),
    method("jacobian", jacobian, "Return the Jacobian of a frame."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
