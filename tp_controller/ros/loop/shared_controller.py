# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Thread-safe controller."""

from collections.abc import Callable
from functools import wraps
from threading import RLock
from typing import Any, Concatenate, ParamSpec, TypeVar

from tp_controller.control.controller import Controller

Arguments = ParamSpec('Arguments')
Result = TypeVar('Result')


def _locked(method: Callable[Concatenate[Any, Arguments], Result]
            ) -> Callable[Concatenate['SharedController', Arguments], Result]:
    """Return a method of `Controller` that acquires the lock."""
    @wraps(method)
    def call(self: 'SharedController', *arguments: Arguments.args,
             **keys: Arguments.kwargs) -> Result:
        with self.lock:
            return method(self, *arguments, **keys)
    return call


class SharedController(Controller):
    """
    `Controller` whose methods run one at a time, called from any thread.

    Each takes microseconds, up to the time of a cycle. Long operations, such as reading a stack,
    are done before.

    Attributes
    ----------
    lock : threading.RLock
        Lock for several calls that act in the same cycle.

    """

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        self.lock = RLock()
        super().__init__(*arguments, **keys)

    update = _locked(Controller.update)
    halt = _locked(Controller.halt)
    slow_down = _locked(Controller.slow_down)
    forget_goals = _locked(Controller.forget_goals)
    restart = _locked(Controller.restart)
    replace_stack = _locked(Controller.replace_stack)
    set_goal = _locked(Controller.set_goal)
    set_feed_forward = _locked(Controller.set_feed_forward)
    cancel_trajectory = _locked(Controller.cancel_trajectory)
    # `set_trajectory` reads its values before: up to 10,000 of them.
    _pose_of = _locked(Controller._pose_of)
    _begin = _locked(Controller._begin)
    _begin_checked = _locked(Controller._begin_checked)
    enable = _locked(Controller.enable)
    set_gain = _locked(Controller.set_gain)
    set_velocity_limits = _locked(Controller.set_velocity_limits)
    set_tolerance = _locked(Controller.set_tolerance)
    configuration = _locked(Controller.configuration)
