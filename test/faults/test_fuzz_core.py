# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The compiled core refuses arguments of wrong shapes and types, and stays intact.

The calls of a controller are recorded and repeated with one argument changed. Each has to return,
or to raise an error that a call with wrong arguments raises; afterwards all recorded calls give
what they gave before, to the bit. Always the same 10,000 calls; more with

    TP_FUZZ=1000000 python -m pytest test/faults/test_fuzz_core.py
"""

import math
import os
import random
import sys

import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack
from tp_controller.solver.compiled import core

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')
CALLS = int(os.environ.get('TP_FUZZ', 10_000))
REFUSED = (TypeError, ValueError, OverflowError, MemoryError)
TOOL = robots.PANDA_TOOL
# All kinds of tasks that the core has, and one that Python evaluates.
STACKS = (
    ('Panda', f"""
- limits: {{type: joint_limits}}
- slow: {{type: speed_limit, frame: {TOOL}, linear: 0.05, angular: 0.5}}
- [keep: {{type: keep_out, frame: {TOOL}, shape: {{cylinder: [0.3, 0.8]}}, at: [0.6, 0.1, 0.3]}},
   cell: {{type: keep_in, frame: panda_link4, shape: {{box: [0.4, 0.4, 1.2]}}, at: [0, 0, 0.4]}}]
- tool: {{type: pose, frame: {TOOL}}}
- above: {{type: manipulability_above, frame: {TOOL}, minimum: 0.01}}
- look: {{type: look_at, frame: panda_link5, target: {TOOL}, up: x}}
- posture: {{type: posture, gain: 0.5}}
"""), ('planar', f"""
- view: {{type: field_of_view, frame: {TOOL}, half_angle: 0.3, target: [0.5, 0.3, 0.0]}}
- apart: {{type: self_collision, capsules: {{panda_link7: {{from: [0, 0, 0], to: [0, 0, 0.1],
    radius: 0.05}}, panda_link1: {{from: [0, 0, 0], to: [0, 0, -0.2], radius: 0.08}}}}}}
