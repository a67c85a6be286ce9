# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Stacks with a known verdict: sound ones, and ones with a mistake that people make.

`SOUND` is what a competent roboticist would run as it is. Every mistake of `FAULTS` is made on
three robots, in a stack that is sound without it.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import lru_cache
from importlib.metadata import files
import math
from pathlib import Path
import re
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from robots import CONFIG, urdf_path, URDFS
from tp_controller import Robot, Settings, Stack
from tp_controller.tools.check import check, CheckReport
from tp_controller.tools.check.findings import about_parameters
from tp_controller.tools.check.parameter_file import read

# Numbers of a check, unless a case has others: few, so that all cases take minutes.
FEW = {'samples': 60, 'runs': 6, 'seconds': 15.0}
SETTING_NAMES = frozenset(item.name for item in fields(Settings))

# Robots ----------------------------------------------------------------------------------


class Arm(NamedTuple):
    """
    A robot with what stacks for it name.

    Attributes
    ----------
    source : str
        File in config/robots/, name in `robots.URDFS`, or end of a path of example-robot-data.
    tool, elbow : str
        Frame of the tool, and one in the middle of the arm.
    reach : float
        From the root to the tool at most, rounded up [m].
    prefix : tuple of str
        Driven joints: all that start with one of these; empty: all.
    base : str
    acceleration : float
        Limit of all joints without one [rad/s² or m/s²]; infinite: none.

    """

    source: str
    tool: str
    elbow: str
    reach: float
    prefix: tuple[str, ...] = ()
    base: str = 'fixed'
    acceleration: float = 10.0


ARMS = {
    'planar': Arm('planar_3r.yaml', 'link3', 'link2', 1.75, acceleration=5.0),
    'panda': Arm('panda.yaml', 'panda_hand_tcp', 'panda_link4', 1.2),
    'panda urdf': Arm('panda', 'panda_hand_tcp', 'panda_link4', 1.2, ('panda_joint',)),
    'ur5': Arm('ur5', 'tool0', 'forearm_link', 1.1),
    'ur5e': Arm('ur5e.yaml', 'tool0', 'forearm_link', 1.1),
    'ur10': Arm('urdf/ur10_robot.urdf', 'tool0', 'forearm_link', 1.5),
    'xarm7': Arm('xarm7', 'link_eef', 'link4', 1.0),
    'xarm7 dh': Arm('xarm7.yaml', 'link_eef', 'link4', 1.0),
    'gen3': Arm('gen3.yaml', 'end_effector_link', 'forearm_link', 1.2),
    'fr3': Arm('fr3.yaml', 'fr3_hand_tcp', 'fr3_link4', 1.2),
    'z1': Arm('urdf/z1.urdf', 'gripperStator', 'link03', 0.9,
              tuple(f'joint{number}' for number in range(1, 7))),
    'so100': Arm('urdf/so100.urdf', 'gripper', 'lower_arm', 0.5, ('shoulder', 'elbow', 'wrist')),
    'baxter': Arm('baxter', 'left_gripper', 'left_lower_elbow', 1.5,
                  ('left_s', 'left_e', 'left_w', 'right_s', 'right_e', 'right_w')),
    'talos arm': Arm('talos_arm', 'gripper_left_base_link', 'arm_left_4_link', 0.9, ('arm',)),
    'talos': Arm('talos', 'gripper_left_base_link', 'arm_left_4_link', 1.5, ('torso', 'arm')),
    'tiago': Arm('tiago', 'arm_tool_link', 'arm_4_link', 1.6, ('torso', 'arm')),
    'rover': Arm('tiago', 'arm_tool_link', 'arm_4_link', 1.6, ('torso', 'arm'), 'planar', 2.0),
    'moving panda': Arm('panda.yaml', 'panda_hand_tcp', 'panda_link4', 1.2, base='planar',
                        acceleration=5.0),
    'flying panda': Arm('panda.yaml', 'panda_hand_tcp', 'panda_link4', 1.2, base='floating',
                        acceleration=5.0),
    'mobile': Arm('mobile_arm.urdf', 'tool', 'elbow', 2.0, base='differential',
                  acceleration=3.0),
    'underwater': Arm('underwater_arm.urdf', 'tool', 'forearm', 1.6, base='underwater',
                      acceleration=1.0),
    'two arms': Arm('two_arms.urdf', 'left_hand', 'left_forearm', 1.9),
    'hyq leg': Arm('robots/hyq_no_sensors.urdf', 'lf_foot', 'lf_lowerleg', 1.2, ('lf_',),
                   acceleration=50.0),
    'go1 leg': Arm('urdf/go1.urdf', 'FL_foot', 'FL_calf', 0.8, ('FL_',), acceleration=100.0),
    'jaco': Arm('robots/kinova.urdf', 'j2s6s200_end_effector', 'j2s6s200_link_3', 1.8,
                ('j2s6s200',), acceleration=5.0),
}


@lru_cache(maxsize=None)
def _path(source: str) -> Path:
    """Return the path of the description of a robot."""
    if source.endswith('.yaml') or '/' not in source and source.endswith('.urdf'):
        return CONFIG / 'robots' / source
    if source in URDFS:
        return urdf_path(source)
    return next(Path(file.locate()).resolve() for file in files('example-robot-data')
                if str(file).endswith(source))


@lru_cache(maxsize=None)
def _plain(name: str) -> Robot:
    """Return a robot with the limits of its description."""
    arm = ARMS[name]
    robot = Robot.from_file(_path(arm.source))
    joints = [joint for joint in robot.joint_names if joint.startswith(arm.prefix)]
    return Robot.from_file(_path(arm.source), joints=joints if arm.prefix else None,
                           base=arm.base)


