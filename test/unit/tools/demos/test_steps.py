# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The steps of a demo: goals, their progress and outcomes, and a controller that pauses."""

import numpy as np
import pytest
from tp_controller.errors import TpControllerError
from tp_controller.ros.client.status import TaskStatus
from tp_controller.tools.demos import steps as module
from tp_controller.tools.demos.steps import error_text, GOAL_SECONDS, IDLE_SECONDS, Steps

GOAL = {'task': 'tool', 'say': 'there', 'xyz': [0.0, 0.0, 0.0]}


class Played:
    """
    A controller whose task is reached after a second; it is stopped from `stopped` on.

    Parameters
    ----------
    pace : float
        Commands that it computes, as a share of those that it has time for.
    reached : float
        When the task is reached, in the time of the controller [s].

    """

    def __init__(self, monkeypatch, stopped=(np.inf, np.inf), pace=1.0, reached=1.0):
        self.now, self._stopped, self._pace, self._reached = 0.0, stopped, pace, reached
        self.repeated = 0
        monkeypatch.setattr(module.time, 'monotonic', lambda: self.now)

    def send(self, task, **fields):
        pass

    def repeat(self):
        self.repeated += 1

    def spin(self, seconds):
        self.now += seconds

    def catch_up(self):
        pass

    def computed(self):
        return self._pace * self.now

    def task_names(self):
        return ['tool']

    def task_status(self, task):
        stopped = self.stop_reason()
        return TaskStatus(
            task, errors={'m': np.nan if stopped else 0.001},
            status='reached' if self.computed() > self._reached and not stopped else 'moving')

    def stop_reason(self):
        start, end = self._stopped
        return 'joint states are late' if start <= self.now < end else ''


def steps_of(client, check=lambda: None):
    """Return the steps of a played controller."""
    return Steps(client, check, client.computed)


@pytest.mark.parametrize('stopped, outcome', [
    ((1.2, 1.7), 'reached'), ((0.5, 3.0), 'reached'),
    ((1.2, np.inf), 'not reached: joint states are late')])
def test_a_demo_waits_for_a_controller_that_goes_on_by_itself(monkeypatch, stopped, outcome):
    client = Played(monkeypatch, stopped)
    found, = steps_of(client).carry_out([GOAL], 1)
    assert str(found).endswith(outcome)
    assert client.now <= GOAL_SECONDS + 0.1


def test_a_goal_is_waited_for_as_long_as_the_controller_needs_on_a_slow_machine(monkeypatch):
    client = Played(monkeypatch, pace=0.1, reached=15.0)
    found, = steps_of(client).carry_out([GOAL], 1)
    assert found.reached
    assert client.now > 5.0 * GOAL_SECONDS


def test_a_goal_is_abandoned_once_nothing_is_computed_any_more(monkeypatch):
    client = Played(monkeypatch, pace=0.0)
    found, = steps_of(client).carry_out([GOAL], 1)
    assert not found.reached
    assert IDLE_SECONDS < client.now < 2.0 * IDLE_SECONDS


def test_a_node_that_ends_ends_the_demo(monkeypatch):
    client = Played(monkeypatch)

    def check():
        if client.now > 0.5:
            raise TpControllerError('controller_node has ended')

    with pytest.raises(TpControllerError, match='has ended'):
        steps_of(client, check).carry_out([GOAL], 1)


def test_progress_has_the_last_known_errors_and_the_reason_of_a_pause(monkeypatch, capsys):
    client = Played(monkeypatch, stopped=(0.5, 2.5), reached=3.0)
    steps = steps_of(client)
    found, = steps.carry_out([GOAL], 1)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) >= 3 and all('1.00 mm' in line and 'nan' not in line for line in lines)
    assert [line.endswith('paused: joint states are late') for line in lines[:3]] == [
        False, True, True]
    assert steps.pauses == 1 and '1.00 mm' in found.error


def test_velocities_are_repeated_as_long_as_they_are_to_last(monkeypatch):
    client = Played(monkeypatch)
    steps_of(client).carry_out([{**GOAL, 'for': 2.0}], 1)
    assert 2.0 <= client.now < 3.5 and 15 <= client.repeated <= 30


def test_errors_that_are_unknown_are_left_out():
    assert error_text(TaskStatus('tool', errors={'m': np.nan, 'rad': np.nan})) == ''
    assert error_text(TaskStatus('tool', errors={'m': 0.0123, '1': 4.0})).strip() == '12.30 mm'
