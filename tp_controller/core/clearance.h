// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// Distances between pairs of solids in closed form, and the pairs that are left to Coal.
// Reference: tp_controller/model/clearance.py

#pragma once

#include "motion_object.h"

#include <array>

namespace {

// Constants of the reference.
constexpr double PATCH_TOLERANCE = 0.003;
constexpr double BOUND_MARGIN = 1e-6, LEAST_ANGLE = 0.03, LEAST_GAP = 1e-3, LEAST_RISE = 1e-9;

// Coal counts what is this much farther away as near, too.
constexpr double AT_THE_MARGIN = 1e-12;

// A line: all points within a distance of a line along z, of length zero for a ball. A plane:
// what is below z = 0.
enum SolidKind { OTHER, LINE, PLANE };

struct Solid {
  int frame;
  SolidKind shape;
  double half[3];                        // of the box around it, in its axes
  Placement on;                          // the frame

  double radius() const { return half[0]; }
  double half_length() const { return half[2] - half[0]; }
};

// A solid in the root, with its axis z and the radius of a ball around it.
struct Placed : Placement {
  double axis[3], ball;
};

struct Gap {
  double distance, normal[3], point[3];  // as the reference has them
};

class Clearance {
 public:
  std::vector<Solid> solids;
  std::vector<std::array<int, 2>> pairs;
  double within = 0.0;
  int frames = 0;                        // least number of frames of a robot with these solids
  std::vector<int> near, left;           // indices of measured pairs, and of those left to Coal
  std::vector<Gap> gaps;

  // Add what Coal has found in the order of the pairs, from a place on; return the next place.
  size_t insert(int pair, const Gap &gap, size_t begin) {
    const auto at = std::upper_bound(near.begin() + begin, near.end(), pair);
    const size_t place = size_t(at - near.begin());
    near.insert(at, pair);
    gaps.insert(gaps.begin() + place, gap);
    return place + 1;
  }

  void append(int pair, const Gap &gap) {
    near.push_back(pair);
    gaps.push_back(gap);
  }

  // `close`: corners of pairs nearer than this are needed; only Coal finds them.
  void measure(const Motion &motion, double close) {
    place(motion);
    near.clear();
    left.clear();
    gaps.clear();
    for (size_t pair = 0; pair < pairs.size(); ++pair) {
      const Solid &a = solids[pairs[pair][0]], &b = solids[pairs[pair][1]];
      const Placed &A = placed_[pairs[pair][0]], &B = placed_[pairs[pair][1]];
      if (is_far(a, A, b, B)) continue;
      Gap gap;
      const bool measured = a.shape == LINE && b.shape != OTHER
          && (b.shape == PLANE ? above(a, A, B, gap) : between(a, A, b, B, gap));
      if (measured && gap.distance - within > AT_THE_MARGIN) continue;
      if (!measured || (gap.distance < close && is_flat(a, A, gap)
                        && (b.shape == PLANE || is_flat(b, B, gap)))) {
        left.push_back(int(pair));
      } else {
        append(int(pair), gap);
      }
    }
  }

 private:
  void place(const Motion &motion) {
    placed_.resize(solids.size());
    for (size_t s = 0; s < solids.size(); ++s) {
      const Solid &its = solids[s];
      const Placement frame = motion.placement(its.frame);
      Placed &at = placed_[s];
      multiply(frame.R, its.on.R, at.R);
      apply(frame.R, its.on.p, at.p);
      for (int i = 0; i < 3; ++i) {
        at.p[i] += frame.p[i];
        at.axis[i] = at.R[3 * i + 2];
      }
      at.ball = std::sqrt(dot(its.half, its.half));
    }
  }

  // Whether a lower bound of the distance says that a pair is not near.
  bool is_far(const Solid &a, const Placed &A, const Solid &b, const Placed &B) const {
    const double enough = within + BOUND_MARGIN;
    if (b.shape != PLANE)
      return to_box(A.p, b, B) - A.ball > enough || to_box(B.p, a, A) - B.ball > enough;
    double arm[3], normal[3], below = 0.0;
    subtract(A.p, B.p, arm);
    apply_transposed(A.R, B.axis, normal);
    for (int i = 0; i < 3; ++i) below += a.half[i] * std::fabs(normal[i]);
    return dot(arm, B.axis) - below > enough;
  }

  // The distance of a point from the box around a solid.
  static double to_box(const double *p, const Solid &its, const Placed &at) {
    double arm[3], local[3], square = 0.0;
    subtract(p, at.p, arm);
    apply_transposed(at.R, arm, local);
    for (int i = 0; i < 3; ++i) {
      const double outside = std::max(std::fabs(local[i]) - its.half[i], 0.0);
      square += outside * outside;
    }
    return std::sqrt(square);
  }