def robot_of(name: str, limits: Mapping[str, Mapping[str, float]] | None = None) -> Robot:
    """Return a robot with acceleration limits, and limits in place of its own ('*': of all)."""
    arm, plain = ARMS[name], _plain(name)
    limits = limits or {}
    given = {each: {**({} if math.isfinite(own) else {'acceleration': arm.acceleration}),
                    **limits.get('*', {}), **limits.get(each, {})}
             for each, own in zip(plain.velocity_names, plain.acceleration)}
    joints = list(plain.joint_names) if arm.prefix else None
    return Robot.from_file(_path(arm.source), joints=joints, base=arm.base, limits=given)


# Cases -----------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Case:
    """
    A robot and a stack.

    Attributes
    ----------
    name : str
    robot : str
        Key of `ARMS`; empty: of the parameter files.
    stack : str
        YAML; with parameter files a file, or empty for theirs.
    settings : dict
        Fields of `Settings`, `rate` [Hz], `limits` of the robot, `goals` of the stack
        {task: goal}, parameter `files` (paths, or text), and options of a check (`samples`,
        `runs`, `seconds`).

    """

    name: str
    robot: str
    stack: str
    settings: Mapping[str, Any] = field(default_factory=dict)

    def check(self, seed: int = 0, **options: Any) -> CheckReport:
        """Return the report of a check, as the command line does."""
        options = {**FEW, **{key: self.settings[key] for key in FEW if key in self.settings},
                   **options}
        if 'files' in self.settings:
            with TemporaryDirectory() as folder:
                node = read(list(_files(self.settings['files'], folder)), self.stack, '', '',
                            self.settings.get('rate'))
            report = check(node.robot, node.stack, node.settings, period=node.period,
                           around=node.around, seed=seed, **options)
            return report.adding(about_parameters(node.ignored))
        robot = robot_of(self.robot, self.settings.get('limits'))
        stack = Stack.from_yaml(self.stack, robot)
        for name, goal in self.settings.get('goals', {}).items():
            task = stack.tasks[name]
            task.set_goal(task.parse_goal(goal), 0.0)
        given = {key: value for key, value in self.settings.items() if key in SETTING_NAMES}
        settings = Settings(period=1.0 / self.settings.get('rate', 100.0), **given)
        return check(robot, stack, settings, seed=seed, **options)


def _files(given: Sequence[str | Path], folder: str) -> Iterator[Path]:
    """Yield parameter files; a text is written to a folder."""
    for number, file in enumerate(given):
        if isinstance(file, str):
            path = Path(folder) / f'{number}.yaml'
            path.write_text(file, encoding='utf-8')
            yield path
        else:
            yield file


def filled(text: str, robot: str) -> str:
    """
    Return a text with values in place of ⟨their names⟩.

    They are the fields of `Arm`; ⟨robot⟩, its name; ⟨root⟩; ⟨first⟩, ⟨second⟩, ⟨third⟩ and
    ⟨last⟩ joint; ⟨upper⟩, the limit of the last one; and ⟨far⟩, twice the reach.
    """
    if '⟨' not in text:
        return text
    arm, plain = ARMS[robot], _plain(robot)
    joints = plain.joint_names
    values = {**arm._asdict(), 'robot': plain.name, 'root': plain.root, 'first': joints[0],
              'second': joints[1], 'third': joints[2], 'last': joints[-1],
              'upper': float(plain.upper[-1]), 'far': 2.0 * arm.reach}
    for name, value in values.items():
        text = text.replace(f'⟨{name}⟩', str(value))
    return text


def lines(robot: str, *entries: str) -> str:
    """Return a stack of entries as YAML; see `filled`."""
    return filled('\n'.join(f'- {entry}' for entry in entries), robot)


# Sound stacks ----------------------------------------------------------------------------

LIMITS = 'joints: {type: joint_limits, margin: 0.05}'
POSE = 'tool: {type: pose, frame: ⟨tool⟩, gain: 2.0}'
POSITION = 'tool: {type: position, frame: ⟨tool⟩, gain: 2.0}'
POSTURE = 'posture: {type: posture, gain: 1.0}'


def shipped(stack: str = '', *names: str, **settings: Any) -> Case:
    """Return a case of parameter files and a stack of config/."""
    return Case(' '.join(filter(None, [stack, *names])), '',
                f'{CONFIG}/{stack}.yaml' if stack else '',
                {'files': tuple(CONFIG / f'{name}.yaml' for name in names), **settings})


def of_config(stack: str, robot: str, **settings: Any) -> Case:
    """Return a case of a stack of config/ on one of `ARMS`."""
    return Case(stack, robot, (CONFIG / f'{stack}.yaml').read_text(encoding='utf-8'), settings)


def sound(robot: str, *entries: str, **settings: Any) -> Case:
    """Return a sound case of some tasks on one of `ARMS`."""
    types = ', '.join(re.findall(r'type: (\w+)', ' '.join(entries)))
    return Case(f'{robot}: {types}', robot, lines(robot, *entries), settings)


def using(entry: str, keys: str) -> str:
    """Return an entry with more keys."""
    return entry.replace('}', f', {keys}}}')


