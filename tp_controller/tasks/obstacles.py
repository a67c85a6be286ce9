# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Distances from the links of a robot to obstacles: the task type `obstacles`."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from tp_controller.errors import GoalError
from tp_controller.model.solids import solid
from tp_controller.model.spatial import Array
from tp_controller.model.state import RobotState
from tp_controller.tasks.collision import CollisionTask, MOST_PAIRS
from tp_controller.tasks.frame import reference_key
from tp_controller.tasks.keys import Keys
from tp_controller.tasks.obstacle_goals import ALL_OBSTACLES, Obstacle, parse_obstacles
from tp_controller.tasks.sketch import Body, Sketch
from tp_controller.tasks.task import Evaluation, Task
from tp_controller.tasks.yaml_keys import yaml_key

# Largest number of obstacles; each costs time in every cycle.
MOST_OBSTACLES = 100


class Obstacles(CollisionTask):
    """
    Keep the links of the robot a distance away from obstacles.

    A goal changes the obstacles: ``{name: {shape: …, at: …, lifetime: …}}`` adds or moves them,
    ``{name: None}`` removes one, and ``{'*': None}`` removes all.
    """

    type_name = 'obstacles'
    goal_type = 'obstacles'
    sketch_parts = {'obstacle': False, 'distance': False}
    example = {**CollisionTask.example, 'obstacles': {
        'pole': {'shape': {'cylinder': [0.05, 1.0]}, 'at': [0.55, 0.1, 0.3]}}}

    _fixed: dict[str, Obstacle] = yaml_key(
        '{name: {shape: …, at: …}}, shapes and places as for keep_out, but only a half_space '
        'needs no place (default: none, they come as goals)',
        lambda obstacles: parse_obstacles({} if obstacles is None else obstacles), None,
        name='obstacles')
    reference: str = reference_key(
        'frame that the obstacles belong to and move with (default: the root)')

    def check_keys(self, keys: Keys) -> None:
        """Select the solids that the joints move against the reference."""
        super().check_keys(keys)
        if self.reference is not None:
            _, driven = self.robot.kinematics.joints_between(
                [self.reference, *(each.frame for each in self._solids)])
            self._solids = [each for each, joints in zip(self._solids, driven[0, 1:])
                            if joints > 0.0]
            if not self._solids and not keys.faults:
                keys.faults.append(('links', 'the joints move none of these links against '
                                             f'{self.reference}'))
        if not keys.faults and len(self._fixed) > self._largest_number():
            keys.faults.append(('obstacles', self._too_many(len(self._fixed))))

    def set_up(self) -> None:
        """Set the pairs of links and obstacles."""
        super().set_up()
        # Names of the obstacles in the order of their solids.
        self._order: list[str] = []
        self._update_solids()

    @property
    def obstacles(self) -> dict[str, Obstacle]:
        """Return {name: Obstacle} of the present obstacles."""
        return {name: obstacle for name, obstacle in {**self._fixed, **(self.goal or {})}.items()
                if obstacle is not None}

    def _largest_number(self) -> int:
        """Return the largest number of obstacles."""
        return min(MOST_OBSTACLES, MOST_PAIRS // len(self._solids))

    def _too_many(self, count: int) -> str:
        """Return the message about too many obstacles."""
        return f'at most {self._largest_number()} obstacles, got {count}'

    def _update_solids(self) -> None:
        """Update the solids and pairs to the present obstacles."""
        around = self.obstacles
        order = list(self._order)
        for name in [name for name in order if name not in around]:
            # The last one moves to its index. All others keep theirs, so existing pairs are kept.
            last = order.pop()
            if last != name:
                order[order.index(name)] = last
        self._order = order + [name for name in around if name not in order]
        there = [solid(name, self.reference, around[name].shape, around[name].pose)
                 for name in self._order]
        links = len(self._solids)
        self._set_pairs(self._solids + there, [
            (link, links + other) for other in range(len(there)) for link in range(links)])

    def make_evaluation(self, state: RobotState, now: float) -> Evaluation:
        """Return the `Evaluation` at a state."""
        over = [name for name, obstacle in self.obstacles.items() if obstacle.gone(now)]
        if over:
            self.set_goal(dict.fromkeys(over), now)
        return super().make_evaluation(state, now)

    def set_goal(self, goal: dict[str, Obstacle | None], now: float) -> None:
        """Add, move or remove obstacles, as `parse_goal` returned them."""
        # None disables an obstacle of the stack.
        there = dict.fromkeys(self._fixed) if ALL_OBSTACLES in goal else dict(self.goal or {})
        for name, obstacle in goal.items():
            if obstacle is not None:
                there[name] = replace(obstacle, since=now)
            elif name in self._fixed:
                there[name] = None
            else:
                there.pop(name, None)
        super().set_goal(there, now)
        self._update_solids()

    def parse_goal(self, goal: Any) -> dict[str, Obstacle | None]:
        """Return {name: Obstacle or None}, or raise `GoalError`."""
        try:
            changes = parse_obstacles(goal, removals=True)
        except (GoalError, ValueError) as error:
            raise GoalError(f'the goal of task {self.name!r}: {error}') from error
        left = set() if ALL_OBSTACLES in changes else set(self.obstacles)
        left |= {name for name, obstacle in changes.items() if obstacle is not None}
        if len(left) > self._largest_number():
            raise GoalError(f'the goal of task {self.name!r}: {self._too_many(len(left))}')
        return changes

    def goal_in_reference(self, goal: dict[str, Obstacle | None],
                          T_reference_frame: Array) -> dict[str, Obstacle | None]:
        """Transform obstacles from another frame to the reference frame."""
        return {name: None if obstacle is None else
                replace(obstacle, pose=T_reference_frame.dot(obstacle.pose))
                for name, obstacle in goal.items()}

    def sketch(self, state: RobotState) -> Sequence[Sketch]:
        """Return the obstacles and the distances of the last cycle."""
        T_root_reference = state.pose(self.reference)
        return [*super().sketch(state),
                *(Body(f'obstacle/{name}', T_root_reference.dot(obstacle.pose), obstacle.shape)
                  for name, obstacle in self.obstacles.items())]

    def inherit_goal(self, other: Task) -> None:
        """Inherit the obstacles that a task that this one replaces received as goals."""
        inherits = self.goal is None and self.is_compatible(other) and other.goal is not None
        super().inherit_goal(other)
        if inherits:
            self.goal = {name: obstacle for name, obstacle in other.goal.items()
                         if obstacle is not None}
            self._update_solids()
