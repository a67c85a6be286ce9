# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The compiled core: each header has one reference in Python, and its constants."""

import importlib
import re

import numpy as np
import pytest
from robots import REPOSITORY
from tp_controller.solver.compiled import core

FOLDER = REPOSITORY / 'tp_controller' / 'core'
HEADERS = {path.name: path.read_text(encoding='utf-8') for path in sorted(FOLDER.glob('*.h'))}
# {header: its reference below tp_controller}; empty for what only the core needs.
REFERENCES = {
    'active_set.h': 'solver/active_set.py', 'aim.h': 'tasks/aim.py', 'arena.h': '',
    'bounded_hierarchy.h': 'solver/bounded_hierarchy.py', 'bounded_task.h': 'tasks/bounded.py',
    'causes.h': 'control/causes.py', 'causes_object.h': 'control/cycle_record.py',
    'center_of_mass_task.h': 'tasks/center_of_mass.py', 'choice.h': 'positions/choice.py',
    'clearance.h': 'model/clearance.py', 'collision.h': 'tasks/collision.py',
    'com_polygon_task.h': 'tasks/com_polygon.py', 'cycle_time.h': 'control/cycle_time.py',
    'curvature.h': 'solver/curvature.py',
    'damping.h': 'solver/damping.py', 'descent.h': 'positions/descent.py',
    'escape.h': 'control/escape.py', 'expected_state.h': 'ros/loop/expected_state.py',
    'cone_task.h': 'tasks/cone.py',
    'frame_task.h': 'tasks/frame.py', 'gradient_task.h': 'tasks/gradient.py',
    'jerk_limit.h': 'control/jerk_limit.py',
    'joint_limit_distance_task.h': 'tasks/joint_limit_distance.py',
    'joint_limits.h': 'control/joint_limits.py', 'joint_limits_task.h': 'tasks/joint_limits.py',
    'joint_task.h': 'tasks/joint.py', 'kinematics.h': 'model/state.py',
    'level.h': 'solver/level.py', 'level_step.h': 'solver/solution.py',
    'min_norm.h': 'solver/min_norm.py',
    'motion_object.h': 'model/compiled.py', 'moving_goal.h': 'references/reference.py',
    'null_space.h': 'solver/null_space.py',
    'orientation.h': 'tasks/orientation.py',
    'orientation_range_task.h': 'tasks/orientation_range.py',
    'pointing_task.h': 'tasks/pointing.py',
    'polytope.h': 'solver/polytope.py', 'position_stack.h': 'positions/position_stack.py',
    'python_buffers.h': '', 'qp.h': 'solver/qp.py', 'region_task.h': 'tasks/region.py',
    'scaling.h': 'solver/scaling.py', 'search.h': 'positions/search.py',
    'search_object.h': 'positions/compiled.py', 'settling.h': 'control/settling.py',
    'shapes.h': 'model/shapes.py',
    'solve.h': 'solver/solve.py', 'solver_object.h': 'solver/compiled.py',
    'spatial.h': 'model/spatial.py', 'speed_limit_task.h': 'tasks/speed_limit.py',
    'stack_levels.h': 'tasks/stack.py', 'standing_joints.h': 'control/standing_joints.py',
    'step.h': 'control/step.py',
    'step_object.h': 'control/compiled_step.py', 'task.h': 'tasks/task.py',
    'stopping.h': 'control/stopping.py', 'support_polygon.h': 'model/support_polygon.py',
    'task_object.h': 'tasks/twin.py',
    'variants.h': 'control/variants.py',
    'velocity_limits.h': 'control/velocity_limits.py',
}
# Of a reference, the lowest first: a header includes none whose reference is above its own.
LIBRARY = ('', 'solver', 'model', 'references', 'tasks', 'control', 'positions', 'ros/loop')
LONGEST = 450


def included(text):
    """Return the headers that a file includes."""
    return re.findall(r'^#include "([^"]+)"', text, re.MULTILINE)


def part(header):
    """Return the place in the library of the reference of a header."""
    return LIBRARY.index(REFERENCES[header].rpartition('/')[0])


def test_everything_compiled_is_one_extension():
    package = REPOSITORY / 'tp_controller'
    sources = [path.relative_to(package).as_posix()
               for ending in ('*.cpp', '*.h') for path in package.rglob(ending)]
    assert {path.rpartition('/')[0] for path in sources} == {'core'}
    assert [path for path in sources if path.endswith('.cpp')] == ['core/extension.cpp']


def test_each_header_names_its_reference():
    named = {name: re.search(r'^// Reference: (.+)$', text, re.MULTILINE).group(1)
             for name, text in HEADERS.items()}
    assert named == {name: f'tp_controller/{reference}' if reference else 'none'
                     for name, reference in REFERENCES.items()}
    for reference in filter(None, REFERENCES.values()):
        assert (REPOSITORY / 'tp_controller' / reference).is_file()


def test_a_header_includes_nothing_of_above_its_reference():
    for name, text in HEADERS.items():
        for other in included(text):
            assert part(other) <= part(name) or other == 'python_buffers.h', (name, other)


def test_every_header_is_used_and_none_is_long():
    used = {other for text in (*HEADERS.values(), (FOLDER / 'extension.cpp').read_text())
            for other in included(text)}
    assert used == set(HEADERS)
    assert max(len(text.splitlines()) for text in HEADERS.values()) <= LONGEST


@pytest.mark.skipif(core is None, reason='the package was built without a compiler')
def test_constants_are_those_of_the_references():
    assert set(core.CONSTANTS) >= {'solver.level', 'model.state', 'tasks.bounded'}
    for module, constants in core.CONSTANTS.items():
        reference = importlib.import_module(f'tp_controller.{module}')
        for name, value in constants.items():
            assert np.array_equal(np.ravel(getattr(reference, name)), value), (module, name)
    # Every constant that a header writes down is among them, but for those without a reference.
    for name, text in HEADERS.items():
        module = REFERENCES[name].removesuffix('.py').replace('/', '.')
        block = re.search(r'// Constants? of the reference\.\n(?:constexpr [^;]+;.*\n)+', text)
        found = re.findall(r'\b([A-Z][A-Z_]+)(?:\[\])? = ', block.group()) if block else []
        assert set(found) <= set(core.CONSTANTS.get(module, ())), name