SOUND = [
    # All of config/, with their parameter files.
    shipped('', 'demo'),
    shipped('', 'conflict', seconds=30.0),
    shipped('', 'bounds'),
    shipped('', 'camera'),
    shipped('', 'mobile'),
    shipped('', 'underwater'),
    shipped('', 'two_arms'),
    *(shipped('', f'robots/{name}_parameters') for name in ('ur5e', 'fr3', 'gen3', 'xarm7')),
    *(shipped('', f'robots/{name}_parameters', f'robots/{name}_first', seconds=60.0, runs=3)
      for name in ('ur5e', 'fr3', 'gen3', 'xarm7')),
    *(shipped(f'robots/{name}_home', f'robots/{name}_parameters', seconds=20.0)
      for name in ('ur5e', 'fr3', 'gen3', 'xarm7')),
    *(of_config(name, 'planar', rate=60.0)
      for name in ('lab1', 'lab2_joint_first', 'lab2_end_effector_first')),
    of_config('drill_stack', 'panda', rate=100.0, runs=2, seconds=10.0),
    of_config('failed_joint_stack', 'panda', rate=100.0, runs=2, seconds=10.0),
    # A pose of the tool, and what is left for a posture.
    sound('panda urdf', LIMITS, POSE, POSTURE, rate=200.0),
    sound('xarm7', LIMITS, POSE, POSTURE),
    sound('talos arm', POSE.replace('}', ', axes: [x, y, z, rx]}'), POSTURE, rate=200.0),
    sound('baxter', LIMITS, POSE, POSTURE),
    sound('talos', LIMITS, POSE, POSTURE),
    sound('tiago', LIMITS, POSE, POSTURE, rate=50.0, seconds=25.0),
    sound('rover', LIMITS, POSE, POSTURE, seconds=25.0),
    sound('moving panda', POSE, POSTURE),
    sound('mobile', LIMITS, POSE, POSTURE, seconds=25.0),
    # Arms of six joints: a posture acts near singularities only.
    sound('ur5', LIMITS, POSE, POSTURE, rate=125.0),
    sound('ur10', LIMITS, POSE, rate=125.0),
    sound('z1', LIMITS, POSE, POSTURE, rate=250.0),
    sound('jaco', POSE, rate=100.0, seconds=25.0),
    # A point, and a posture.
    sound('planar', POSITION.replace('}', ', axes: xy}'), POSTURE),
    sound('ur5', POSITION, POSTURE, rate=125.0),
    sound('so100', LIMITS, POSITION, POSTURE, rate=50.0),
    sound('talos arm', LIMITS, POSITION, POSTURE),
    sound('z1', LIMITS, POSITION, POSTURE),
    sound('panda', POSITION, POSTURE, rate=50.0),
    sound('fr3', LIMITS, POSITION, POSTURE, rate=500.0, seconds=20.0),
    sound('underwater', POSITION, POSTURE, rate=50.0, seconds=25.0),
    sound('flying panda', POSITION, POSTURE, rate=50.0),
    # A foot.
    sound('hyq leg', LIMITS, POSITION.replace('2.0', '8.0'), rate=250.0, seconds=5.0),
    sound('go1 leg', LIMITS, POSITION.replace('2.0', '10.0'), rate=500.0, seconds=5.0),
    # An orientation.
    sound('gen3', 'turn: {type: orientation, frame: ⟨tool⟩, gain: 1.0}', POSTURE),
    sound('ur10', 'tool: {type: position, frame: ⟨tool⟩, gain: 3.0}',
          'turn: {type: orientation, frame: ⟨tool⟩, gain: 1.5}'),
    sound('xarm7 dh', LIMITS, 'tool: {type: position, frame: ⟨tool⟩, gain: 4.0}',
          'turn: {type: orientation, frame: ⟨tool⟩, gain: 2.0}', POSTURE),
    # Five rows: the tool turns freely about its axis.
    sound('panda urdf', LIMITS,
          '[tip: {type: position, frame: ⟨tool⟩, gain: 2.0}, '
          'drill: {type: pointing, frame: ⟨tool⟩, axis: z, gain: 2.0}]', POSTURE),
    sound('ur5e', '[tip: {type: position, frame: ⟨tool⟩, gain: 3.0}, '
          'weld: {type: pointing, frame: ⟨tool⟩, axis: z, gain: 3.0}]', POSTURE, rate=200.0),
    sound('z1', LIMITS, '[tip: {type: position, frame: ⟨tool⟩, gain: 2.0}, '
          'point: {type: pointing, frame: ⟨tool⟩, axis: x, gain: 2.0}]'),
    # The whole body.
    sound('talos', LIMITS, POSE,
          'other: {type: position, frame: gripper_right_base_link, gain: 2.0}', POSTURE),
    sound('baxter', LIMITS, '[left: {type: pose, frame: left_gripper, gain: 2.0}, '
          'right: {type: pose, frame: right_gripper, gain: 2.0}]', POSTURE, rate=200.0),
    sound('two arms', LIMITS,
          'grip: {type: relative_pose, frame: right_hand, reference: left_hand, gain: 4.0}',
          'carry: {type: position, frame: left_hand, gain: 2.0}', POSTURE, seconds=20.0),
    sound('two arms', LIMITS, 'carry: {type: position, frame: left_hand, gain: 2.0}',
          'watch: {type: look_at, frame: camera, axis: x, target: left_hand, gain: 3.0}',
          POSTURE),
    sound('two arms', 'balance: {type: center_of_mass, axes: xy, gain: 2.0}',
          'left: {type: position, frame: left_hand, gain: 2.0}', POSTURE),
    # Bases.
    sound('mobile', POSITION, 'heading: {type: base_orientation, gain: 1.0}', POSTURE,
          seconds=25.0),
    sound('rover', POSITION, 'park: {type: base_pose, gain: 0.8}', POSTURE, seconds=25.0),
    sound('moving panda', POSITION, 'park: {type: base_pose, axes: xy, gain: 0.5}', POSTURE,
          seconds=25.0),
    sound('underwater', LIMITS, POSITION.replace('2.0', '1.5'),
          'heading: {type: base_orientation, gain: 0.7}', POSTURE, seconds=25.0),
    sound('underwater', 'station: {type: base_pose, gain: 1.0}',
          POSITION.replace('}', ', axes: xz}'), seconds=25.0),
    # Bounds on top.
    sound('panda', 'slow: {type: speed_limit, frame: ⟨tool⟩, linear: 0.25, angular: 1.0}',
          LIMITS, POSE, POSTURE, rate=200.0),
    sound('ur5e', 'slow: {type: speed_limit, frame: ⟨tool⟩, linear: 0.25}', LIMITS, POSITION,
          POSTURE, rate=125.0, seconds=20.0),
    sound('mobile', 'slow: {type: speed_limit, frame: ⟨tool⟩, linear: 0.5}', POSITION, POSTURE,
          seconds=25.0),
    sound('xarm7', 'table: {type: keep_out, frame: ⟨tool⟩, radius: 0.05, shape: half_space}',
          LIMITS, POSITION, POSTURE),
    sound('ur10', '[table: {type: keep_out, frame: ⟨tool⟩, radius: 0.05, shape: half_space}, '
          'elbow: {type: keep_out, frame: ⟨elbow⟩, radius: 0.1, shape: half_space}]',
          POSITION, POSTURE, rate=125.0),
    sound('panda', 'pillar: {type: keep_out, frame: ⟨tool⟩, radius: 0.05, '
          'shape: {cylinder: [0.1, 1.2]}, at: [0.5, -0.3, 0.6]}', LIMITS, POSE, POSTURE),
    sound('fr3', 'cell: {type: keep_in, frame: ⟨tool⟩, shape: {box: [1.2, 1.4, 1.0]}, '
          'at: [0.3, 0.0, 0.6]}', LIMITS, POSITION, POSTURE, seconds=20.0),
    sound('gen3', 'cell: {type: keep_in, frame: ⟨tool⟩, shape: {sphere: 0.85}, '
          'at: [0.0, 0.0, 0.3]}', POSITION, POSTURE, rate=50.0, seconds=20.0),
    sound('planar', 'wall: {type: keep_in, frame: link3, shape: {box: [3.0, 3.0, 1.0]}}',
          POSITION.replace('}', ', axes: xy}'), POSTURE, rate=50.0),
    sound('panda', 'apart: {type: self_collision, '
          'capsules: package://tp_controller/config/panda_capsules.yaml, '
          'ignore: [[panda_link4, panda_link6]]}', LIMITS, POSE, POSTURE, runs=4),
    sound('two arms', 'apart: {type: self_collision, distance: 0.03, gain: 4.0}', LIMITS,
          '[left: {type: position, frame: left_hand, gain: 2.0}, '
          'right: {type: position, frame: right_hand, gain: 2.0}]', POSTURE, runs=3),
    sound('mobile', 'clear: {type: obstacles, distance: 0.05, obstacles: {'
          'pole: {shape: {cylinder: [0.1, 1.5]}, at: [1.2, 0.4, 0.75]}}}', POSITION, POSTURE,
          seconds=25.0, runs=4),
    sound('panda', 'clear: {type: obstacles, '
          'capsules: package://tp_controller/config/panda_capsules.yaml, '
          'links: [panda_link4, panda_link5, panda_link6, panda_link7, panda_hand], '
          'obstacles: {floor: {shape: half_space}}}', LIMITS, POSE, POSTURE, runs=4),
    sound('panda', 'view: {type: field_of_view, frame: panda_link7, half_angle: 0.5, '
          'target: [0.6, 0.0, 0.0]}', LIMITS, POSITION, POSTURE),
    sound('two arms', 'view: {type: field_of_view, frame: camera, axis: x, half_angle: 0.4, '
          'target: left_hand}', LIMITS, 'left: {type: position, frame: left_hand, gain: 2.0}',
          POSTURE),
    sound('panda', 'upright: {type: tilt, frame: ⟨tool⟩, axis: -z, within: 0.8}', LIMITS, POSITION,
          POSTURE),
    sound('two arms', 'span: {type: distance, frame: left_hand, reference: right_hand, '
          'maximum: 1.5}', LIMITS, 'left: {type: position, frame: left_hand, gain: 2.0}', POSTURE),
    sound('panda', 'range: {type: orientation_range, frame: ⟨tool⟩, target: [1, 0, 0, 0], '
          'maximum: [0.8, 0.8, 3.0]}', LIMITS, POSITION, POSTURE),
    sound('panda urdf', 'balance: {type: com_polygon, contacts: {⟨root⟩: [[0.2, 0.2, 0], '
          '[-0.2, 0.2, 0], [-0.2, -0.2, 0], [0.2, -0.2, 0]]}}', LIMITS, POSITION, POSTURE),
    sound('panda', 'agile: {type: manipulability_above, frame: ⟨tool⟩, minimum: 0.03}', LIMITS,
          POSE, POSTURE),
    sound('ur5', 'agile: {type: manipulability_above, frame: ⟨tool⟩, axes: xyz, minimum: 0.02}',
          POSITION, POSTURE, rate=125.0),
    # Objectives, weights, settings.
    sound('xarm7', LIMITS, POSE, 'agile: {type: manipulability, frame: ⟨tool⟩, gain: 0.5}'),
    sound('panda', POSE, 'relax: {type: joint_limit_distance, gain: 0.5}', rate=200.0),
    sound('rover', POSITION, POSTURE, seconds=25.0,
          weights=(20.0, 20.0, 20.0, 5.0, *[1.0] * 7)),
    sound('panda', LIMITS, POSITION, POSTURE, weights=(1.0, 1.0, 1.0, 1.0, 5.0, 5.0, 5.0)),
    sound('fr3', POSE.replace('}', ', mode: scale}'), POSTURE, seconds=20.0),
    sound('xarm7', 'tool: {type: pose, frame: ⟨tool⟩, gain: [3, 3, 3, 1.5, 1.5, 1.5]}', POSTURE,
          scaling='uniform'),
    # Some joints only, and weights of rows.
    sound('panda', using(POSE, 'excluded_joints: panda_joint1'), POSTURE),
    sound('panda', using(POSITION, 'excluded_joints: panda_joint1'),
          'turn: {type: joint, joints: panda_joint1, gain: 1.0}', POSTURE),
    sound('baxter', *(f'{side}: {{type: pose, frame: {side}_gripper, gain: 2.0, joints: '
                      f'[{side}_s0, {side}_s1, {side}_e0, {side}_e1, {side}_w0, {side}_w1, '
                      f'{side}_w2]}}' for side in ('left', 'right')), POSTURE, rate=200.0),
    sound('gen3', using(POSITION, 'joints: [joint_1, joint_2, joint_4, joint_6]'), POSTURE,
          seconds=20.0),
    sound('rover', LIMITS, using(POSITION, 'excluded_joints: base'),
          using(POSTURE, 'excluded_joints: base'), seconds=25.0),
    sound('mobile', LIMITS, using(POSITION, 'excluded_joints: base'), seconds=25.0),
    sound('talos', using(POSE, 'excluded_joints: [torso_1_joint, torso_2_joint]'), POSTURE),
    sound('panda', 'cell: {type: keep_in, frame: ⟨tool⟩, shape: {box: [1.2, 1.4, 1.0]}, '
          'at: [0.3, 0.0, 0.6], joints: [panda_joint2, panda_joint4]}', POSITION, POSTURE),
    sound('ur5e', using(POSE, 'weights: {m: 100.0}'), using(POSTURE, 'weights: {⟨first⟩: 10.0}'),
          rate=125.0),
    sound('fr3', '[tool: {type: position, frame: ⟨tool⟩, gain: 2.0, weights: 10.0}, '
          'turn: {type: orientation, frame: ⟨tool⟩, gain: 2.0}]', POSTURE, seconds=20.0),
    # Joints alone.
    sound('ur5e', 'home: {type: posture, gain: 1.0, target: [0.0, -1.57, 1.57, -1.57, -1.57, '
          '0.0]}', rate=125.0, seconds=20.0),
    sound('talos', 'head: {type: joint, joints: torso_1_joint, gain: 2.0}', POSITION, POSTURE),
    sound('gen3', 'last: {type: joint, joints: joint_7, target: [0.5], gain: 1.0}', POSITION,
          POSTURE, seconds=20.0),
]


