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

// What a cycle asks of a robot, compiled: where its frames are, how its joints move them, how far a
// frame is from a goal, and how fast its joints may be. Python files are the reference, read them
// first: state.py, ../tasks/frame.py with pose.py, and ../control/velocity_limits.py. Whatever does
// not fit here (another shape or type, numbers that are not finite) is refused; of a task, which may
// be of another package, with False, and the reference says what is wrong.

#include "../solver/border.h"

#include <algorithm>
#include <cmath>
#include <new>
#include <vector>

namespace {

// Constants of the reference; a test holds them equal (CONSTANTS below).
constexpr double LARGEST = 1e9;                                                 // state.py
constexpr double HALF_TURN_BAND = 0.1;                                          // spatial.py
constexpr double RETURN_SHARE = 0.2, RETURN_SPEED = 1.0, FAR = 1e6;             // velocity_limits.py

constexpr double PI = 3.14159265358979323846;
// Half of an angle below which its sine is the angle, to the last digit.
constexpr double TINY = 1e-9;

// ------------------------------------------------------------------ vectors (3,), matrices (3, 3)

inline double dot(const double *a, const double *b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

inline void cross(const double *a, const double *b, double *c) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

inline void subtract(const double *a, const double *b, double *c) {
  for (int i = 0; i < 3; ++i) c[i] = a[i] - b[i];
}

// y = A x
inline void apply(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; ++i) y[i] = dot(A + 3 * i, x);
}

// y = Aᵀ x
inline void apply_transposed(const double *A, const double *x, double *y) {
  for (int i = 0; i < 3; ++i) y[i] = A[i] * x[0] + A[3 + i] * x[1] + A[6 + i] * x[2];
}

// C = A B
inline void multiply(const double *A, const double *B, double *C) {
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}

// The rotation by an angle about an axis of length 1 (Rodrigues).
void rotation_about(const double *a, double angle, double *R) {
  const double s = std::sin(angle), c = std::cos(angle), t = 1.0 - c;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j) R[3 * i + j] = t * a[i] * a[j] + (i == j ? c : 0.0);
  R[1] -= s * a[2];
  R[2] += s * a[1];
  R[3] += s * a[2];
  R[5] -= s * a[0];
  R[6] -= s * a[1];
  R[7] += s * a[0];
}

void rotation_of(const double *quat_xyzw, double *R) {
  const double x = quat_xyzw[0], y = quat_xyzw[1], z = quat_xyzw[2], w = quat_xyzw[3];
  const double rows[9] = {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
                          2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
                          2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)};
  std::copy(rows, rows + 9, R);
}

// The rotation vector of a matrix, by its quaternion: exact for small and for half turns, too.
void rotation_vector(const double *R, double *vector) {
  const double trace = R[0] + R[4] + R[8];
  int i = 0;
  for (int k = 1; k < 3; ++k)
    if (R[4 * k] > R[4 * i]) i = k;
  double w, v[3];
  // Four times the largest component of the quaternion, squared, is at least 1.
  if (trace > R[4 * i]) {
    w = 1.0 + trace;
    v[0] = R[7] - R[5];
    v[1] = R[2] - R[6];
    v[2] = R[3] - R[1];
  } else {
    const int j = (i + 1) % 3, k = (i + 2) % 3;
    w = R[3 * k + j] - R[3 * j + k];
    v[i] = 1.0 + R[4 * i] - R[4 * j] - R[4 * k];
    v[j] = R[3 * i + j] + R[3 * j + i];
    v[k] = R[3 * i + k] + R[3 * k + i];
  }
  const double size = std::sqrt(dot(v, v)), sign = w < 0.0 ? -1.0 : 1.0;
  const double share = size > TINY * std::fabs(w) ? 2.0 * std::atan2(size, std::fabs(w)) / size
                                                  : 2.0 / std::fabs(w);
  for (int k = 0; k < 3; ++k) vector[k] = sign * share * v[k];
}

// spatial.py: `shorter_rotation`, in place
void follow(const double *previous, double *vector) {
  if (dot(vector, previous) >= 0.0) return;
  const double angle = std::sqrt(dot(vector, vector));
  if (angle < PI - HALF_TURN_BAND) return;
  for (int i = 0; i < 3; ++i) vector[i] *= (angle - 2.0 * PI) / angle;
}

// ------------------------------------------------------------------ kinematics

enum Kind { STILL, FREE, TURNS, SLIDES };

// A body: how it hangs on the one before, and the joint between them.
struct Body {
  Kind kind;
  int parent, column;                    // −1: no velocity moves the joint
  double share;                          // of the position in that column (mimic)
  double axis[3], R[9], p[3];
};

struct Frame {
  int body;
  double R[9], p[3];
};

struct Placement {
  double R[9], p[3];
};

