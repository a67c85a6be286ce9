# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""A controller that several threads may use at the same time."""

from collections.abc import Callable
from functools import wraps
from threading import RLock
from typing import Any, Concatenate, ParamSpec, TypeVar

from tp_controller.control.controller import Controller

Arguments = ParamSpec('Arguments')
Result = TypeVar('Result')


def _alone(method: Callable[Concatenate[Any, Arguments], Result]
           ) -> Callable[Concatenate['SharedController', Arguments], Result]:
    """Return a method of `Controller` that waits until no other runs."""
    @wraps(method)
    def call(self: 'SharedController', *arguments: Arguments.args,
             **keys: Arguments.kwargs) -> Result:
        with self.lock:
            return method(self, *arguments, **keys)
    return call


class SharedController(Controller):
    """
    A `Controller` whose methods run one at a time, whichever threads call them.

    Each takes microseconds, up to that of a cycle. What takes long, such as reading a stack, is
    done before.

    Attributes
    ----------
    lock : threading.RLock
        For whoever needs several calls to act in the same cycle.

    """

    def __init__(self, *arguments: Any, **keys: Any) -> None:
        self.lock = RLock()
        super().__init__(*arguments, **keys)

    update = _alone(Controller.update)
    halt = _alone(Controller.halt)
    slow_down = _alone(Controller.slow_down)
    forget_goals = _alone(Controller.forget_goals)
    restart = _alone(Controller.restart)
    replace_stack = _alone(Controller.replace_stack)
    set_goal = _alone(Controller.set_goal)
    set_feed_forward = _alone(Controller.set_feed_forward)
    enable = _alone(Controller.enable)
    set_gain = _alone(Controller.set_gain)
    set_velocity_limits = _alone(Controller.set_velocity_limits)
    set_tolerance = _alone(Controller.set_tolerance)
    configuration = _alone(Controller.configuration)