  // Whether a whole side of a line faces along the normal.
  static bool is_flat(const Solid &its, const Placed &at, const Gap &gap) {
    const double length = 2.0 * its.half_length();
    return length > 0.0
        && length * std::fabs(dot(at.axis, gap.normal)) <= (1.0 + BOUND_MARGIN) * PATCH_TOLERANCE;
  }

  // From a line to a plane below it; false where both ends are as near.
  static bool above(const Solid &a, const Placed &A, const Placed &B, Gap &gap) {
    const double rise = a.half_length() * dot(A.axis, B.axis);
    if (a.half_length() > 0.0 && std::fabs(rise) < LEAST_RISE) return false;
    double end[3], arm[3];
    for (int i = 0; i < 3; ++i) {
      gap.normal[i] = B.axis[i];
      end[i] = A.p[i] - (rise > 0.0 ? 1.0 : rise < 0.0 ? -1.0 : 0.0) * a.half_length() * A.axis[i]
          - a.radius() * gap.normal[i];
    }
    subtract(end, B.p, arm);
    gap.distance = dot(arm, gap.normal);
    for (int i = 0; i < 3; ++i) gap.point[i] = end[i] - 0.5 * gap.distance * gap.normal[i];
    return true;
  }

  // Between two lines, by the nearest points p + s u of each: Ericson, Real-Time Collision
  // Detection. False where they are too parallel or too near each other for all digits.
  static bool between(const Solid &a, const Placed &A, const Solid &b, const Placed &B, Gap &gap) {
    const double h = a.half_length(), k = b.half_length();
    double r[3];
    subtract(A.p, B.p, r);
    const double both = dot(A.axis, B.axis), c = dot(A.axis, r), f = dot(B.axis, r);
    const double turned = 1.0 - both * both;
    double s = 0.0, t = 0.0;
    if (h > 0.0 && k > 0.0) {
      if (turned < LEAST_ANGLE * LEAST_ANGLE) return false;
      s = limited((both * f - c) / turned, h);
    }
    t = both * s + f;
    if (std::fabs(t) >= k) {
      t = limited(t, k);
      s = limited(both * t - c, h);
    }
    double way[3];
    for (int i = 0; i < 3; ++i) way[i] = r[i] + s * A.axis[i] - t * B.axis[i];
    const double length = std::sqrt(dot(way, way));
    if (length < LEAST_GAP) return false;
    gap.distance = length - (a.radius() + b.radius());
    for (int i = 0; i < 3; ++i) {
      gap.normal[i] = way[i] / length;
      const double one = A.p[i] + s * A.axis[i], other = B.p[i] + t * B.axis[i];
      gap.point[i] = 0.5 * (one + other + (b.radius() - a.radius()) * gap.normal[i]);
    }
    return true;
  }

  static double limited(double value, double most) {
    return std::min(std::max(value, -most), most);
  }

