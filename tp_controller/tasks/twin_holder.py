# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Inputs of a task in the compiled core, made anew where the task changes."""

from typing import Any

from tp_controller.model.spatial import Array, read_only
from tp_controller.tasks.goal_holder import Goal
from tp_controller.tasks.key_holder import KeyHolder
from tp_controller.tasks.twin import Law, Twin, Watch

# Methods that a twin replaces; a type that overrides one of them has no twin of its base class.
EVALUATION_METHODS = {
    'error', 'evaluate', 'feed_forward', 'in_rows', 'jacobian', 'level', 'make_evaluation',
    'measure', 'observe', 'observe_rows', 'own_motion', 'position', 'positions', 'rotation',
    'slowdown', 'value', 'velocity'}


class TwinHolder(KeyHolder):
    """
    Holder of the twin of a task, and base class of `Task`.

    Attributes
    ----------
    led : bool
        Something else demands what leads to the goal; the task has no twin meanwhile.

    """

    led = False

    def make_twin(self) -> Twin | None:
        """Return the present inputs in the compiled core; None if Python evaluates the type."""
        return None

    def __setattr__(self, name: str, value: Any) -> None:
        """Set an attribute; the twin, which has copies of the inputs, is made anew."""
        own = self.__dict__
        object.__setattr__(self, name, value)
        own.pop('_twin', None)
        if '_watch' in own:
            own['_watch'].changed = True

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes for a copy; it has a twin of its own, which nobody watches."""
        # A copy in one step: the cycle of another thread may make a twin meanwhile.
        state = dict(self.__dict__)
        for name in ('_twin', '_watch'):
            state.pop(name, None)
        return state

    @property
    def twin(self) -> Twin | None:
        """Return the inputs in the compiled core; None if Python evaluates the task."""
        own = self.__dict__
        if '_twin' not in own:
            own['_twin'] = None if self.led or EVALUATION_METHODS & own.keys() \
                else self.make_twin()
        found: Twin | None = own['_twin']
        return found

    def watch(self, watch: Watch) -> None:
        """Report changes of the inputs to one watcher, in place of the one before."""
        self.__dict__['_watch'] = watch

    def move_goal(self, goal: Goal, velocity: Array, now: float) -> None:
        """
        Set a goal that moves, and its velocity, in every cycle.

        Parameters
        ----------
        goal : object
            Goal in internal form.
        velocity : ndarray
            Feed-forward velocity in internal form, in force until its timeout.
        now : float
            [s]

        """
        own, twin = self.__dict__, self.__dict__.get('_twin')
        if twin is not None and type(self).set_feed_forward is TwinHolder.set_feed_forward \
                and twin.task.move_goal(goal, self.in_rows(velocity), now):
            # The twin has them already.
            own.update(goal=read_only(goal), _feed_forward=velocity, _feed_forward_time=now)
            return
        self.goal = goal
        self.set_feed_forward(velocity, now)

    def _law(self) -> Law:
        """Return the part of the twin's inputs that all types share."""
        added = self._feed_forward
        return (self.rows, self.mode == 'scale', read_only(self.gain),
                None if added is None else read_only(self.in_rows(added)),
                self._feed_forward_time, self.timeout, self.joint_mask,
                None if self.row_weights is None else read_only(self.row_weights))
