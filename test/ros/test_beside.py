# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Figures of the loop, the watchdog, and a controller that threads share."""

import math
from threading import enumerate as enumerate_threads
from threading import Event, Thread

import numpy as np
import pytest
from robots import PLANAR_DH
from tp_controller import Robot, Settings, Stack
from tp_controller.ros.loop.loop_statistics import CYCLES, Figures
from tp_controller.ros.loop.shared_controller import SharedController
from tp_controller.ros.loop.watchdog import Watchdog

DEADLINE = 60.0


def test_figures_before_any_cycle_are_unknown_and_have_their_keys():
    told = Figures(0.01).as_text()
    assert told['cycles'] == told['overruns'] == told['stalls'] == '0'
    assert {value for key, value in told.items() if '[' in key} == {'nan'}


def test_figures_are_of_the_last_cycles():
    figures = Figures(math.inf)
    for cycle in range(CYCLES):
        figures.add(0.5 * cycle, 0.5 * cycle + 0.3, 0.5 * cycle)
    late = 0.5 * CYCLES
    for cycle in range(CYCLES):
        start = late + 0.01 * cycle
        # Two answers of a hundred are late.
        figures.add(start, start + 0.001 * (1.0 + (cycle == 7)),
                    start - (0.002 if cycle % 50 else 0.005))
    told = figures.as_text()
    assert told['cycles'] == str(2 * CYCLES)
    assert float(told['rate [Hz]']) == pytest.approx(100.0)
    assert float(told['cycle median [ms]']) == pytest.approx(1.0)
    assert float(told['cycle max [ms]']) == pytest.approx(2.0)
    assert float(told['state to command p99 [ms]']) == pytest.approx(6.0)
    assert float(told['state to command median [ms]']) == pytest.approx(3.0)
    assert told['overruns'] == '0'


@pytest.mark.parametrize('starts, took, overruns', [
    ([0.0, 0.01, 0.02], 0.005, 0), ([0.0, 0.019, 0.02], 0.005, 0), ([0.0, 0.021, 0.03], 0.005, 1),
    ([0.0, 0.01, 0.02], 0.011, 3)])
def test_overruns_are_cycles_that_are_a_period_late_or_longer_than_one(starts, took, overruns):
    figures = Figures(0.01)
    for start in starts:
        figures.add(start, start + took, start)
    assert figures.as_text()['overruns'] == str(overruns)


def test_the_watchdog_barks_only_after_its_timeout():
    barked = []
    for silence in (0.0, 0.2, 0.21, 5.0):
        Watchdog(0.2, lambda silence=silence: silence,
                 lambda silence=silence: barked.append(silence)).check()
    assert barked == [0.21, 5.0]


def test_the_watchdog_goes_on_until_it_is_ended():
    often, barked = Event(), []

    def bark():
        barked.append(True)
        if len(barked) == 3:
            often.set()

    with Watchdog(0.01, lambda: 1.0, bark).watching():
        assert often.wait(DEADLINE)
    assert 'watchdog' not in {thread.name for thread in enumerate_threads()}


def test_threads_that_share_a_controller_disturb_nothing():
    robot = Robot.from_file(PLANAR_DH)
    names = ', '.join(robot.joint_names)
    stacks = [Stack.from_yaml(f'- a: {{type: joint, joints: [{names}], gain: {gain}}}\n'
                              f'- b: {{type: posture}}', robot) for gain in (1.0, 2.0)]
    controller = SharedController(robot, stacks[0].copy(), Settings(period=0.01))
    ended, failed = Event(), []

    def disturb():
        random = np.random.default_rng(1)
        try:
            for count in range(10 ** 6):
                if ended.is_set():
                    return
                controller.replace_stack(stacks[count % 2].copy())
                controller.set_goal('a', random.uniform(-1.0, 1.0, 3), 0.01)
                controller.enable('a', count % 3 > 0)
                controller.restart()
        except Exception as error:
            failed.append(error)

    threads = [Thread(target=disturb) for _ in range(2)]
    for thread in threads:
        thread.start()
    try:
        for cycle in range(300):
            command = controller.update(np.array([0.0, 0.6, 0.3]), 0.01 * cycle)
            assert (np.abs(command.velocity) <= robot.velocity).all()
            assert {task.name for task in command.report.tasks} == {'a', 'b'}
    finally:
        ended.set()
        for thread in threads:
            thread.join()
    assert not failed
