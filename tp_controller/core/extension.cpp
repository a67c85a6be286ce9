// Copyright 2026 tp_controller contributors
// SPDX-License-Identifier: Apache-2.0

// The compiled core, one extension module. Each header names the Python file that is its reference:
// read that first. Checks, and the objects that users see, stay in Python.

#include "clearance.h"
#include "collision.h"
#include "expected_state.h"
#include "moving_goal.h"
#include "search_object.h"
#include "step_object.h"

namespace {

// {module of the reference: {name: value}}; a test holds them equal.
PyObject *constants() {
#define VALUE(name) {#name, {double(name)}}
#define BOUNDED(name) {#name, {bounded::name}}
#define VALUES(name) {#name, {std::begin(name), std::end(name)}}
  struct Constant { const char *name; std::vector<double> values; };
  const std::pair<const char *, std::vector<Constant>> modules[] = {
      {"solver.compiled", {VALUE(MOST)}},
      {"solver.level", {VALUE(NEGLIGIBLE), VALUE(ROUNDING), VALUE(FEASIBLE)}},
      {"solver.damping", {VALUE(CURVATURE), VALUE(TURNING), VALUE(ROW_TURNING),
          VALUE(FIRST), VALUE(MEMORY)}},
      {"solver.active_set", {VALUE(DEPENDENT), VALUE(LAST_DIGIT)}},
      {"solver.qp", {VALUES(TOLERANCES), VALUES(EXACT)}},
      {"solver.bounded_hierarchy", {VALUE(ROW_DAMPING), VALUE(SOFTEST)}},
      {"solver.min_norm", {VALUE(WELL_CONDITIONED), VALUE(WELL_WEIGHTED)}},
      {"model.state", {VALUE(LARGEST)}},
      {"model.spatial", {VALUE(HALF_TURN_BAND), VALUE(SMALL_ANGLE)}},
      {"model.support_polygon", {VALUE(COLLINEAR)}},
      {"model.shapes", {VALUE(CENTRE_RADIUS)}},
      {"model.clearance", {VALUE(PATCH_TOLERANCE), VALUE(BOUND_MARGIN), VALUE(LEAST_ANGLE),
          VALUE(LEAST_GAP), VALUE(LEAST_RISE)}},
      {"tasks.aim", {VALUE(MIN_POINT_DISTANCE), VALUE(MIN_VECTOR_LENGTH)}},
      {"tasks.pointing", {VALUE(MIN_VERTICAL_SINE), VALUE(MIN_SQUARED_SINE)}},
      {"tasks.bounded", {BOUNDED(RETURN_JOINT_SPEED), BOUNDED(FAR), BOUNDED(STILL), BOUNDED(LOOSE),
          BOUNDED(DRIFT), BOUNDED(TINY)}},
      {"tasks.cone", {VALUE(ROUNDED_SHARE)}},
      {"tasks.joint_limit_distance", {VALUE(MAX_CURVED), VALUE(MAX_RATE)}},
      {"control.joint_limits", {VALUE(RETURN_SHARE), VALUE(RETURN_SPEED),
          VALUE(LARGEST_DISTANCE), VALUE(UNLIMITED_ACCELERATION)}},
      {"control.jerk_limit",
       {VALUE(BOUNDARY_STEPS), VALUE(SHORTEST_TAIL), VALUE(FALL), VALUE(COMPENSATION), VALUE(LAG)}},
      {"control.velocity_limits", {VALUE(SAME_VELOCITY)}},
      {"control.settling", {VALUE(SETTLING_STEPS), VALUE(MEMORY_SETTLED), VALUE(SAME_MOTION),
          VALUE(STEEPEST), VALUE(FAR_APART), VALUE(INNERMOST)}},
      {"control.causes", {VALUE(SIGNIFICANT_SHARE), VALUE(NOTABLE_SHARE), VALUE(NEAR_SINGULAR),
                          VALUE(IMMOVABLE)}},
      {"control.cycle_time", {VALUE(SMOOTHING), VALUE(HOLD_RATIO)}},
      {"control.escape", {VALUE(STUCK_SPEED), VALUE(LEAST_DEMAND), VALUE(SINGULAR_RATIO),
          VALUE(STUCK_SECONDS), VALUE(MOST_NUDGES)}},
      {"positions.choice", {VALUE(FULL_TURN)}},
      {"positions.descent", {VALUE(MET), VALUE(KEPT),
          VALUE(FIRST_RADIUS), VALUE(LARGEST_RADIUS), VALUE(LEAST_RADIUS),
          VALUE(LEAST_GAIN), VALUE(WELL_PREDICTED), VALUE(SHRINK), VALUE(GROW), VALUE(LEAST_REDUCTION),
          VALUE(LAST_REDUCTION), VALUE(STALLED), VALUE(LEAST_SLOPE), VALUE(STALLED_STEPS),
          VALUE(CORRECTIONS), VALUE(MOST_STEPS), VALUE(ROUNDS)}},
      {"positions.search", {VALUE(EQUAL)}},
  };
#undef VALUE
#undef BOUNDED
#undef VALUES
  PyObject *found = PyDict_New();
  for (const auto &[module, given] : modules) {
    PyObject *its = PyDict_New();
    for (const Constant &constant : given) {
      PyObject *value = PyTuple_New(Py_ssize_t(constant.values.size()));
      for (size_t i = 0; i < constant.values.size(); ++i)
        PyTuple_SetItem(value, Py_ssize_t(i), PyFloat_FromDouble(constant.values[i]));
      PyDict_SetItemString(its, constant.name, value);
      Py_DECREF(value);
    }
    PyDict_SetItemString(found, module, its);
    Py_DECREF(its);
  }
  return found;
}

PyMethodDef FUNCTIONS[] = {
    method("bound", bounded::bound, "Find the bounds of an inequality task."),
    method("moving_goal", moving_goal, "Return the goal on a curve, and its velocity."),
    method("parting", parting, "Find the rows of distances between solids."),
    {nullptr, nullptr, 0, nullptr}};
PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "extension", "The compiled core.", -1, FUNCTIONS,
                      nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit_extension(void) {
  if (!intern_level_names() || !intern_motion_names()) return nullptr;
  return make_module(MODULE, {
      {"Solver", make_type<Solver>("tp_controller.core.extension.Solver", make_solver,
                                   SOLVER_METHODS)},
      {"Motion", make_type<Motion>("tp_controller.core.extension.Motion", make_motion,
                                   MOTION_METHODS)},
      {"Clearance", make_type<Clearance>("tp_controller.core.extension.Clearance", make_clearance,
                                         CLEARANCE_METHODS)},
      {"Limits", make_type<Limits>("tp_controller.core.extension.Limits", make_limits,
                                   LIMITS_METHODS)},
      {"Task", make_type<TaskTwin>("tp_controller.core.extension.Task", make_task, TASK_METHODS)},
      {"Search", make_type<PositionSearch>("tp_controller.core.extension.Search", make_search,
                                           SEARCH_METHODS)},
      {"Step", make_type<StackCycle>("tp_controller.core.extension.Step", make_step,
                                     STEP_METHODS)},
      {"ExpectedState", make_type<ExpectedState>("tp_controller.core.extension.ExpectedState",
                                                 make_expected, EXPECTED_METHODS)},
      {"CONSTANTS", constants()},
      {"SOURCES", PyLong_FromUnsignedLongLong(SOURCES)}});
}
