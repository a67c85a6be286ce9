# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Follow hints, and compare what becomes of the tasks with what becomes of them otherwise.

Run as ``python benchmarks/hints.py``; ``--hints 40`` for a first impression. The tasks of a robot
get random goals, compatible ones in one run of two. At a random moment one limited task is drawn,
its hint is read, and if it is one that a program can follow, it is: tasks are exchanged or get
levels of their own, velocity limits are raised threefold, gains and settings lowered. The same run
without that is the comparison. Both go on for `LATER` seconds.

*Arrive* are the tasks that reach their goals without that. Of the others, *helped* are those that
then arrive, or whose error is at least a fifth smaller. *Worse* are those whose error is larger by
a fifth, and those in which this is so of a task above that the hint does not name. `wait` changes
nothing: it helps if the task arrives within `LATER` or half as long again as it says, or its error
is at least a fifth smaller than when it was read.
"""

import argparse
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
import re
from typing import TypeAlias

from _robots import load_robot
from causes import CASES, configuration
import numpy as np
from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.control.report import Report
import yaml

SEED, HINTS = 0, 400
ROBOTS = 'Panda', 'UR5', 'xArm 7', 'Baxter'
PERIOD, ACCELERATIONS = 0.01, (None, 8.0)
# Moment at which a hint is followed, and time that both runs go on [s].
MOMENTS, LATER = (0.3, 4.0), 10.0
PATIENCE = 1.5
RAISED, LOWERED = 3.0, 0.1
HELPED = 0.8
# Errors below this are none [m or rad].
NEGLIGIBLE = 1e-4


# Change of a controller while it runs.
Change: TypeAlias = Callable[[Controller], None]


@dataclass
class Scene:
    """A robot with a stack and goals, whose run can be repeated."""

    robot: Robot
    settings: Settings
    stack: list
    goals: dict[str, np.ndarray]
    start: np.ndarray
    limits: dict[str, float]
    moment: float
    later: float = LATER

    @property
    def names(self) -> list[str]:
        """Return the names of the tasks."""
        return [next(iter(task)) for task in self.stack]

    def run(self, follow: Change | None = None) -> Iterator[tuple[float, Report]]:
        """Yield time and report of each cycle; a hint is followed at its moment."""
        controller = Controller(self.robot, stack_of(self.stack, self.robot), self.settings)
        controller.set_velocity_limits(self.limits)
        q = self.start
        controller.update(q, 0.0)
        for name, goal in self.goals.items():
            controller.set_goal(name, goal, 0.0)
        cycle = 0
        while cycle * PERIOD < self.moment + self.later:
            cycle += 1
            now = cycle * PERIOD
            if follow and now >= self.moment:
                follow(controller)
                follow = None
            command = controller.update(q, now)
            yield now, command.report
            q = self.robot.integrate(q, command.velocity, PERIOD)


def stack_of(tasks: list, robot: Robot) -> Stack:
    """Return the stack of tasks as in a stack file."""
    return Stack.from_yaml(yaml.safe_dump(tasks, default_flow_style=None), robot)


def draw(name: str, number: int) -> Scene:
    """Return the scene of a robot by its number."""
    random = np.random.default_rng([SEED, number])
    usual = load_robot(name)
    limits = dict(zip(usual.velocity_names, usual.velocity.tolist()))
    acceleration = random.choice(np.array(ACCELERATIONS, dtype=object))
    robot = load_robot(name, limits={
        joint: {'velocity': RAISED * value} | (
            {'acceleration': acceleration} if acceleration else {})
        for joint, value in limits.items()})
    stacks = CASES[name]
    tasks = yaml.safe_load(stacks[random.integers(len(stacks))])
    for task in tasks:
        for keys in task.values():
            if 'shape' not in keys and keys['type'] != 'joint_limits':
                keys['gain'] = float(random.choice([0.5, 1.0, 2.0, 60.0], p=[0.3, 0.3, 0.3, 0.1]))
    stack, goals = stack_of(tasks, robot), {}
    there = robot.state(configuration(robot, random))
    compatible = random.random() < 0.5
    for task in stack.tasks.values():
        if not task.bounded:
            if not compatible:
                there = robot.state(configuration(robot, random))
            goals[task.name] = task.value(there)
    return Scene(robot, Settings(period=PERIOD, command_delay=0), tasks, goals,
                 configuration(robot, random), limits, random.uniform(*MOMENTS))


class Follower:
    """
    A program that follows hints.

    Parameters
    ----------
    scene : Scene
        The run in which it does.

    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._patterns = (
            (r'exchange (\S+) and (\S+) in', self._exchange),
            (r'put (\S+) above (.+?)(?: until all| \(|$)', self._put_above),
            (r'raise the velocity limits? of (.+)', self._raise_limits),
            (r'lower the setting (\S+)', self._lower),
            (r'set scaling to (\S+)', self._scale),
            (r'a gain of at most (\S+)/s', self._lower_gains))

    def of(self, hint: str) -> Change | None:
        """Return a function that follows all parts of a hint; None if no program can."""
        # A cost is no part of it.
        hint = re.sub(r' \(.*? goals?\)', '', re.sub(r'^wait .*?, or ', '', hint))
        parts = [self._of_part(part) for part in hint.split(', and ')]
        return None if None in parts else lambda controller: [part(controller) for part in parts]

    def _of_part(self, hint: str) -> Change | None:
        """Return a function that follows a part of a hint; None if no program can."""
        for pattern, follow in self._patterns:
            match = re.search(pattern, hint)
            if match:
                return follow(*match.groups())
        return (lambda controller: None) if hint.startswith('wait') else None

    def _replaced(self, tasks: list) -> Change:
        """Return a function that replaces the stack."""
        return lambda controller: controller.replace_stack(stack_of(tasks, self._scene.robot))

    def _exchange(self, one: str, other: str) -> Change:
        """Return a function that exchanges two tasks."""
        tasks, names = list(self._scene.stack), self._scene.names
        i, j = names.index(one), names.index(other)
        tasks[i], tasks[j] = tasks[j], tasks[i]
        return self._replaced(tasks)

    def _put_above(self, one: str, others: str) -> Change:
        """Return a function that puts a task above others."""
        tasks, names = list(self._scene.stack), self._scene.names
        moved = tasks.pop(names.index(one))
        tasks.insert(min(names.index(each) for each in listed(others)), moved)
        return self._replaced(tasks)

    def _raise_limits(self, joints: str) -> Change:
        """Return a function that raises velocity limits: all where some are only counted."""
        limits = self._scene.limits
        names = limits if ' more' in joints else listed(joints)
        return lambda controller: controller.set_velocity_limits(
            {name: RAISED * limits[name] for name in names})

    def _lower(self, setting: str) -> Change:
        """Return a function that lowers a setting."""
        def change(controller: Controller) -> None:
            controller.settings = replace(controller.settings, **{
                setting: LOWERED * getattr(controller.settings, setting)})
        return change

    @staticmethod
    def _scale(scaling: str) -> Change:
        """Return a function that changes the scaling."""
        def change(controller: Controller) -> None:
            controller.settings = replace(controller.settings, scaling=scaling)
        return change

    @staticmethod
    def _lower_gains(gain: str) -> Change:
        """Return a function that lowers all gains that are higher."""
        def change(controller: Controller) -> None:
            for name, task in controller.stack.tasks.items():
                if not task.bounded and np.max(task.gain) > float(gain):
                    controller.set_gain(name, float(gain))
        return change