class Motion {
 public:
  int n = 0, first_row = 0, first_column = 0;
  std::vector<Body> bodies;              // the first is the root
  std::vector<Frame> frames;
  std::vector<int> base;                 // rows of the twist of the base that are velocities

  void prepare() {
    const Placement still = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    placed_.assign(bodies.size(), still);
    axes_.assign(3 * bodies.size(), 0.0);
    J_.assign(12 * size_t(n), 0.0);
    q_.assign(size_t(first_row + columns()), 0.0);
    offset_.assign(size_t(std::count_if(bodies.begin(), bodies.end(), [](const Body &body) {
      return body.kind == TURNS || body.kind == SLIDES;
    })), 0.0);
  }

  int columns() const { return n - first_column; }

  // Where arguments of `move` are read to.
  std::vector<double> &q() { return q_; }
  std::vector<double> &offset() { return offset_; }

  // Move to q; `offset` is what is added to the position of each joint.
  void move(const double *placement) {
    const double *driven = q_.data() + first_row;
    size_t joint = 0;
    for (size_t b = 1; b < bodies.size(); ++b) {
      const Body &body = bodies[b];
      Placement &at = placed_[b];
      if (body.kind == FREE) {
        std::copy(placement, placement + 3, at.p);
        rotation_of(placement + 3, at.R);
        continue;
      }
      const double value = offset_[joint++]
          + (body.column < 0 ? 0.0 : body.share * driven[body.column]);
      const Placement &on = placed_[body.parent];
      double R[9], turned[9], p[3];
      multiply(on.R, body.R, R);
      apply(on.R, body.p, p);
      double *axis = &axes_[3 * b];
      apply(R, body.axis, axis);
      if (body.kind == TURNS) {
        rotation_about(body.axis, value, turned);
        multiply(R, turned, at.R);
      } else {
        std::copy(R, R + 9, at.R);
      }
      for (int i = 0; i < 3; ++i)
        at.p[i] = on.p[i] + p[i] + (body.kind == SLIDES ? value * axis[i] : 0.0);
    }
  }

  Placement placement(int frame) const {
    const Frame &its = frames[frame];
    const Placement &on = placed_[its.body];
    Placement found;
    multiply(on.R, its.R, found.R);
    apply(on.R, its.p, found.p);
    for (int i = 0; i < 3; ++i) found.p[i] += on.p[i];
    return found;
  }

  // J (6, n) of a frame that is at p, in the axes of the root.
  void jacobian(int frame, const double *p, double *J) const {
    std::fill(J, J + 6 * size_t(n), 0.0);
    for (int b = frames[frame].body; b > 0; b = bodies[b].parent) {
      const Body &body = bodies[b];
      if (body.kind == FREE) {
        add_base(placed_[b], p, J);
      } else if (body.column >= 0) {
        const int column = first_column + body.column;
        const double *axis = &axes_[3 * b];
        if (body.kind == TURNS) turn(axis, placed_[b].p, p, body.share, J + column);
        else slide(axis, body.share, J + column);
      }
    }
  }

  // The error (6,) of a frame, and J (6, n); both as a reference frame sees them, −1 the root.
  const double *observe(int frame, int reference, const double *p_goal, const double *R_goal,
                        bool turns, double *error) {
    double *J = J_.data();
    Placement its = placement(frame);
    jacobian(frame, its.p, J);
    if (reference >= 0) its = seen_from(its, reference, J);
    subtract(p_goal, its.p, error);
    if (turns) {
      double turn[9];
      for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) turn[3 * i + j] = dot(R_goal + 3 * i, its.R + 3 * j);
      rotation_vector(turn, error + 3);
    }
    return J;
  }

 private:
  // frame.py: `RelativeFrame`, with J (6, n) in place
  Placement seen_from(const Placement &its, int reference, double *J) {
    const Placement from = placement(reference);
    double *moves = J_.data() + 6 * size_t(n), between[3];
    jacobian(reference, from.p, moves);
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

  void turn(const double *axis, const double *at, const double *p, double share, double *J) const {
    double arm[3], v[3];
    subtract(p, at, arm);
    cross(axis, arm, v);
    for (int i = 0; i < 3; ++i) {
      J[i * n] += share * v[i];
      J[(3 + i) * n] += share * axis[i];
    }
  }

  void slide(const double *axis, double share, double *J) const {
    for (int i = 0; i < 3; ++i) J[i * n] += share * axis[i];
  }

  // The base moves and turns about axes of its own.
  void add_base(const Placement &at, const double *p, double *J) const {
    for (size_t c = 0; c < base.size(); ++c) {
      const int row = base[c] % 3;
      const double axis[3] = {at.R[row], at.R[3 + row], at.R[6 + row]};
      if (base[c] < 3) slide(axis, 1.0, J + c);
      else turn(axis, at.p, p, 1.0, J + c);
    }
  }

  std::vector<Placement> placed_;
  std::vector<double> axes_, J_, q_, offset_;
};