- axis: {{type: pointing, frame: {TOOL}, axis: z}}
- middle: {{type: joint_limit_distance, gain: 0.1}}
"""), ('panda', f"""
- balance: {{type: center_of_mass, axes: xy}}
- tool: {{type: position, frame: {TOOL}, mode: scale}}
- posture: {{type: posture}}
"""))
# Out of reach, so that limits are active.
GOALS = {'pose': [0.9, 0.4, 0.2, 0.0, 0.0, 0.0, 1.0], 'position': [0.9, 0.4, 0.2],
         'pointing': [0.0, 1.0, 0.0]}
# In place of a number of an array, and of an argument.
NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -1e300, 5e-324, 0.0, -1.0, 0.5, 1.0, 2.0, 1e9)
OTHERS = (None, math.nan, math.inf, -1, 2 ** 31, -2 ** 63, 10 ** 30, 0.5, 'text', b'', b'\xff', (),
          (None,), [], {}, object(), core, np.float64(1.0), np.zeros(0), np.zeros((0, 0)),
          np.zeros(1001), np.zeros((3, 3, 3)), np.array(None))


class Recorder:
    """
    Stand-in for the core that records the calls; its objects are stand-ins, too.

    Attributes
    ----------
    calls : list
        (function, arguments) of each call of a function of the module or a method.

    """

    def __init__(self, of, calls):
        self.of, self.calls = of, calls

    def __getattr__(self, name):
        found = getattr(self.of, name)
        return self._recorded(found) if callable(found) else found

    def _recorded(self, function):
        def call(*given):
            given = tuple(map(plain, given))
            # What is filled in is as it was before.
            self.calls.append((function, frozen(given)))
            found = function(*given)
            return Recorder(found, self.calls) if isinstance(function, type) else found
        return call


def remade(value, items):
    """Return a tuple, which may have names, with other items."""
    return value._make(items) if hasattr(value, '_make') else tuple(items)


def plain(value):
    """Return a value without stand-ins."""
    if isinstance(value, tuple):
        return remade(value, map(plain, value))
    return value.of if isinstance(value, Recorder) else value


def frozen(value):
    """Return a value with copies of its arrays."""
    if isinstance(value, tuple):
        return remade(value, map(frozen, value))
    return value.copy() if isinstance(value, np.ndarray) else value


@pytest.fixture(scope='module')
def calls():
    """Return the calls of some cycles of controllers, with their reports."""
    found = []
    with pytest.MonkeyPatch.context() as patch:
        for module in [*sys.modules.values()]:
            if getattr(module, '__name__', '').startswith('tp_controller') \
                    and getattr(module, 'core', None) is core:
                patch.setattr(module, 'core', Recorder(core, found))
        for name, text in STACKS:
            robot = robots.named(name)
            controller = Controller(robot, Stack.from_yaml(text, robot), Settings(period=0.01))
            q, passive = robots.anywhere(robot, np.random.default_rng(1))
            for now in (0.0, 0.01, 0.02, 1.0):
                # The last goals are blended in, by `step`.
                for task in controller.stack.tasks.values():
                    if task.type_name in GOALS:
                        controller.set_goal(task.name, GOALS[task.type_name], now)
                report = controller.update(q, now, passive).report
                assert report.tasks[0].causes is not None
                assert report._cycle.combined_causes(0) is not None
    return found


def result(call):
    """Return the outcome of a call, and what it has filled in, as bytes and text."""
    function, given = call
    given = frozen(given)
    try:
        found = function(*given)
    except REFUSED as error:
        return repr(error), ''
    return repr(found) if not isinstance(function, type) else 'made', repr(
        [each.tobytes() for each in given if isinstance(each, np.ndarray)])


def spoiled(array, chance):
    """Return a copy of an array with one other number."""
    found = array.copy()
    found.flat[chance.randrange(found.size)] = chance.choice(NUMBERS)
    return found


def other_arrays(array, chance):
    """Return arrays that are nearly the given one."""
    fixed = array.copy()
    fixed.flags.writeable = False
    with np.errstate(all='ignore'):
        converted = [array.astype(kind) for kind in (np.float32, int, complex, object, '>f8')]
    rows = np.atleast_1d(array)
    return converted + [
        rows[:-1], rows[..., :-1], rows[::-1], array.T, array[None], array.ravel(), fixed,
        np.concatenate([rows, rows]), np.repeat(rows, 2, axis=-1)[..., ::2], array.tolist(),
        array.tobytes(), *[spoiled(array, chance) for _ in range(20)]]


def other_bytes(value, chance):
    """Return bytes that are nearly the given ones, which may be numbers."""
    at = chance.randrange(len(value))
    numbers = np.frombuffer(value[:len(value) // 8 * 8])
    return [value[:at], value + value, bytearray(value), bytes(len(value)),
            value[:at] + bytes([chance.randrange(256)]) + value[at + 1:],
            *[spoiled(numbers, chance).tobytes() for _ in range(20) if numbers.size]]


def changed(value, chance):
    """Return a value that is nearly the given one, or another."""
    if isinstance(value, tuple) and value and chance.random() < 0.8:
        index = chance.randrange(len(value))
        return remade(value, (*value[:index], changed(value[index], chance), *value[index + 1:]))
    near = []
    if isinstance(value, np.ndarray) and value.size and value.dtype == np.float64:
        near = other_arrays(value, chance)
    elif isinstance(value, bytes) and value:
        near = other_bytes(value, chance)
    elif isinstance(value, tuple):
        near = [value[:-1], (*value, None), (*value, *value), [*value], value[::-1]]
    elif isinstance(value, (int, float)):
        near = [value + 1, value - 1, -value, value + 0.5, 1000, 1001, int(not value)]
    return chance.choice(near if near and chance.random() < 0.7 else OTHERS)


def by_name(calls):
    """Return {name: calls of a function}."""
    found = {}
    for function, given in calls:
        found.setdefault(function.__name__, []).append((function, given))
    return found


def test_compiled_core_refuses_what_does_not_fit_and_stays_intact(calls):
    before = [result(call) for call in calls]
    kinds = by_name(calls)
    assert {'Solver', 'Limits', 'Motion', 'Task', 'Step', 'Clearance', 'run', 'causes',
            'combined_causes', 'solve', 'set_tasks', 'move', 'evaluate'} <= {*kinds}
    chance, refused = random.Random(1), 0
    for _ in range(CALLS):
        function, given = chance.choice(kinds[chance.choice([*kinds])])
        for _ in range(chance.choice((1, 1, 1, 2))):
            given = changed(given, chance)
            given = given if isinstance(given, tuple) else (given,)
        try:
            found = function(*frozen(given))
            refused += found is None or found is False
        except REFUSED:
            refused += 1
    assert CALLS // 4 < refused < CALLS
    assert [result(call) for call in calls] == before