def listed(names: str) -> list[str]:
    """Return the names in a text."""
    return re.split(', and |, | and ', names)


def kind_of(hint: str) -> str:
    """Return the kind of a hint: its text without names and numbers."""
    hint = re.sub(r'(exchange|limits? of|above|goals of) .*?( in the| that are| until all|$)',
                  r'\1 …\2', hint)
    return re.sub(r'[\d.]+', '…', hint)[:60]


def errors(report: Report) -> dict[str, float]:
    """Return the error of each task, in units of its tolerance where it has some."""
    return {task.name: max(value / (tolerance or 1.0) for value, _, tolerance in task.errors)
            for task in report.tasks}


def compare(scene: Scene, random: np.random.Generator
            ) -> tuple[str, tuple[bool, bool, bool] | None] | None:
    """
    Return the kind of a hint, and whether the task arrives anyway, is helped, or is worse.

    Instead of the latter None where no program can follow it; None alone where there is no hint.
    """
    task, before = None, None
    for now, report in scene.run():
        if task is None and now >= scene.moment:
            drawn = [each for each in report.tasks if each.hint]
            if not drawn:
                return None
            task = drawn[random.integers(len(drawn))]
            hint, name = task.hint, task.name
            wait = re.fullmatch(r'wait (\S+) s( until .*)?', hint)
            if wait:
                scene.later = max(LATER, PATIENCE * float(wait[1]))
            first = errors(report)
            follow = Follower(scene).of(hint)
            if follow is None:
                return kind_of(hint), None
        before = report
    *_, (_, after) = scene.run(follow)
    without, then = errors(before), errors(after)
    names = [each.name for each in before.tasks]
    above = [each for each in names[:names.index(name)] if each not in re.split(r'[ ,]+', hint)]
    arrived = {each.name for each in after.tasks if each.reached}
    return kind_of(hint), (
        any(each.reached for each in before.tasks if each.name == name),
        name in arrived or then[name] < HELPED * (first if wait else without)[name],
        any(then[each] > without[each] / HELPED + NEGLIGIBLE and each not in arrived
            for each in (name, *above)))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--hints', type=int, default=HINTS, help='hints that are followed')
    options = parser.parse_args()
    counts, others = defaultdict(lambda: np.zeros(4, int)), Counter()
    number = 0
    while sum(count[0] for count in counts.values()) < options.hints:
        found = compare(draw(ROBOTS[number % len(ROBOTS)], number),
                        np.random.default_rng([SEED, number, 1]))
        number += 1
        if found and found[1]:
            arrives, helped, worse = found[1]
            counts[found[0]] += 1, arrives, helped and not arrives, worse
        elif found:
            others[found[0]] += 1
    print('| hint | followed | arrive | of the others helped | worse |\n|' + ' --- |' * 5)
    counts['all'] = sum(counts.values())
    for kind, (count, arrives, helped, worse) in sorted(
            counts.items(), key=lambda item: -item[1][0]):
        print(f'| {kind} | {count} | {arrives} | {helped} of {count - arrives} | {worse} |')
    print('\nNot followed:',
          *[f'{count} {kind}' for kind, count in others.most_common()], sep='\n')


if __name__ == '__main__':
    main()
