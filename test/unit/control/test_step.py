# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The cycle as a function of values: whatever ran before, equal input gives equal bits."""

from dataclasses import replace

import numpy as np
import pytest
import robots
from tp_controller import Controller, Settings, Stack
from tp_controller.control.step import Commanded, step

START = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
TEXT = ('- tool: {type: position, frame: panda_hand_tcp, gain: 2.0}\n'
        '- posture: {type: posture, gain: 0.5}\n')


def recorded(monkeypatch, robot, text, start, goal, cycles=120, **settings):
    """Return (problem, memory, result) of each cycle of a motion with changes."""
    found = []

    def recording(problem, memory):
        result = step(problem, memory)
        found.append((problem, memory, result))
        return result

    monkeypatch.setattr('tp_controller.control.controller.step', recording)
    controller = Controller(robot, Stack.from_yaml(text, robot),
                            Settings(period=0.01, **settings))
    q = start
    for cycle in range(cycles):
        if cycle == 10:
            controller.set_goal('tool', goal, 0.01 * cycle)
        if cycle == 40:
            controller.settings = replace(controller.settings, damping=0.2)
        q = q + 0.01 * controller.update(q, 0.01 * cycle).velocity
    return found


def bits(value):
    """Return a value as bytes and texts, arrays by their bytes."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if isinstance(value, (tuple, list)):
        return tuple(map(bits, value))
    if hasattr(value, '__dataclass_fields__'):
        return tuple(bits(getattr(value, name)) for name in value.__dataclass_fields__)
    return repr(value)


CASES = {
    'moving arm': (robots.panda, TEXT, START, [0.4, 0.3, 0.4], {}),
    'no pending commands': (robots.panda, TEXT, START, [0.4, 0.3, 0.4], {'command_delay': 0}),
    'goal out of reach': (robots.panda, TEXT, START, [5.0, 0.0, 0.4], {}),
    'stretched arm': (robots.planar, '- tool: {type: position, frame: link3, axes: xy}\n',
                      np.zeros(3), [0.4, 0.0, 0.0], {}),
}


@pytest.mark.slow
@pytest.mark.parametrize('case', CASES)
def test_cycles_in_any_order_give_the_bits_of_those_in_a_row(case, monkeypatch):
    make, text, start, goal, settings = CASES[case]
    found = recorded(monkeypatch, make(), text, start, goal, **settings)
    before = [bits(memory) for _, memory, _ in found]
    for index in np.random.default_rng(0).permutation(len(found)).tolist() * 2:
        problem, memory, (_, outcome, after) = found[index]
        _, again, memory_again = step(problem, memory)
        assert again.override == outcome.override
        assert bits(again.velocity) == bits(outcome.velocity)
        assert bits(memory_again) == bits(after)
    # Nothing that a cycle received has changed.
    assert [bits(memory) for _, memory, _ in found] == before
    assert {outcome.override for _, _, (_, outcome, _) in found} >= {'', 'transition'}


def test_stretched_arm_is_nudged_by_the_cycles_that_are_repeated(monkeypatch):
    found = recorded(monkeypatch, *[make() if callable(make) else make for make in
                                    CASES['stretched arm'][:4]], cycles=200)
    assert 'leaving a singularity' in {outcome.override for _, _, (_, outcome, _) in found}


def test_two_controllers_that_continue_from_one_memory_in_turn_agree(monkeypatch):
    robot = robots.panda()
    first, second = (Controller(robot, Stack.from_yaml(TEXT, robot), Settings(period=0.01))
                     for _ in range(2))
    q = START
    for cycle in range(100):
        now = 0.01 * cycle
        if cycle in (10, 50):
            for controller in (first, second):
                controller.set_goal('tool', [0.4, 0.3 - 0.005 * cycle, 0.4], now)
        second._last = Commanded(first._memory)
        commands = [controller.update(q, now).velocity for controller in (first, second)]
        assert commands[0].tobytes() == commands[1].tobytes()
        first._last = Commanded(second._memory)
        q = q + 0.01 * commands[0]
    assert np.abs(q - START).max() > 0.1
