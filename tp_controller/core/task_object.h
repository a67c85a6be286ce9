// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// `Task` as Python has it: the inputs of a task, which it evaluates.
// Reference: tp_controller/tasks/twin.py

#pragma once

#include "center_of_mass_task.h"
#include "com_polygon_task.h"
#include "cone_task.h"
#include "frame_task.h"
#include "joint_limit_distance_task.h"
#include "joint_limits_task.h"
#include "motion_object.h"
#include "orientation_range_task.h"
#include "pointing_task.h"
#include "region_task.h"
#include "solver_object.h"
#include "speed_limit_task.h"

namespace {

// A task, and the arrays of Python that have its memory.
struct TaskTwin {
  std::unique_ptr<Task> task;
  std::vector<std::unique_ptr<Output>> memory;

  bool read_memory(PyObject *object) {
    memory.emplace_back(new Output(object, MOST * MOST));
    return memory.back()->rows(1) >= 0;
  }

  // The array that was read last.
  Kept kept() const {
    return memory.empty() ? Kept{} : Kept{memory.back()->p(), size_t(memory.back()->rows(1))};
  }
};

// A number for each row, or one for all, also in an array.
bool read_rows_of(PyObject *object, int rows, std::vector<double> &found) {
  const Buffer buffer(object);
  if (!buffer.is_number() && !buffer.is(1) && !buffer.is(rows)) return false;
  for (int i = 0; i < rows; ++i)
    found.push_back(buffer.is_number() ? buffer.number() : buffer.at(buffer.is(1) ? 0 : i));
  return true;
}

// (rows, scale, gain, feed_forward or None, fed, timeout, joints or None,
// weights or None)
bool read_law(PyObject *object, Law &law) {
  int scale;
  PyObject *gain, *feed_forward, *joints, *weights;
  if (!PyArg_ParseTuple(object, "ipOOddOO", &law.rows, &scale, &gain, &feed_forward, &law.fed,
                        &law.timeout, &joints, &weights)) return false;
  law.scale = scale;
  if (joints != Py_None) {
    const Py_ssize_t n = PyObject_Size(joints);
    law.joints.resize(n > 0 && n <= MOST ? size_t(n) : 0);
    if (law.joints.empty()
        || !read_mask(joints, Py_ssize_t(law.joints.size()), law.joints.data())) return false;
  }
  return law.rows >= 1 && law.rows <= MOST && read_rows_of(gain, law.rows, law.gain)
      && (weights == Py_None || read_rows_of(weights, law.rows, law.weights))
      && (feed_forward == Py_None || read_all(feed_forward, law.feed_forward));
}

bool read_turn(PyObject *object, TaskTwin &twin) {
  return twin.read_memory(object) && twin.kept().size == 4;
}

// A position (3,), a rotation (3, 3), a pose (4, 4), or None.
bool read_goal(PyObject *object, FrameGoal &goal) {
  if (object == Py_None) return true;
  double T[16];
  const Buffer given(object);
  goal.is_position = given.is(3) || given.is(4, 4);
  goal.is_rotation = given.is(3, 3) || given.is(4, 4);
  if (given.is(3)) given.copy(goal.p);
  if (given.is(3, 3)) given.copy_rows(goal.R);
  if (given.is(4, 4)) {
    given.copy_rows(T);
    for (int i = 0; i < 3; ++i) {
      std::copy(T + 4 * i, T + 4 * i + 3, goal.R + 3 * i);
      goal.p[i] = T[4 * i + 3];
    }
  }
  return goal.is_position || goal.is_rotation;
}

// (frame, reference, rows, goal or None, turn or None); reference −1: the root
bool read_frame_task(PyObject *object, Law law, TaskTwin &twin) {
  int frame, reference;
  const char *rows;
  Py_ssize_t m;
  PyObject *goal, *turn;
  FrameGoal its;
  if (!PyArg_ParseTuple(object, "iiy#OO", &frame, &reference, &rows, &m, &goal, &turn)
      || m != law.rows || m > 6 || frame < 0 || reference < -1 || !read_goal(goal, its))
    return false;
  for (Py_ssize_t i = 0; i < m; ++i)
    if (rows[i] < 0 || rows[i] > 5
        || (goal != Py_None && !(rows[i] < 3 ? its.is_position : its.is_rotation))) return false;
  if (its.is_rotation && !read_turn(turn, twin)) return false;
  twin.task.reset(new FrameTask(std::move(law), frame, reference, rows, its, twin.kept()));
  return true;
}

// Indices, as numbers, one for each row.
bool read_indices(PyObject *object, int rows, std::vector<int> &found) {
  std::vector<double> numbers;
  if (!read_all(object, numbers) || numbers.size() != size_t(rows)) return false;
  found.resize(numbers.size());
  for (size_t i = 0; i < numbers.size(); ++i)
    if (!whole(numbers[i], 0, int(MOST) - 1, found[i])) return false;
  return true;
}

// Indices of velocities, and whether these are all in their order.
bool read_columns(PyObject *object, int rows, bool all, JointColumns &columns) {
  columns.all = all;
  return read_indices(object, rows, columns.at);
}

// (columns, all, goal or None, wraps)
bool read_joint_task(PyObject *object, Law law, TaskTwin &twin) {
  PyObject *indices, *given, *turns;
  int all;
  JointColumns columns;
  std::vector<double> goal, wraps;
  if (!PyArg_ParseTuple(object, "OpOO", &indices, &all, &given, &turns)
      || !read_columns(indices, law.rows, all, columns)
      || (given != Py_None && !read_rows_of(given, law.rows, goal))
      || !read_rows_of(turns, law.rows, wraps)) return false;
  twin.task.reset(new JointTask(std::move(law), std::move(columns), std::move(goal),
                                std::vector<bool>(wraps.begin(), wraps.end())));
  return true;
}

// (columns, lower, upper, return_speed)
bool read_joint_limits_task(PyObject *object, Law law, TaskTwin &twin) {
  PyObject *indices, *low, *high;
  double return_speed;
  JointColumns columns;
  std::vector<double> lower, upper;
  if (!PyArg_ParseTuple(object, "OOOd", &indices, &low, &high, &return_speed)
      || !read_columns(indices, law.rows, false, columns) || !read_rows_of(low, law.rows, lower)
      || !read_rows_of(high, law.rows, upper)) return false;
  twin.task.reset(new JointLimitsTask(std::move(law), std::move(columns), std::move(lower),
                                      std::move(upper), return_speed));
  return true;
}

bool read_vectors(PyObject *object, Py_ssize_t rows, double *found) {
  const Buffer buffer(object);
  if (!buffer.is(rows, 3)) return false;
  buffer.copy_rows(found);
  return true;
}

// (frame, reference, whether the goal is a point, goal, axis, across, upright or None, turn)
bool read_axis_task(PyObject *object, Law law, TaskTwin &twin) {
  PointingAxis axis;
  Aim aim;
  int is_point;
  PyObject *goal, *its, *across, *upright, *turn;
  if (!PyArg_ParseTuple(object, "iipOOOOO", &axis.frame, &aim.reference, &is_point, &goal, &its,
                        &across, &upright, &turn)
      || axis.frame < 0 || aim.reference < -1 || !read(goal, 3, HUGE_VAL, aim.goal)
      || !read(its, 3, HUGE_VAL, axis.its) || !read_vectors(across, 2, axis.across)
      || !read_turn(turn, twin)) return false;
  aim.is_point = is_point;
  axis.is_upright = upright != Py_None;
  if (law.rows != 2 + axis.is_upright
      || (axis.is_upright && !read_vectors(upright, 2, axis.upright))) return false;
  twin.task.reset(new AxisTask(std::move(law), axis, aim, twin.kept()));
  return true;
}

// (axes, goal, scale)
bool read_center_of_mass_task(PyObject *object, Law law, TaskTwin &twin) {
  const char *axes;
  Py_ssize_t m;
  PyObject *given;
  double goal[3], scale;
  if (!PyArg_ParseTuple(object, "y#Od", &axes, &m, &given, &scale) || m != law.rows || m > 3
      || !read(given, 3, HUGE_VAL, goal)) return false;
  for (Py_ssize_t i = 0; i < m; ++i)
    if (axes[i] < 0 || axes[i] > 2) return false;
  twin.task.reset(new CenterOfMassTask(std::move(law), axes, goal, scale));
  return true;
}

// (frame, reference, along, most)
bool read_speed_limit_task(PyObject *object, Law law, TaskTwin &twin) {
  int frame, reference;
  PyObject *along, *most;
  std::vector<double> rows, limits;
  if (!PyArg_ParseTuple(object, "iiOO", &frame, &reference, &along, &most)
      || frame < 0 || reference < -1 || !read_rows(along, 6, rows)
      || rows.size() != 6 * size_t(law.rows) || !read_rows_of(most, law.rows, limits)) return false;
  twin.task.reset(new SpeedLimitTask(std::move(law), frame, reference, std::move(rows),
                                     std::move(limits)));
  return true;
}

// (frame, reference, inside, shape, sizes, place)
bool read_region(PyObject *object, Region &region) {
  int inside, shape;
  PyObject *given, *place;
  std::vector<double> sizes;
  FrameGoal goal;
  if (!PyArg_ParseTuple(object, "iipiOO", &region.frame, &region.reference, &inside, &shape, &given,
                        &place)
      || region.frame < 0 || region.reference < -1 || shape < Shape::BOX
      || shape > Shape::HALF_SPACE || !read_all(given, sizes)
      || int(sizes.size()) != Shape::size_count(shape) || !read_goal(place, goal)
      || !goal.is_position || !goal.is_rotation) return false;
  region.inside = inside;
  region.shape.kind = Shape::Kind(shape);
  std::copy(sizes.begin(), sizes.end(), region.shape.sizes);
  std::copy(goal.R, goal.R + 9, region.R);
  std::copy(goal.p, goal.p + 3, region.p);
  return true;
}

// (lower, upper, return_speed, jump, history)
bool read_bounds(PyObject *object, int rows, ValueBounds &bounds, TaskTwin &twin) {
  PyObject *low, *high, *history;
  return PyArg_ParseTuple(object, "OOddO", &low, &high, &bounds.return_speed, &bounds.jump, &history)
      && read_rows_of(low, rows, bounds.lower) && read_rows_of(high, rows, bounds.upper)
      && twin.read_memory(history);
}

// (region, bounds)
bool read_region_task(PyObject *object, Law law, TaskTwin &twin) {
  PyObject *given, *limits;
  Region region;
  ValueBounds bounds;
  if (!PyArg_ParseTuple(object, "O!O!", &PyTuple_Type, &given, &PyTuple_Type, &limits)
      || !read_region(given, region) || region.rows() != law.rows
      || !read_bounds(limits, law.rows, bounds, twin)) return false;
  twin.task.reset(new RegionTask(std::move(law), std::move(bounds), twin.kept(), region));
  return true;
}

// (middle, half, max_speed)
bool read_joint_limit_distance_task(PyObject *object, Law law, TaskTwin &twin) {
  PyObject *centre, *range;
  double max_speed;
  std::vector<double> middle, half;
  if (!PyArg_ParseTuple(object, "OOd", &centre, &range, &max_speed)
      || !read_rows_of(centre, law.rows, middle) || !read_rows_of(range, law.rows, half))
    return false;
  twin.task.reset(new JointLimitDistanceTask(std::move(law), max_speed, std::move(middle),
                                             std::move(half)));
  return true;
}

// (frame, reference, whether the goal is a point, goal, axis, bounds)
bool read_cone_task(PyObject *object, Law law, TaskTwin &twin) {
  int frame, is_point;
  double axis[3];
  Aim aim;
  PyObject *goal, *its, *limits;
  ValueBounds bounds;
  if (!PyArg_ParseTuple(object, "iipOOO!", &frame, &aim.reference, &is_point, &goal, &its,
                        &PyTuple_Type, &limits)
      || law.rows != 1 || frame < 0 || aim.reference < -1 || !read(goal, 3, HUGE_VAL, aim.goal)
      || !read(its, 3, HUGE_VAL, axis) || !read_bounds(limits, law.rows, bounds, twin))
    return false;
  aim.is_point = is_point;
  twin.task.reset(new ConeTask(std::move(law), std::move(bounds), twin.kept(), frame, axis, aim));
  return true;
}

// (frame, reference, axes, goal, turn, bounds)
bool read_orientation_range_task(PyObject *object, Law law, TaskTwin &twin) {
  int frame, reference;
  const char *axes;
  Py_ssize_t m;
  PyObject *given, *turn, *limits;
  FrameGoal goal;
  ValueBounds bounds;
  if (!PyArg_ParseTuple(object, "iiy#OOO!", &frame, &reference, &axes, &m, &given, &turn,
                        &PyTuple_Type, &limits)
      || m != law.rows || m > 3 || frame < 0 || reference < -1 || !read_goal(given, goal)
      || !goal.is_rotation || !read_turn(turn, twin)) return false;
  for (Py_ssize_t i = 0; i < m; ++i)
    if (axes[i] < 0 || axes[i] > 2) return false;
  const Kept direction = twin.kept();
  if (!read_bounds(limits, law.rows, bounds, twin)) return false;
  twin.task.reset(new OrientationRangeTask(std::move(law), std::move(bounds), twin.kept(), direction,
                                           frame, reference, axes, goal.R));
  return true;
}

// (frames, points, horizontal axes, bounds)
bool read_com_polygon_task(PyObject *object, Law law, TaskTwin &twin) {
  PyObject *frames, *points, *axes, *limits;
  ValueBounds bounds;
  Contacts contacts;
  if (!PyArg_ParseTuple(object, "OOOO!", &frames, &points, &axes, &PyTuple_Type, &limits)
      || !read_indices(frames, law.rows, contacts.frames)
      || !read_rows(points, 3, contacts.points)
      || contacts.points.size() != 3 * contacts.frames.size()
      || !finite(contacts.points.data(), int(contacts.points.size()))
      || !read_vectors(axes, 2, contacts.horizontal)
      || !read_bounds(limits, law.rows, bounds, twin)) return false;
  twin.task.reset(new ComPolygonTask(std::move(law), std::move(bounds), twin.kept(),
                                     std::move(contacts)));
  return true;
}

// Task(kind, law, inputs): ValueError where they do not fit.
PyObject *make_task(PyTypeObject *type, PyObject *given, PyObject *) {
  using Reader = bool (*)(PyObject *, Law, TaskTwin &);
  // In the order of the kinds of the reference.
  const Reader readers[] = {read_frame_task, read_joint_task, read_joint_limits_task,
                            read_axis_task, read_center_of_mass_task, read_speed_limit_task,
                            read_region_task, read_joint_limit_distance_task,
                            read_cone_task, read_orientation_range_task, read_com_polygon_task};
  int kind;
  PyObject *law, *inputs;
  if (!PyArg_ParseTuple(given, "iO!O!", &kind, &PyTuple_Type, &law, &PyTuple_Type, &inputs))
    return nullptr;
  try {
    TaskTwin twin;
    Law its;
    if (kind >= 0 && kind < int(std::size(readers)) && read_law(law, its)) {
      // The twist of the goal, or a velocity of each row.
      const Reader twisted[] = {read_axis_task, read_region_task, read_cone_task,
                                read_orientation_range_task};
      const bool has_twist = std::count(std::begin(twisted), std::end(twisted), readers[kind]);
      const size_t fed = has_twist ? 6 : size_t(its.rows);
      if ((its.feed_forward.empty() || its.feed_forward.size() == fed)
          && readers[kind](inputs, std::move(its), twin))
        return keep<TaskTwin>(type, std::move(twin));
    }
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  PyErr_Clear();
  return refuse("these are no inputs of a task");
}

// Whether a task is one of a robot, and so is its mask.
bool fits(const Task &task, const Motion &motion) {
  return task.fits(motion) && task.joint_count(motion.n) == motion.n;
}

// evaluate(motion, positions, velocity, now, error, J, v, upper): fill in error (m,), J (m, n) and
// v (m,) of a demand, whose upper is None; of bounds v is the lower one. False where something does
// not fit, or the number of rows changes from cycle to cycle.
PyObject *task_evaluate(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 8)
    return refuse("evaluate(motion, positions, velocity, now, error, J, v, upper)");
  Task &task = *of<TaskTwin>(self).task;
  const int m = task.most_rows();
  const Buffer positions(given[1]), velocity(given[2]);
  const double now = PyFloat_AsDouble(given[3]);
  PyErr_Clear();
  const Output error(given[4]), J(given[5]), v(given[6]), upper(task.bounded() ? given[7] : nullptr);
  Motion *motion = find<Motion>(given[0]);
  if (!motion || task.keys() || !positions.is(motion->n) || !velocity.is(motion->n) || !error.is(m)
      || !J.is(m, motion->n) || !v.is(m) || !(task.bounded() ? upper.is(m) : given[7] == Py_None)
      || !fits(task, *motion)) return Py_NewRef(Py_False);
  double at[MOST], moving[MOST];
  positions.copy(at);
  velocity.copy(moving);
  task.begin();
  if (!task.evaluate({motion, at, moving, now},
                     {error.p(), J.p(), v.p(), v.p(), task.bounded() ? upper.p() : nullptr}))
    return Py_NewRef(Py_False);
  task.keep();
  return Py_NewRef(Py_True);
}

// The numbers of a vector, or of a matrix row by row.
bool read_row_by_row(PyObject *object, std::vector<double> &found) {
  const Buffer buffer(object);
  const bool is_matrix = buffer.rows(2) >= 0;
  if (!is_matrix && buffer.rows(1) < 0) return false;
  found.resize(size_t(buffer.rows(is_matrix ? 2 : 1) * (is_matrix ? buffer.columns() : 1)));
  if (is_matrix) buffer.copy_rows(found.data());
  else buffer.copy(found.data());
  return true;
}

// move_goal(goal, velocity, now): set a goal and its feed-forward velocity, both of the form that they
// have; False where something does not fit, and nothing has changed.
PyObject *task_move_goal(PyObject *self, PyObject *const *given, Py_ssize_t count) {
  if (count != 3) return refuse("move_goal(goal, velocity, now)");
  try {
    std::vector<double> goal, velocity;
    const double now = PyFloat_AsDouble(given[2]);
    if (!PyErr_Occurred() && read_row_by_row(given[0], goal) && read_all(given[1], velocity))
      return PyBool_FromLong(of<TaskTwin>(self).task->move_goal(goal, velocity, now));
  } catch (const std::bad_alloc &) {
    return PyErr_NoMemory();
  }
  PyErr_Clear();
  return Py_NewRef(Py_False);
}

PyMethodDef TASK_METHODS[] = {
    method("evaluate", task_evaluate, "Return error, Jacobian and demand."),
    method("move_goal", task_move_goal, "Set a goal and its velocity."),
    {nullptr, nullptr, 0, nullptr}};

}  // namespace