  std::vector<Placed> placed_;
};

constexpr int OF_SOLID = 17;

bool read_solids(const std::vector<double> &rows, Clearance &its) {
  for (size_t s = 0; s * OF_SOLID < rows.size(); ++s) {
    const double *row = &rows[s * OF_SOLID];
    Solid solid;
    int shape;
    if (!whole(row[0], 0, int(MOST) - 1, solid.frame) || !whole(row[1], OTHER, PLANE, shape))
      return false;
    solid.shape = SolidKind(shape);
    std::copy(row + 2, row + 5, solid.half);
    std::copy(row + 5, row + 14, solid.on.R);
    std::copy(row + 14, row + 17, solid.on.p);
    its.frames = std::max(its.frames, solid.frame + 1);
    its.solids.push_back(solid);
  }
  return true;
}

// [(int, int), …]: only the second may be a plane.
bool read_solid_pairs(PyObject *list, Clearance &its) {
  for (Py_ssize_t p = 0; p < PyList_Size(list); ++p) {
    PyObject *pair = PyList_GetItem(list, p);
    if (!PyTuple_Check(pair) || PyTuple_Size(pair) != 2) return false;
    std::array<int, 2> both;
    for (int end = 0; end < 2; ++end) {
      const long solid = PyLong_AsLong(PyTuple_GetItem(pair, end));
      if (solid < 0 || solid >= long(its.solids.size())) return false;
      both[size_t(end)] = int(solid);
    }
    if (its.solids[both[0]].shape == PLANE) return false;
    its.pairs.push_back(both);
  }
  return true;
}

// Clearance(solids, pairs, within)
PyObject *make_clearance(PyTypeObject *type, PyObject *given, PyObject *) {
  Clearance its;
  std::vector<double> rows;
  PyObject *solids, *pairs;
  if (!PyArg_ParseTuple(given, "OO!d", &solids, &PyList_Type, &pairs, &its.within)) return nullptr;
  try {
    if (read_rows(solids, OF_SOLID, rows) && read_solids(rows, its)
        && read_solid_pairs(pairs, its)) return keep<Clearance>(type, std::move(its));
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  PyErr_Clear();
  return refuse("solids and pairs do not fit together");
}

PyObject *list_of(const std::vector<int> &numbers) {
  Held list(PyList_New(Py_ssize_t(numbers.size())));
  for (size_t i = 0; list && i < numbers.size(); ++i) {
    PyObject *each = PyLong_FromLong(numbers[i]);
    if (!each || PyList_SetItem(list, Py_ssize_t(i), each) != 0) return nullptr;
  }
  return list.release();
}

// Distances (m,), normals (m, 3) and points (m, 3), one after the other.
PyObject *bytes_of(const std::vector<Gap> &gaps) {
  const size_t m = gaps.size();
  PyObject *bytes = PyBytes_FromStringAndSize(nullptr, Py_ssize_t(7 * m * sizeof(double)));
  if (!bytes) return nullptr;
  char *at = PyBytes_AsString(bytes);
  for (size_t i = 0; i < m; ++i) {
    std::memcpy(at + i * sizeof(double), &gaps[i].distance, sizeof(double));
    std::memcpy(at + (m + 3 * i) * sizeof(double), gaps[i].normal, sizeof(gaps[i].normal));
    std::memcpy(at + (4 * m + 3 * i) * sizeof(double), gaps[i].point, sizeof(gaps[i].point));
  }
  return bytes;
}

// measure(motion, close): pairs, pairs that are left, and numbers of the former.
PyObject *measure(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  Clearance &its = of<Clearance>(self);
  const Motion *motion = count == 2 ? find<Motion>(given[0]) : nullptr;
  const double close = motion ? PyFloat_AsDouble(given[1]) : 0.0;
  if (!motion || PyErr_Occurred() || its.frames > int(motion->frames.size())) {
    PyErr_Clear();
    return refuse("measure(motion, close)");
  }
  try {
    its.measure(*motion, close);
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  const Held near(list_of(its.near)), left(list_of(its.left)), numbers(bytes_of(its.gaps));
  if (!near || !left || !numbers) return nullptr;
  return PyTuple_Pack(3, static_cast<PyObject *>(near), static_cast<PyObject *>(left),
                      static_cast<PyObject *>(numbers));
}

// A contact of Coal, whose normal goes the other way; false where Coal has not found it.
bool read_contact(PyObject *depth, PyObject *way, PyObject *point, Gap &gap) {
  const Buffer normal(way), middle(point);
  if (!PyFloat_Check(depth) || !normal.is(3) || !middle.is(3)) return false;
  gap.distance = PyFloat_AsDouble(depth);
  middle.copy(gap.point);
  for (int i = 0; i < 3; ++i) gap.normal[i] = -normal.at(i);
  return std::isfinite(dot(gap.normal, gap.normal));
}

// merge(pairs, nearest, depths, ways, points): the pairs that were measured, and others that Coal
// has, of which the first are nearest points and the rest corners; and all numbers. None where Coal
// has not found all of them.
PyObject *merge(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  Clearance &its = of<Clearance>(self);
  const Py_ssize_t nearest = count == 5 ? PyLong_AsSsize_t(given[1]) : -1;
  bool fits = nearest >= 0;
  PyErr_Clear();
  for (int list : {0, 2, 3, 4})
    fits = fits && PyList_Check(given[list]) && PyList_Size(given[list]) == PyList_Size(given[0]);
  if (!fits) return refuse("merge(pairs, nearest, depths, ways, points)");
  try {
    size_t place = 0;
    for (Py_ssize_t i = 0; i < PyList_Size(given[0]); ++i) {
      const long pair = PyLong_AsLong(PyList_GetItem(given[0], i));
      Gap gap;
      if (PyErr_Occurred() || pair < 0 || pair >= long(its.pairs.size())
          || !read_contact(PyList_GetItem(given[2], i), PyList_GetItem(given[3], i),
                           PyList_GetItem(given[4], i), gap)) {
        PyErr_Clear();
        return Py_NewRef(Py_None);
      }
      if (i < nearest) place = its.insert(int(pair), gap, place);
      else its.append(int(pair), gap);
    }
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  const Held near(list_of(its.near)), numbers(bytes_of(its.gaps));
  if (!near || !numbers) return nullptr;
  return PyTuple_Pack(2, static_cast<PyObject *>(near), static_cast<PyObject *>(numbers));
}

PyMethodDef CLEARANCE_METHODS[] = {
    method("measure", measure, "Measure the distances of pairs."),
    method("merge", merge, "Add the distances that Coal has found."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
