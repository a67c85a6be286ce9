# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The files of the demos: robots, parameters, stacks and goals match, and goals are reached."""

import importlib
import os
import subprocess
import sys

import numpy as np
import pytest
from robots import CONFIG, REPOSITORY
from tp_controller import Controller, GoalError, KinematicSimulator
from tp_controller.tasks import task_types
from tp_controller.tools.cli.demo import DEMOS as DESCRIBED
from tp_controller.tools.cli.demo import INTERACTIVE_DEMO
from tp_controller.tools.cli.view import DEMOS as VIEWED
from tp_controller.tools.cli.view import LESSONS, PLAYED, WITHOUT_PAGE
from tp_controller.tools.demos.scenarios import DEMOS, goal_fields, node_parameters
from tp_controller.tools.demos.scenes import DEMOS as SCENES
from tp_controller.tools.demos.scenes import SCENES as ALL_SCENES
import yaml

PERIOD = 0.01
SECONDS = 15.0
FILES = {**DEMOS, **SCENES}
demos = pytest.mark.parametrize('demo', FILES.values(), ids=FILES)


def parameters(demo, node):
    """Return the parameters of a node."""
    return node_parameters(demo.file(''), node)


def goal_of(fields):
    """Return the goal for the library of the fields of a message."""
    if {'linear', 'angular'} & set(fields):
        return [*fields.get('linear', (0.0, 0.0, 0.0)), *fields.get('angular', (0.0, 0.0, 0.0))]
    return [*fields.get('xyz', ()), *fields.get('quat_xyzw', ())]


def types_in(path):
    """Return the task types of a stack file."""
    return {keys['type'] for level in yaml.safe_load(path.read_text())
            for entry in (level if isinstance(level, list) else [level])
            for keys in entry.values()}


class Run:
    """
    The demo as a closed loop in the library.

    Attributes
    ----------
    states, velocities, reports : list
        One entry for each cycle.
    outcomes : list of dict
        For each step, the status of every task at its end.

    """

    def __init__(self, demo):
        self.robot = demo.robot
        self.stack = demo.stack
        self.controller = Controller(self.robot, self.stack, demo.settings)
        self.simulator = KinematicSimulator(self.robot, demo.start)
        self.now, self.outcomes = 0.0, []
        self.q, self.velocities, self.reports = [], [], []
        self._cycle()
        for step in demo.steps:
            self._carry_out(step)

    def _carry_out(self, step):
        """Send the goals of a step, and go on until they are reached."""
        began, names = self.now, [goal['task'] for goal in step]
        lasts = max(goal.get('for', 0.0) for goal in step)
        while self.now - began < SECONDS:
            if lasts or self.now == began:
                for goal in step:
                    self.controller.set_goal(goal['task'], goal_of(goal_fields(goal)), self.now)
            status = self._cycle()
            if self.now - began > max(lasts, 1.0) \
                    and all(status[name] == 'reached' for name in names):
                break
        self.outcomes.append(status)

    def _cycle(self):
        """Run one cycle; return {task: status}."""
        command = self.controller.update(self.simulator.q, self.now)
        self.q.append(self.simulator.q)
        self.velocities.append(command.velocity)
        self.reports.append(command.report)
        self.simulator.command(command.velocity)
        self.simulator.step(PERIOD)
        self.now += PERIOD
        return {task.name: task.status for task in command.report.tasks}

    def errors(self, name, unit='m'):
        """Return the errors of a task, one for each cycle."""
        return np.array([next(error for error, each, _ in task.errors if each == unit)
                         for report in self.reports for task in report.tasks
                         if task.name == name])

    def places(self, frame):
        """Return where a frame was (T, 3) [m]."""
        state = self.robot.state(self.q[0])
        places = []
        for q in self.q:
            state.update(q)
            places.append(state.position(frame))
        return np.array(places)


@pytest.fixture(scope='module')
def run():
    """Return what runs a demo, each once."""
    done = {}

    def run(name):
        if name not in done:
            done[name] = Run(DEMOS[name])
        return done[name]

    return run


# Files ----------------------------------------------------------------------------------------

def test_every_demo_is_described_where_it_is_chosen():
    assert set(DEMOS) < set(DESCRIBED)


@demos
def test_both_nodes_of_a_demo_have_one_robot_and_the_stack_of_its_name(demo):
    simulator, controller = (parameters(demo, node) for node in ('tp_simulator', 'tp_controller'))
    assert simulator.get('base', 'fixed') == controller.get('base', 'fixed') == demo.robot.base
    assert controller['stack'].rpartition('/')[2] == demo.file('_stack').name
    assert len(controller.get('weights', demo.robot.velocity_names)) == demo.robot.n
    start = demo.robot.positions(demo.start)
    assert (start > demo.robot.lower).all() and (start < demo.robot.upper).all()


@demos
def test_every_velocity_of_a_demo_has_limits_in_speed_and_change(demo):
    assert np.isfinite(demo.robot.velocity).all()
    assert np.isfinite(demo.robot.acceleration).all()


@demos
def test_parameter_files_set_what_the_nodes_have(demo):
    pytest.importorskip('rclpy')
    for node, module in (('tp_controller', 'controller_node'), ('tp_simulator', 'simulator_node')):
        specs = importlib.import_module(f'tp_controller.ros.{module}').PARAMETERS
        assert set(parameters(demo, node)) <= {spec.name for spec in specs} | {'limits'}


@demos
def test_goals_of_a_demo_are_ones_that_their_tasks_take(demo):
    for step in demo.steps:
        assert len({goal['task'] for goal in step}) == len(step)
        for goal in step:
            assert goal['say'] and set(goal) <= {'task', 'say', 'xyz', 'rpy', 'linear',
                                                 'angular', 'for'}
            try:
                demo.stack.tasks[goal['task']].parse_goal(goal_of(goal_fields(goal)))
            except GoalError as error:
                pytest.fail(str(error))