# Mistakes --------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Fault(Case):
    """
    A case with a mistake.

    Attributes
    ----------
    kinds : tuple of str
        Kinds of findings that name it, wrong or doubtful.
    advice : str
        Regular expression that message and change of the finding match, in any case.
    where : str
        Regular expression that its location matches, or its message if it has no location.

    """

    kinds: tuple[str, ...] = ()
    advice: str = ''
    where: str = ''


def mistake(name: str, robots: Sequence[str], entries: Sequence[str], kinds: str, advice: str,
            where: str, **settings: Any) -> list[Fault]:
    """
    Return a mistake on some robots.

    Entries and `where` may name the fields of `Arm` and others, as in `filled`; a setting may be a
    function of the name of the robot. Kinds are separated by commas.
    """
    return [Fault(f'{name}: {robot}', robot, lines(robot, *entries),
                  {key: value(robot) if callable(value) else value
                   for key, value in settings.items()},
                  tuple(kinds.split(', ')), filled(advice, robot), filled(where, robot))
            for robot in robots]


def joint_limits_of(number: int, **limit: float) -> Callable[[str], dict]:
    """Return a function from a robot to limits of one of its joints, counted from 0."""
    return lambda robot: {_plain(robot).joint_names[number]: limit}


def all_weights(heavy: float, number: int) -> Callable[[str], tuple[float, ...]]:
    """Return a function from a robot to weights of 1, but for one velocity, counted from 0."""
    return lambda robot: tuple(heavy if row == number else 1.0
                               for row in range(_plain(robot).n))


