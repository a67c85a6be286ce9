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

// The compiled core, one extension module. Each header names the Python file that is its reference:
// read that first. Checks, and the objects that users see, stay in Python.

#include "step_object.h"

namespace {

// {module of the reference: {name: value}}; a test holds them equal.
PyObject *constants() {
  return Py_BuildValue(
      "{s:{s:n}, s:{s:d,s:d,s:d}, s:{s:d,s:d,s:d,s:d,s:d}, s:{s:d,s:d}, s:{s:(dddd),s:(dd)},"
      " s:{s:d,s:d}, s:{s:d,s:d}, s:{s:d}, s:{s:d}, s:{s:d,s:d,s:d,s:d},"
      " s:{s:d}, s:{s:d,s:d},"
      " s:{s:d,s:d}, s:{s:d,s:d,s:d,s:d,s:i}, s:{s:d,s:d,s:d,s:d,s:d,s:d}}",
      "solver.compiled", "MOST", MOST,
      "solver.level", "NEGLIGIBLE", NEGLIGIBLE, "ROUNDING", ROUNDING, "FEASIBLE", FEASIBLE,
      "solver.damping", "CURVATURE", CURVATURE, "TURNING", TURNING, "ROW_TURNING", ROW_TURNING,
      "FIRST", FIRST, "MEMORY", MEMORY,
      "solver.active_set", "DEPENDENT", DEPENDENT, "LAST_DIGIT", LAST_DIGIT,
      "solver.qp", "TOLERANCES", TOLERANCES[0], TOLERANCES[1], TOLERANCES[2], TOLERANCES[3],
      "EXACT", EXACT[0], EXACT[1],
      "solver.bounded_hierarchy", "ROW_DAMPING", ROW_DAMPING, "SOFTEST", SOFTEST,
      "solver.min_norm", "WELL_CONDITIONED", WELL_CONDITIONED, "WELL_WEIGHTED", WELL_WEIGHTED,
      "model.state", "LARGEST", LARGEST,
      "model.spatial", "HALF_TURN_BAND", HALF_TURN_BAND,
      "control.joint_limits", "RETURN_SHARE", RETURN_SHARE, "RETURN_SPEED", RETURN_SPEED,
      "LARGEST_DISTANCE", LARGEST_DISTANCE,
      "UNLIMITED_ACCELERATION", UNLIMITED_ACCELERATION,
      "control.velocity_limits", "SAME_VELOCITY", SAME_VELOCITY,
      "control.causes", "SIGNIFICANT_SHARE", SIGNIFICANT_SHARE, "NEAR_SINGULAR", NEAR_SINGULAR,
      "control.cycle_time", "SMOOTHING", SMOOTHING, "HOLD_RATIO", HOLD_RATIO,
      "control.escape", "STUCK_SPEED", STUCK_SPEED, "LEAST_DEMAND", LEAST_DEMAND,
      "SINGULAR_RATIO", SINGULAR_RATIO, "STUCK_SECONDS", STUCK_SECONDS, "MOST_NUDGES", MOST_NUDGES,
      "tasks.bounded", "RETURN_JOINT_SPEED", bounded::RETURN_JOINT_SPEED, "FAR", bounded::FAR,
      "STILL", bounded::STILL, "LOOSE", bounded::LOOSE, "DRIFT", bounded::DRIFT,
      "TINY", bounded::TINY);
}

PyMethodDef FUNCTIONS[] = {
    method("bound", bounded::bound, "Find the bounds of an inequality task."),
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
      {"Limits", make_type<Limits>("tp_controller.core.extension.Limits", make_limits,
                                   LIMITS_METHODS)},
      {"Task", make_type<TaskTwin>("tp_controller.core.extension.Task", make_task, TASK_METHODS)},
      {"Step", make_type<StackCycle>("tp_controller.core.extension.Step", make_step,
                                     STEP_METHODS)},
      {"CONSTANTS", constants()}});
}