@demos
def test_frames_that_are_drawn_are_ones_of_the_robot(demo):
    leader = demo.stack.tasks[demo.leader]
    for frame in (leader.frame, *demo.look.frames,
                  *(frame for pair in demo.look.carried for frame in pair)):
        assert frame in demo.robot.frame_names


def test_every_task_type_is_in_a_stack_that_a_demo_uses_or_has_a_picture():
    named = ''.join(path.read_text(encoding='utf-8') for path in (
        *(REPOSITORY / 'tp_controller' / 'tools' / 'demos').glob('*.py'),
        REPOSITORY / 'docs' / 'lab.md'))
    used = {demo.file('_stack').name for demo in FILES.values()}
    used |= {path.name for path in CONFIG.glob('*.yaml') if path.name in named
             and isinstance(yaml.safe_load(path.read_text()), list)}
    used -= {demo.file('_goals').name for demo in FILES.values()}
    shown = set().union(*(types_in(CONFIG / name) for name in used))
    own = {name for name, kind in task_types().items()
           if kind.__module__.startswith('tp_controller.')}
    pictures = {path.stem for path in (REPOSITORY / 'docs' / 'images' / 'tasks').iterdir()}
    assert shown <= own <= shown | pictures


# Closed loops ---------------------------------------------------------------------------------

@pytest.mark.parametrize('name', [name for name in DEMOS if name != 'panda'])
@pytest.mark.slow
def test_goals_are_reached_within_the_limits(run, name):
    motion = run(name)
    for step, outcome in zip(DEMOS[name].steps, motion.outcomes):
        assert {goal['task']: outcome[goal['task']] for goal in step} == {
            goal['task']: 'reached' for goal in step}
    robot, velocities = motion.robot, np.array(motion.velocities)
    assert (np.abs(velocities) <= robot.velocity).all()
    changes = np.abs(np.diff(velocities, axis=0)) / PERIOD
    assert (changes <= robot.acceleration * (1.0 + 1e-9)).all()
    positions = np.array([robot.positions(q) for q in motion.q])
    assert (positions >= robot.lower).all() and (positions <= robot.upper).all()


@pytest.mark.slow
def test_tray_stays_level_and_the_base_follows_only_to_what_is_far(run):
    motion = run('mobile')
    assert motion.errors('level', 'rad').max() < 1e-3
    assert max(motion.errors('clear').max(), motion.errors('reach').max()) < 2e-3
    base, tray = motion.places('base_link'), motion.places('tool')
    near = np.flatnonzero(motion.errors('tray') > 1.0)[0]
    assert np.linalg.norm(base[:near] - base[0], axis=1).max() < 0.05
    assert np.linalg.norm(tray[near] - tray[0]) > 0.2
    assert np.linalg.norm(base[-1] - base[0]) > 1.5
    # The pillar is in its way: it comes nearly as near as it may, and no nearer.
    clear, state = motion.stack.tasks['clear'], motion.robot.state(motion.q[0])
    distances = []
    for q in motion.q:
        state.update(q)
        distances.extend(clear.value(state))
    assert 0.05 - 2e-3 < min(distances) < 0.09


@pytest.mark.slow
def test_vehicle_goes_around_the_riser_and_gives_way_to_tool_and_view(run):
    motion = run('underwater')
    vehicle = motion.places('vehicle')
    assert np.hypot(*(vehicle - (0.6, 0.75, 0.0))[:, :2].T).min() > 0.15 + 0.8 - 2e-3
    # The straight way would have been too near.
    assert vehicle[:, 1].min() < -0.1
    speed = np.linalg.norm(np.diff(motion.places('tool'), axis=0), axis=1) / PERIOD
    assert speed.max() < 0.301
    assert motion.errors('view', 'rad').max() < 5e-3
    turning = np.flatnonzero(motion.errors('heading', 'rad') > 0.3)[-1]
    assert motion.errors('tool')[turning:].max() < 2e-3 < motion.errors('station')[-1]


@pytest.mark.slow
def test_hands_keep_their_distance_while_they_carry(run):
    motion = run('two_arms')
    between = np.linalg.norm(motion.places('left_hand') - motion.places('right_hand'), axis=1)
    assert np.ptp(between) < 3e-3
    assert np.ptp(motion.places('left_hand'), axis=0).min() > 0.1
    for name, unit, most in (('grip', 'm', 5e-3), ('watch', 'rad', 5e-3), ('balance', 'm', 3e-3),
                             ('apart', 'm', 1e-3), ('joints', 'rad', 1e-3)):
        assert motion.errors(name, unit).max() < most, name


@pytest.mark.slow
def test_a_demo_needs_no_library_for_recordings():
    code = ('import sys\nsys.modules["rosbags"] = None\n'
            'from tp_controller.tools.demos import drill, lab, ros_demos\n'
            'from importlib.util import find_spec\n'
            'if find_spec("rclpy"):\n'
            '    from tp_controller.tools.demos import motion_recorder\n')
    subprocess.run([sys.executable, '-c', code], check=True, timeout=120, env={
        **os.environ, 'PYTHONPATH': os.pathsep.join((str(REPOSITORY), *filter(None, sys.path)))})


def test_every_demo_is_found_by_both_commands():
    ours = set(DESCRIBED) | {INTERACTIVE_DEMO}
    assert sorted((*VIEWED, *PLAYED, *WITHOUT_PAGE)) == sorted(ours)
    assert set(VIEWED) - set(FILES) == {INTERACTIVE_DEMO}
    assert set(LESSONS) == set(ALL_SCENES) and set(LESSONS) - set(PLAYED) == set(SCENES)
