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


def _exclusive(method: Callable[Concatenate[Any, Arguments], Result]
               ) -> Callable[Concatenate['SharedController', Arguments], Result]:
    """Return a method of `Controller` that acquires the mutex."""
    @wraps(method)
    def call(self: 'SharedController', *arguments: Arguments.args,
             **keys: Arguments.kwargs) -> Result:
        with self.mutex:
            return method(self, *arguments, **keys)
    return call


class SharedController(Controller):
    """
    `Controller` whose methods run one at a time, called from any thread.

    Each takes microseconds, up to the time of a cycle. Long operations, such as reading a stack,
    are done before.

    Attributes
    ----------
    mutex : threading.RLock
        Lock for several calls that act in the same cycle.

    """

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        self.mutex = RLock()
        super().__init__(*arguments, **keys)

    update = _exclusive(Controller.update)
    halt = _exclusive(Controller.halt)
    slow_down = _exclusive(Controller.slow_down)
    forget_goals = _exclusive(Controller.forget_goals)
    restart = _exclusive(Controller.restart)
    replace_stack = _exclusive(Controller.replace_stack)
    set_goal = _exclusive(Controller.set_goal)
    set_feed_forward = _exclusive(Controller.set_feed_forward)
    cancel_trajectory = _exclusive(Controller.cancel_trajectory)
    # `set_trajectory` reads its values before: up to 10,000 of them.
    _pose_of = _exclusive(Controller._pose_of)
    _begin = _exclusive(Controller._begin)
    _begin_checked = _exclusive(Controller._begin_checked)
    enable = _exclusive(Controller.enable)
    set_gain = _exclusive(Controller.set_gain)
    set_velocity_limits = _exclusive(Controller.set_velocity_limits)
    lock = _exclusive(Controller.lock)
    unlock = _exclusive(Controller.unlock)
    set_tolerance = _exclusive(Controller.set_tolerance)
    configuration = _exclusive(Controller.configuration)
