# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Distances between the links of a robot: the task type `self_collision`."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np
from tp_controller.errors import TaskError
from tp_controller.model.clearance import Clearance
from tp_controller.model.robot import Robot
from tp_controller.model.srdf import srdf_pairs
from tp_controller.tasks.collision import CollisionTask, MOST_PAIRS
from tp_controller.tasks.keys import optional
from tp_controller.tasks.yaml_keys import yaml_key

# Number of random postures used to find pairs whose shapes overlap by design. One pair of Panda is
# near in 39 % of the postures: 30 misclassify it in 8 of 100 cases, 100 in 1.
SAMPLED_POSTURES = 100
# Range ± of these postures for joints without limits [rad or m].
SAMPLED_RANGE = math.pi


class SelfCollision(CollisionTask):
    """
    Keep the links of the robot a distance apart.

    Pairs are not checked if at most one moving joint is between their links, if no driven joint
    moves them against each other, if an SRDF or `ignore` names them, or if they are in `left_out`.

    Attributes
    ----------
    pairs : list of str
        Names of the checked pairs.
    left_out : list of str
        Names of pairs nearer than `distance` in most random postures within the joint limits:
        their shapes overlap by design.

    """

    type_name = 'self_collision'

    harmless: set[frozenset[str]] = yaml_key(
        'SRDF whose disable_collisions name links that may touch: text, a file or '
        'package://<package>/<path>', optional(srdf_pairs), None, name='srdf')
    ignored: set[frozenset[str]] = yaml_key(
        'more pairs of links that may touch, [[link, link], …]', default=None, name='ignore',
        parse_for=lambda task, pairs: set() if pairs is None else _pairs(task.robot, pairs))

    def set_up(self) -> None:
        """Find the pairs, or raise `TaskError` if there are too many or none."""
        super().set_up()
        pairs = self._candidates((self.harmless or set()) | self.ignored)
        if len(pairs) > MOST_PAIRS:
            raise TaskError(self.name, [(
                'links', f'at most {MOST_PAIRS} pairs of shapes, got {len(pairs)}: name fewer '
                         'links, or pairs that may touch')])
        near = self._mostly_near(pairs)
        self.left_out = list(near.values())
        self._set_pairs(self._solids, [pair for index, pair in enumerate(pairs)
                                       if index not in near])
        self.pairs = list(self._clearance.names)
        if not self.pairs:
            raise TaskError(self.name, [('links', self._no_pairs())])
        if self.left_out:
            self.remarks = (f'not kept apart, as nearer than distance = {self.distance:g} in most '
                            f'postures: {", ".join(self.left_out)}',)

    def with_all_links(self) -> 'SelfCollision':
        """Return the same task for all links that have shapes, or raise `TaskError`."""
        keys: dict[str, Any] = {**self._given_keys, 'links': None}
        return type(self)(self.robot, self.name, **keys)

    def _no_pairs(self) -> str:
        """Return the message about a task without pairs."""
        if self.left_out:
            return (f'all pairs are nearer than distance = {self.distance:g} in most postures: '
                    f'{", ".join(self.left_out)}')
        links = list(dict.fromkeys(each.frame for each in self._solids))
        return ('no two of them can come near each other, or all pairs are ignored: name all '
                f'links that are to be kept apart, got {", ".join(links)}')

    def _candidates(self, harmless: set[frozenset[str]]) -> list[tuple[int, int]]:
        """Return the pairs of solids (int, int) whose links can move against each other."""
        rows = {frame: row for row, frame in enumerate(
            dict.fromkeys(each.frame for each in self._solids))}
        every, driven = self.robot.kinematics.joints_between(list(rows))
        checked = (every > 1.0) & (driven > 0.0)
        for links in harmless:
            if len(links) == 2 and links <= rows.keys():
                one, other = (rows[link] for link in links)
                checked[one, other] = checked[other, one] = False
        row = [rows[each.frame] for each in self._solids]
        return [(one, other) for one, other in np.argwhere(
            np.triu(checked[row][:, row], 1)).tolist()]

    def _mostly_near(self, pairs: Sequence[tuple[int, int]]) -> dict[int, str]:
        """Return {index: name} of the pairs nearer than `distance` in most postures."""
        robot = self.robot
        state = robot.state(robot.neutral())
        clearance = Clearance(robot.kinematics, self._solids, pairs, self.distance)
        times = np.zeros(len(pairs))
        # A fixed seed gives the same postures each time the stack is read.
        chance = np.random.default_rng(0)
        joints = robot.joint_columns
        lower = np.maximum(robot.lower[joints], -SAMPLED_RANGE)
        upper = np.minimum(robot.upper[joints], SAMPLED_RANGE)
        for _ in range(SAMPLED_POSTURES):
            state.update(robot.configuration(chance.uniform(lower, np.maximum(lower, upper))))
            times[clearance.near(state)] += 1
        return {pair: clearance.names[pair]
                for pair in np.flatnonzero(times > 0.5 * SAMPLED_POSTURES).tolist()}


def _pairs(robot: Robot, pairs: Sequence[Sequence[str]]) -> set[frozenset[str]]:
    """Return pairs of links as a set of sets; raise if invalid."""
    if not isinstance(pairs, (list, tuple)) or not all(
            isinstance(pair, (list, tuple)) and len(pair) == 2 for pair in pairs):
        raise ValueError(f'needs pairs of links, [[link, link], …], got {pairs!r}')
    return {frozenset(map(robot.check_frame, pair)) for pair in pairs}