def with_typo(name: str) -> Fault:
    """Return a case of a parameter file whose gain is misspelled."""
    text = '/**/tp_controller: {ros__parameters: {tasks: {tool: {gian: 3.0}}}}\n'
    return Fault(f'a parameter with a typing error: {name}', '', '', {
        'files': (CONFIG / 'robots' / f'{name}_parameters.yaml', text), 'runs': 0},
        ('parameter',), 'correct its name|did you mean', r'tasks\.tool\.gian')


def of_gain(entry: str, gain: float) -> str:
    """Return an entry with another gain."""
    return entry.replace('gain: 2.0', f'gain: {gain}')


APART = {
    'panda': 'apart: {type: self_collision, '
             'capsules: package://tp_controller/config/panda_capsules.yaml}',
    'two arms': 'apart: {type: self_collision}',
    'mobile': 'apart: {type: self_collision}',
}
STILL = {'runs': 0}
BRIEF = {'runs': 2, 'seconds': 1.0}
PLANE = POSITION.replace('}', ', axes: xy}')

FAULTS = [
    # Gains.
    *mistake('gain of 0.6 per period', ('panda', 'ur5', 'hyq leg'), [of_gain(POSITION, 60.0)],
             'gain', r'at most 25/s|raise the rate', 'tool', **STILL),
    *mistake('gain of 1.2 per period', ('planar', 'xarm7', 'tiago'), [of_gain(PLANE, 60.0)],
             'gain', r'overshoots.*(at most|raise the rate)', 'tool', rate=50.0, **STILL),
    *mistake('gain that grows the error', ('panda', 'z1', 'mobile'), [of_gain(POSITION, 250.0)],
             'fault', r'at most 2/period', 'tool', **STILL),
    *mistake('gain 300 at 1 kHz', ('panda', 'fr3', 'ur5e'), [of_gain(POSITION, 300.0), POSTURE],
             'gain', r'gain.*(lower|at most)|lower.*gain', 'tool', rate=1000.0, **BRIEF),
    *mistake('gain of bounds above the rate', ('panda', 'ur5', 'go1 leg'),
             [LIMITS.replace('}', ', gain: 150.0}'), POSITION], 'fault', '1/period', 'joints',
             **STILL),
    *mistake('gain 0.1', ('panda', 'ur10', 'baxter'), [of_gain(POSITION, 0.1), POSTURE],
             'slow, never reached, seldom reached', r'raise (its|the) gain', 'tool'),
    *mistake('gain 0.1 on the second level', ('panda', 'gen3', 'rover'),
             [POSITION, 'turn: {type: orientation, frame: ⟨tool⟩, gain: 0.1}'],
             'slow, never reached, seldom reached', r'raise (its|the) gain', 'turn'),
    # Priorities.
    *mistake('posture above the tool', ('panda', 'xarm7', 'tiago'), [POSTURE, POSITION],
             'never acts', 'put it above', 'tool', **STILL),
    *mistake('joint velocities above the tool', ('panda', 'ur5e', 'so100'),
             ['move: {type: joint_velocity}', POSITION], 'never acts', 'put it above', 'tool',
             **STILL),
    *mistake('an objective above the tool', ('panda', 'xarm7', 'fr3'),
             ['agile: {type: manipulability, frame: ⟨tool⟩}', POSITION], 'never acts',
             'put it above', 'tool', **STILL),
    *mistake('an elbow below a pose of six joints', ('ur5', 'z1', 'jaco'),
             [POSE, 'elbow: {type: position, frame: ⟨elbow⟩, gain: 2.0}'], 'never acts',
             'put it above|leave out', 'elbow', **STILL),
    *mistake('an elbow below a pose of seven joints', ('panda', 'xarm7', 'gen3'),
             [POSE, 'elbow: {type: position, frame: ⟨elbow⟩, gain: 2.0}'],
             'acts in part, seldom acts, fight', 'leave out', 'elbow', **STILL),
    *mistake('one frame on two levels', ('panda', 'ur5', 'mobile'),
             [POSITION, 'twin: {type: position, frame: ⟨tool⟩, gain: 2.0}'],
             'fight, never acts, contradiction', 'leave out|agree', 'twin', **STILL),
    *mistake('one frame twice on a level', ('baxter', 'tiago', 'planar'),
             ['[tool: {type: position, frame: ⟨tool⟩, axes: xy, gain: 2.0}, '
              'twin: {type: position, frame: ⟨tool⟩, axes: xy, gain: 2.0}]'],
             'fight, contradiction', 'leave out|agree', 'twin', **STILL),
    *mistake('a joint of the tool on the level above', ('planar', 'so100', 'hyq leg'),
             ['some: {type: joint, joints: [⟨first⟩, ⟨third⟩], gain: 2.0}', PLANE],
             'acts in part, fight', 'leave out', 'tool', **STILL),
    *mistake('bounds below a tool that takes all joints', ('ur5', 'z1', 'jaco'),
             [POSE, 'table: {type: keep_out, frame: ⟨elbow⟩, radius: 0.1, shape: half_space}'],
             'never acts', 'put it (higher|above)', 'table'),
    # Frames and axes.
    *mistake('axes that the robot does not have', ('planar', 'so100', 'hyq leg'), [POSE],
             'impossible', 'leave out', 'tool', **STILL),
    *mistake('a frame that no joint moves', ('panda', 'ur5', 'gen3'),
             ['tool: {type: position, frame: ⟨root⟩, gain: 2.0}'], 'never acts, impossible',
             'another frame', 'tool', **STILL),
    *(fault for robot, entry, knee in (('planar', PLANE, ('joint2', 'joint3')),
                                       ('hyq leg', POSITION, ('lf_kfe_joint',)),
                                       ('go1 leg', POSITION, ('FL_calf_joint',)))
      for fault in mistake('a straight limb', (robot,), [entry], 'singular', 'limits|posture',
                           'tool', limits=dict.fromkeys(knee, {'lower': -0.01, 'upper': 0.01}),
                           **STILL)),
    *mistake('a wrist without range', ('ur5', 'ur10', 'ur5e'), [POSE], 'singular',
             'limits|posture|manipulability', 'tool',
             limits={'wrist_2_joint': {'lower': -0.02, 'upper': 0.02}}, **STILL),
    # Bounds that cannot be met, or that always act.
    *mistake('a region out of reach', ('panda', 'ur5', 'baxter'),
             ['cell: {type: keep_in, frame: ⟨tool⟩, shape: {sphere: 0.2}, at: [⟨far⟩, 0.0, 0.3]}',
              POSITION], 'bounds, out of reach', 'widen|move|reach', 'cell', runs=2, seconds=5.0),
    *mistake('a place in millimetres', ('xarm7', 'fr3', 'planar'),
             ['cell: {type: keep_in, frame: ⟨tool⟩, shape: {sphere: 0.5}, '
              'at: [400.0, 0.0, 300.0]}', PLANE], 'units, bounds, out of reach',
             'widen|move|reach|metres|mm', 'cell', runs=2, seconds=5.0),
    *mistake('an obstacle around the robot', ('xarm7', 'ur5', 'planar'),
             ['wall: {type: keep_out, frame: ⟨tool⟩, shape: {sphere: 3.0}}', PLANE],
             'bounds, out of reach', 'widen|smaller|reach', 'wall', runs=2, seconds=5.0),
    *mistake('more manipulability than there is', ('panda', 'ur5', 'xarm7'),
             ['agile: {type: manipulability_above, frame: ⟨tool⟩, minimum: 1.0}', POSITION],
             'bounds, out of reach', 'widen|lower', 'agile', runs=2, seconds=5.0),
    *mistake('a region of a centimetre', ('planar', 'panda', 'ur5'),
             ['cell: {type: keep_in, frame: ⟨tool⟩, shape: {sphere: 0.01}, at: [0.4, 0.3, 0.0]}',
              PLANE], 'bounds dominate', 'widen', 'cell', runs=2, seconds=5.0),
    *mistake('a view of a degree', ('panda', 'xarm7', 'two arms'),
             ['view: {type: field_of_view, frame: ⟨tool⟩, half_angle: 0.02, '
              'target: [0.6, 0.1, 0.4]}', POSITION],
             'bounds dominate, bounds', 'widen', 'view', runs=4),
    *mistake('a tilt of a degree', ('panda', 'xarm7', 'ur5'),
             ['upright: {type: tilt, frame: ⟨tool⟩, axis: -z, within: 0.02}', POSITION],
             'bounds dominate, bounds', 'widen', 'upright', runs=4),
    *mistake('a distance in millimetres', ('panda', 'ur5', 'xarm7'),
             ['far: {type: distance, frame: ⟨tool⟩, minimum: 400.0}', POSITION],
             'units, bounds, out of reach', 'widen|move|reach|metres|mm|lower', 'far', runs=2,
             seconds=5.0),
    *mistake('a range of half a degree', ('panda', 'ur5', 'xarm7'),
             ['range: {type: orientation_range, frame: ⟨tool⟩, target: [1, 0, 0, 0], '
              'maximum: 0.01}', POSITION], 'bounds dominate, bounds', 'widen', 'range', runs=4),
    *mistake('a support polygon beside the robot', ('panda urdf', 'ur5', 'xarm7'),
             ['balance: {type: com_polygon, contacts: {⟨root⟩: '
              '[[2, 2, 0], [3, 2, 0], [2, 3, 0]]}}', POSITION],
             'bounds, out of reach', 'widen|move|reach', 'balance', runs=2, seconds=5.0),
    *mistake('a speed limit of 1 mm/s', ('panda', 'ur5e', 'xarm7'),
             ['slow: {type: speed_limit, frame: ⟨tool⟩, linear: 0.001}', POSITION],
             'bounds dominate, slow, never reached, seldom reached, units',
             'widen|raise|slow|speed', 'slow|tool'),
    # Bounds that never act.
    *mistake('a speed limit in mm/s', ('panda', 'ur5e', 'mobile'),
             ['slow: {type: speed_limit, frame: ⟨tool⟩, linear: 250.0}', POSITION, POSTURE],
             'never active, units', r'never|m/s|leave it out|narrow|lower|tighter', 'slow'),
    *mistake('an obstacle 600 m away', ('panda', 'xarm7', 'ur10'),
             ['pillar: {type: keep_out, frame: ⟨tool⟩, shape: {cylinder: [0.1, 1.0]}, '
              'at: [600.0, 0.0, 0.5]}', POSITION, POSTURE], 'never active, units',
             r'never|metres|leave it out|place|nearer', 'pillar'),
    *mistake('a cell in millimetres', ('fr3', 'ur5', 'planar'),
             ['cell: {type: keep_in, frame: ⟨tool⟩, shape: {box: [1600, 1600, 1600]}}',
              PLANE, POSTURE], 'never active, units',
             r'never|metres|leave it out|narrow|smaller', 'cell'),
    *mistake('position limits far outside', ('planar', 'xarm7', 'gen3'), [LIMITS, PLANE],
             'never active, remark, units', 'limit', 'joints|⟨first⟩|⟨robot⟩',
             limits={'*': {'lower': -1e16, 'upper': 1e16}}),
    # Units of limits and goals.
    *mistake('position limits in degrees', ('panda', 'ur5', 'xarm7'), [POSITION, POSTURE],
             'remark, units', 'degrees', '⟨first⟩|⟨robot⟩',
             limits=joint_limits_of(0, lower=-170.0, upper=170.0), **STILL),
    *mistake('velocity limits in degrees per second', ('panda', 'ur5', 'gen3'),
             [POSITION, POSTURE], 'units, remark', r'degrees|rad/s', '⟨first⟩|⟨third⟩',
             limits={'*': {'velocity': 120.0}}, **BRIEF),
    *mistake('a joint goal in degrees', ('planar', 'gen3', 'underwater'),
             ['turn: {type: joint, joints: ⟨last⟩, target: [90.0], gain: 1.0}'],
             'units, remark', 'degrees|rad', 'turn', runs=2),
    *mistake('a goal in millimetres', ('panda', 'ur5', 'planar'), [PLANE],
             'units, out of reach', 'reach|metres|mm', 'tool', goals={'tool': [400.0, 100.0, 0.0]},
             runs=3),
    *mistake('a goal at twice the reach', ('xarm7', 'fr3', 'baxter'), [POSITION, POSTURE],
             'out of reach, never reached', 'reach', 'tool',
             goals=lambda robot: {'tool': [2.0 * ARMS[robot].reach, 0.0, 0.3]}, runs=3),
    *mistake('a goal inside of the margin', ('panda', 'fr3', 'ur5e'),
             ['joints: {type: joint_limits, margin: 0.2}',
              'last: {type: joint, joints: ⟨last⟩, target: [⟨upper⟩], gain: 2.0}', POSITION],
             'out of reach, contradiction, never reached, bounds', 'goal|target|margin|reach',
             'last', runs=5),
    *mistake('a tolerance in millimetres', ('panda', 'ur5e', 'fr3'),
             [POSITION.replace('}', ', tolerance: 5.0}'), POSTURE], 'units, tolerance',
             'tolerance|metres', 'tool'),
    *mistake('a tolerance below rounding', ('planar', 'panda', 'ur5'),
             [PLANE.replace('}', ', tolerance: 1.0e-17}')], 'never reached, tolerance',
             'tolerance', 'tool'),
    # Contradictions.
    *mistake('keep in and keep out of one box', ('panda', 'ur5', 'xarm7'),
             ['cell: {type: keep_in, frame: ⟨tool⟩, shape: {box: [0.4, 0.6, 0.4]}, '
              'at: [0.4, 0.0, 0.4]}',
              'wall: {type: keep_out, frame: ⟨tool⟩, radius: 0.03, shape: {box: [0.4, 0.6, 0.4]}, '
              'at: [0.4, 0.0, 0.4]}', POSITION], 'contradiction', 'cell.*wall|wall.*cell',
             'cell|wall', runs=2, seconds=5.0),
    *mistake('two regions without a common point', ('baxter', 'planar', 'ur10'),
             ['[left: {type: keep_in, frame: ⟨tool⟩, shape: {sphere: 0.2}, at: [0.4, 0.4, 0.0]}, '
              'right: {type: keep_in, frame: ⟨tool⟩, shape: {sphere: 0.2}, '
              'at: [0.4, -0.4, 0.0]}]', PLANE], 'contradiction', 'left.*right|right.*left',
             'left|right', runs=2, seconds=5.0),
    *mistake('a cell below the table', ('panda', 'gen3', 'jaco'),
             ['[table: {type: keep_out, frame: ⟨tool⟩, radius: 0.05, shape: half_space}, '
              'cell: {type: keep_in, frame: ⟨tool⟩, shape: {box: [1.0, 1.0, 0.2]}, '
              'at: [0.4, 0.0, -0.2]}]', POSITION], 'contradiction', 'table.*cell|cell.*table',
             'table|cell', runs=2, seconds=5.0),
    # Collisions that nothing watches.
    *(fault for robot, links in (('two arms', 'torso, left_forearm'),
                                 ('mobile', 'base_link, forearm'),
                                 ('panda', 'panda_link0, panda_link5'))
      for fault in mistake(
          'links that are left out', (robot,),
          [APART[robot].replace('}', f', links: [{links}]}}'), POSITION, POSTURE], 'unwatched',
          'links|watch', 'apart', runs=2, seconds=5.0)),
    # Limits, weights and settings.
    *mistake('a velocity limit of zero', ('panda', 'ur5', 'tiago'), [POSITION], 'velocity limit',
             'raise it|leave the joint out', '⟨third⟩', limits=joint_limits_of(2, velocity=0.0),
             **STILL),
    *mistake('no velocity limit', ('planar', 'panda', 'xarm7'), [PLANE], 'velocity limit',
             'give it, with|velocity: 0.5', '⟨third⟩',
             limits=joint_limits_of(2, velocity=math.inf), **STILL),
    *mistake('no acceleration limits', ('panda', 'xarm7', 'z1'),
             [LIMITS, of_gain(POSE, 8.0)], 'jump', 'acceleration limit', '.',
             limits={'*': {'acceleration': math.inf}}, rate=50.0),
    *mistake('an acceleration limit of 0.002 rad/s²', ('panda', 'ur5', 'xarm7'),
             [POSITION, POSTURE], 'slow, never reached, seldom reached, acceleration',
             'acceleration', 'tool|joint', limits={'*': {'acceleration': 0.002}}),
    *mistake('weights a million apart', ('panda', 'ur5', 'moving panda'), [POSITION, POSTURE],
             'weights', 'weight', '', weights=all_weights(1e6, 1), **BRIEF),
    *mistake('a weight of almost zero', ('xarm7', 'fr3', 'gen3'), [POSITION, POSTURE],
             'weights', 'weight', '', weights=all_weights(1e-8, 0), **BRIEF),
    # Joints of tasks, and weights of their rows.
    *mistake('a pose with three joints', ('panda', 'xarm7', 'fr3'),
             [using(POSE, 'joints: [⟨first⟩, ⟨second⟩, ⟨third⟩]'), POSTURE], 'joints',
             'use more joints.*or leave out axes', 'tool', **STILL),
    *mistake('joints beyond the frame', ('panda', 'ur5', 'gen3'),
             ['elbow: {type: position, frame: ⟨elbow⟩, gain: 1.0, joints: ⟨last⟩}', POSTURE],
             'joints', 'none of its joints.*⟨first⟩', 'elbow', **STILL),
    *mistake('a joint beyond the frame', ('panda', 'ur5', 'xarm7'),
             ['elbow: {type: position, frame: ⟨elbow⟩, axes: z, gain: 1.0, '
              'joints: [⟨first⟩, ⟨second⟩, ⟨last⟩]}', POSTURE], 'joints',
             'no effect on it: ⟨last⟩ .*leave', 'elbow', **STILL),
    *mistake('a joint that its own task excludes', ('planar', 'xarm7', 'ur5e'),
             ['turn: {type: joint, joints: ⟨first⟩, excluded_joints: ⟨first⟩}', PLANE], 'joints',
             'one or more of ⟨first⟩', 'turn', **STILL),
    *mistake('joints that a task above needs', ('panda', 'xarm7', 'gen3'),
             [POSE, 'elbow: {type: position, frame: ⟨elbow⟩, axes: z, gain: 1.0, '
              'joints: [⟨first⟩, ⟨second⟩]}', POSTURE], 'never acts', 'use more joints',
             'elbow', **STILL),
    *mistake('a goal beyond the joints', ('moving panda', 'rover', 'mobile'),
             [using(POSITION, 'excluded_joints: base')], 'never reached, out of reach',
             'all joints|more joints', 'tool',
             goals=lambda robot: {'tool': [2.0 * ARMS[robot].reach, 0.0, 0.3]}, runs=5),
    *mistake('row weights a million apart', ('panda', 'ur5e', 'fr3'),
             [using(POSE, 'weights: {m: 1.0e+6}'), POSTURE], 'weights', 'level above', 'tool',
             **STILL),
    *mistake('a weight in place of a priority', ('panda', 'ur5', 'gen3'),
             [POSITION, using(POSTURE, 'weights: 0.1')], 'weights', 'move it up', 'posture',
             **STILL),
    *mistake('a blend of 40 s', ('gen3', 'panda', 'ur5'), [POSITION, POSTURE],
             'slow, never reached, seldom reached', 'blend', 'tool|posture', blend=40.0, runs=2),
    *mistake('damping everywhere', ('panda', 'ur5', 'xarm7'), [POSITION, POSTURE],
             'singular, slow, seldom reached, never reached, damping',
             'damping|singular_region', 'tool', damping=5.0, singular_region=5.0),
    *(fault for robot, apart in APART.items()
      for fault in mistake(
          'a rate that the processor cannot keep', (robot,), [apart, POSE, POSTURE], 'cycle time',
          'lower the rate', '', rate=50000.0, runs=1, seconds=0.02, samples=5)),
    # Parameters.
    *map(with_typo, ('ur5e', 'fr3', 'gen3')),
]