// ------------------------------------------------------------------ velocity_limits.py

class Limits {
 public:
  double period = 0.0, gain = 0.0;
  bool endless = false;                  // there are joints without position limits
  std::vector<double> lower, upper, velocity, acceleration;  // of accelerations, none where empty

  static constexpr int ROWS = 8;

  // Fill in what `bounded` returns (8, n).
  void at(const Buffer &q, const Buffer &previous, double elapsed, const Buffer &pending,
          double duration, double *rows) const {
    const size_t n = lower.size();
    const double delay = double(pending.rows(2));
    const double g = delay > 0.0 ? std::min(gain, calm_gain(delay) / duration) : gain;
    for (size_t j = 0; j < n; ++j) {
      double *row = rows + j;
      const double back = std::min(RETURN_SHARE * velocity[j], RETURN_SPEED);
      double upwards = 0.0, downwards = 0.0;
      for (Py_ssize_t i = 0; i < pending.rows(2); ++i) {
        upwards += std::max(pending.at(i, j), 0.0);
        downwards += std::max(-pending.at(i, j), 0.0);
      }
      upwards *= duration;
      downwards *= duration;
      const double above = felt(upper[j] - q.at(j), upwards, downwards);
      const double below = felt(q.at(j) - lower[j], downwards, upwards);
      const double up = std::max(braking_speed(above, g, j), -back);
      const double down = std::max(braking_speed(below, g, j), -back);
      double most = std::min(up, velocity[j]), least = -std::min(down, velocity[j]);
      if (most < least) {
        // Coming back from outside must not be faster than it can stop at the other end.
        most = std::max(most, std::min(least, 0.0));
        least = std::min(least, most);
      }
      row[2 * n] = least;
      row[3 * n] = most;
      row[4 * n] = up;
      row[5 * n] = down;
      row[6 * n] = up;
      row[7 * n] = down;
      if (!acceleration.empty()) {
        const double change = acceleration[j] * std::min(elapsed, period);
        const double slowest = previous.at(j) - change, fastest = previous.at(j) + change;
        most = std::min(std::max(most, slowest), fastest);
        least = std::min(std::max(least, slowest), fastest);
        row[6 * n] = slowest;
        row[7 * n] = fastest;
      }
      row[0] = least;
      row[n] = most;
    }
  }

 private:
  // The distance nearest to zero that commands under way can leave.
  double felt(double distance, double towards, double away) const {
    if (endless) distance = std::min(distance, FAR);
    return std::max(distance - towards, std::min(distance + away, 0.0));
  }

  // The largest K for which x[k+1] = x[k] − K x[k−delay] does not oscillate.
  static double calm_gain(double delay) {
    return std::pow(delay, delay) / std::pow(delay + 1.0, delay + 1.0);
  }

  double braking_speed(double distance, double g, size_t j) const {
    if (acceleration.empty()) return g * distance;
    const double change = acceleration[j] * period, slow = acceleration[j] / (g * g);
    const double beyond = std::max(distance - slow, 0.0) / (change * period);
    const double pieces = 1.0 + 2.0 / (g * period);
    const double steps = std::ceil(0.5 * (std::sqrt(pieces * pieces + 8.0 * beyond) - pieces));
    return (distance + steps * change * (0.5 * (steps - 1.0) * period + 1.0 / g))
        / (steps * period + 1.0 / g);
  }
};

// ------------------------------------------------------------------ what Python sees

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

constexpr int OF_BODY = 19, OF_FRAME = 13;

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
  const double *all = motion.observe(int(frame), int(reference), goal.p, goal.R,
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

PyMethodDef MOTION_METHODS[] = {
    method("move", move, "Move to other positions."),
    method("place", place, "Place a frame."),
    method("jacobian", jacobian, "Return how joints move a frame."),
    method("observe", observe, "Observe how far a frame is from a goal."),
    {nullptr, nullptr, 0, nullptr}};
PyMethodDef LIMITS_METHODS[] = {
    method("at", limits_at, "Find how fast joints may be."),
    {nullptr, nullptr, 0, nullptr}};
PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "motion", "What a cycle asks of a robot, compiled.",
                      -1, nullptr, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit_motion(void) {
  return make_module(MODULE, {
      {"Motion", make_type<Motion>("tp_controller.model.motion.Motion", make_motion,
                                   MOTION_METHODS)},
      {"Limits", make_type<Limits>("tp_controller.model.motion.Limits", make_limits,
                                   LIMITS_METHODS)},
      {"CONSTANTS", Py_BuildValue(
          "{s:n,s:d,s:d,s:d,s:d,s:d}", "MOST", MOST, "LARGEST", LARGEST,
          "HALF_TURN_BAND", HALF_TURN_BAND, "RETURN_SHARE", RETURN_SHARE,
          "RETURN_SPEED", RETURN_SPEED, "FAR", FAR)}});
}
