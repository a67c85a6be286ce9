# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The launch files: what they name exists, and they start what they say where launch is installed.

There is no wheel of launch, so that nothing but the lint runs without a ROS installation.
"""

import ast
import json
import math
import os
from pathlib import Path
import re
import signal
import stat
import subprocess
import sys

from monitor import promise_of
import numpy as np
from processes_harness import DEADLINE
import pytest
from robots import CONFIG, PANDA_DH, REPOSITORY
from tp_controller.tools.demos.processes import NodeProcess
from tp_controller.tools.demos.scenarios import DEMOS
import yaml

LAUNCH = REPOSITORY / 'launch'
FILES = sorted(LAUNCH.glob('*.launch.py'))
EXECUTABLES = {'controller_node', 'simulator_node', 'teleop_node', 'tp_controller'}
# Folders of the executables below the package, but for `ros`.
FOLDERS = {'teleop_node': '.tools.teleop'}
# What launch starts of other packages is only told to say how it was started.
TELL = """\
#!{python}
import json, pathlib, sys
arguments = sys.argv[1:]
files = [arguments[index + 1] for index, word in enumerate(arguments) if word == '--params-file']
print('STARTED', json.dumps([arguments, [pathlib.Path(file).read_text() for file in files]]),
      flush=True)
"""
XACRO = """\
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="name" default="joint"/> <xacro:arg name="upper" default="1.0"/>
  <link name="base"/> <link name="tip"/>
  <joint name="$(arg name)" type="revolute">
    <parent link="base"/> <child link="tip"/> <axis xyz="0 0 1"/>
    <limit lower="-1.0" upper="$(arg upper)" velocity="1.0" effort="1.0"/>
  </joint>
</robot>
"""
RUN = """\
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
file, *arguments = sys.argv[1:]
service = LaunchService()
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
    PythonLaunchDescriptionSource(file),
    launch_arguments=[text.split(':=', 1) for text in arguments])]))
sys.exit(service.run())
"""


def calls(path, *names):
    """Return (positional texts, keywords) of every call of some names in a file."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') in names:
            yield ([argument.value for argument in node.args
                    if isinstance(argument, ast.Constant)],
                   {keyword.arg: keyword.value for keyword in node.keywords})


def text(node):
    """Return a text in the code; None where it is worked out."""
    return node.value if isinstance(node, ast.Constant) else None


def arguments_of(path):
    """Return {name: keywords} of the declared arguments."""
    return {name: keywords for (name,), keywords in calls(path, 'DeclareLaunchArgument')}


# Lint -----------------------------------------------------------------------------------------


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_argument_has_a_default_and_a_description(path):
    declared = arguments_of(path)
    assert {'robot', 'stack', 'namespace', 'rviz', 'use_sim_time', 'params_file'} <= set(declared)
    for name, keywords in declared.items():
        assert {'default_value', 'description'} <= set(keywords), name


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_argument_that_is_read_is_declared(path):
    # A name in a loop is looked up by hand: it stands in a tuple of texts.
    read = {name for names, _ in calls(path, 'LaunchConfiguration') for name in names}
    loops = {element.value for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
             if isinstance(node, ast.comprehension) and isinstance(node.iter, ast.Tuple)
             for element in node.iter.elts}
    assert read and read | loops <= set(arguments_of(path))
    assert set(arguments_of(path)) - {'commands'} <= read | loops | {'use_sim_time'}


def test_servo_hands_on_only_arguments_that_the_controller_has():
    source = (LAUNCH / 'servo_compatible.launch.py').read_text(encoding='utf-8')
    handed, = (ast.literal_eval(node.iter) for node in ast.walk(ast.parse(source))
               if isinstance(node, ast.comprehension) and 'params_file' in ast.unparse(node.iter))
    assert set(handed) <= set(arguments_of(LAUNCH / 'controller.launch.py'))


def test_the_demo_hands_on_only_arguments_that_the_controller_has():
    handed = set()
    for _, keywords in calls(LAUNCH / 'demo.launch.py', 'IncludeLaunchDescription'):
        handed = {node.value for node in ast.walk(keywords['launch_arguments'])
                  if isinstance(node, ast.Constant)}
    assert handed and handed <= set(arguments_of(LAUNCH / 'controller.launch.py'))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_a_parameter_file_is_looked_for_as_every_other_file(path):
    """Of each node: what launch gets is never the text of the argument itself."""
    for _, keywords in calls(path, 'Node'):
        if text(keywords['package']) == 'tp_controller':
            assert re.search(r'find_file\(\w+\)', ast.unparse(keywords['parameters']))


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_program_exists_in_its_package(path):
    depends = (REPOSITORY / 'package.xml').read_text(encoding='utf-8')
    found = [(text(keywords['package']), text(keywords['executable']))
             for _, keywords in calls(path, 'Node')]
    found += [(text(keywords['package']), *names)
              for names, keywords in calls(path, 'ExecutableInPackage')]
    assert found
    for package, executable in found:
        if package == 'tp_controller':
            assert executable in EXECUTABLES
        else:
            # The programs of the others are called as their packages.
            assert package == executable
            # RViz alone is optional.
            assert (f'<exec_depend>{package}</exec_depend>' in depends) is (package != 'rviz2')


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_every_parameter_that_is_set_exists(path):
    controller = pytest.importorskip('tp_controller.ros.controller_node').PARAMETERS
    simulator = pytest.importorskip('tp_controller.ros.simulator_node').PARAMETERS
    teleop = pytest.importorskip('tp_controller.tools.teleop.declarations').PARAMETERS
    known = {spec.name for spec in (*controller, *simulator, *teleop)} | {'use_sim_time'}
    keys = {key.value for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
            if isinstance(node, ast.Dict) for key in node.keys if isinstance(key, ast.Constant)}
    # The others are fields of goals and options of the command line.
    assert keys - known <= {'xyz', 'rpy', 'linear', 'angular', 'fixed_frame'}


def test_rviz_shows_what_the_nodes_publish():
    config = yaml.safe_load((REPOSITORY / 'config' / 'controller.rviz').read_text())
    displays = {display['Class'].rpartition('/')[2]: display
                for display in config['Visualization Manager']['Displays']}
    assert {'RobotModel', 'TF', 'MarkerArray', 'InteractiveMarkers'} <= set(displays)
    topics = {displays['RobotModel']['Description Topic']['Value'],
              displays['MarkerArray']['Topic']['Value']}
    # Names that the launch file moves into the namespace.
    source = (LAUNCH / 'controller.launch.py').read_text(encoding='utf-8')
    assert topics == {'/robot_description', '/tp_controller/markers'}
    assert all(f"('{topic}', '{topic[1:]}')" in source for topic in topics)
    dragged = displays['InteractiveMarkers']['Interactive Markers Namespace']
    interactive = pytest.importorskip('tp_controller.ros.interface.interactive_goals')
    assert dragged == f'/tp_controller{interactive.INTERACTIVE_GOALS_TOPIC[1:]}'
    assert all(f"'{interactive.INTERACTIVE_GOALS_TOPIC[2:]}/{name}'" in source
               for name in ('update', 'feedback', 'get_interactive_markers'))
    # A latched topic is received late only by those who are latched, too.
    assert displays['RobotModel']['Description Topic']['Durability Policy'] == 'Transient Local'


# With launch ----------------------------------------------------------------------------------


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """Return a prefix with this tree as colcon would install it, and packages that only tell."""
    pytest.importorskip('launch_ros', reason='needs launch, which is on PyPI for no Python')
    prefix = tmp_path_factory.mktemp('prefix')
    programs = {(name, name): TELL.format(python=sys.executable)
                for name in ('rviz2', 'robot_state_publisher')}
    for name in EXECUTABLES:
        module = 'tp_controller' if name == 'tp_controller' \
            else f'tp_controller{FOLDERS.get(name, ".ros")}.{name}'
        programs['tp_controller', name] = f'#!/bin/sh\nexec {sys.executable} -m {module} "$@"\n'
    for (package, name), code in programs.items():
        program = prefix / 'lib' / package / name
        program.parent.mkdir(parents=True, exist_ok=True)
        program.write_text(code)
        program.chmod(program.stat().st_mode | stat.S_IXUSR)
        marker = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / package
        marker.parent.mkdir(parents=True, exist_ok=True)
        marker.touch()
    (prefix / 'share' / 'tp_controller').symlink_to(REPOSITORY)
    return prefix


@pytest.fixture
def start(workspace, domain, tmp_path):
    """Return what starts a launch file; all are ended at last."""
    running = []

    def start(name, *arguments):
        prefixes = [str(workspace), *filter(None, [os.environ.get('AMENT_PREFIX_PATH')])]
        log = tmp_path / f'launch{len(running)}.log'
        environment = {**domain, 'AMENT_PREFIX_PATH': os.pathsep.join(prefixes),
                       'ROS_LOG_DIR': str(tmp_path), 'OVERRIDE_LAUNCH_PROCESS_OUTPUT_FORMAT': ''}
        with open(log, 'w') as output:
            process = subprocess.Popen(
                [sys.executable, '-c', RUN, str(LAUNCH / name), *arguments], env=environment,
                stdout=output, stderr=subprocess.STDOUT, start_new_session=True)
        running.append(Launched(process, log))
        return running[-1]

    yield start
    for launched in running:
        launched.end()


class Launched:
    """A launch file that runs; the listener takes it for a node."""

    def __init__(self, process, log):
        self._process, self._log = process, log

    def running(self):
        """Return whether it runs."""
        return self._process.poll() is None

    def output(self):
        """Return what it has printed so far."""
        return self._log.read_text()

    def end(self):
        """Press Ctrl-C, as for a user; return the exit status."""
        if self.running():
            os.killpg(self._process.pid, signal.SIGINT)
        try:
            return self._process.wait(DEADLINE)
        except subprocess.TimeoutExpired:
            os.killpg(self._process.pid, signal.SIGKILL)
            raise

    def told(self):
        """Return {program: (arguments, texts of its parameter files)} of those that only tell."""
        lines = [line for line in self.output().splitlines() if 'STARTED ' in line]
        return {line.partition('-')[0].strip('['): json.loads(line.partition('STARTED ')[2])
                for line in lines}


def test_the_demo_reaches_its_goals_and_ends_with_ctrl_c(start, listener):
    listener.promise = promise_of(DEMOS['panda'].robot, 0.1, math.inf)
    launched = start('demo.launch.py', 'rviz:=false')
    for number, (goal,) in enumerate(DEMOS['panda'].steps):
        # Two nodes have started before.
        ended = f'[goal_{goal["task"]}-{number + 3}]: process has finished cleanly'
        listener.wait(lambda: ended in launched.output(), 'a goal', [launched])
    assert listener.client.task_names() == ['tool', 'elbow', 'posture']
    assert 'not reached' not in launched.output()
    assert launched.end() == 0
    assert 'Traceback' not in launched.output() and 'ERROR' not in launched.output()


def test_a_demo_in_a_namespace_has_its_parameters_and_shows_itself_in_rviz(start, domain):
    from processes_harness import Listener
    from tp_controller.ros.client.client import Client
    launched = start('demo.launch.py', 'demo:=two_arms', 'namespace:=left', 'goals:=false')
    waiting = Listener()
    with Client('left/tp_controller') as client:
        client.wait(client.task_names, DEADLINE)
        # That the file of parameters applies shows in the stack.
        assert client.task_names() == list(DEMOS['two_arms'].stack.tasks), launched.output()
    waiting.wait(lambda: len(launched.told()) == 2, 'the others', [launched])
    waiting.client.close()
    told = launched.told()
    rviz, _ = told['rviz2']
    assert rviz[rviz.index('-f') + 1] == DEMOS['two_arms'].robot.root
    assert Path(rviz[rviz.index('-d') + 1]).name == 'controller.rviz'
    assert '/tp_controller/markers:=tp_controller/markers' in rviz
    assert '__ns:=/left' in rviz
    _, (description, *_) = told['robot_state_publisher']
    assert '<robot' in description


def test_the_demo_runs_without_rviz(start, domain, workspace):
    from tp_controller.ros.client.client import Client
    marker = workspace / 'share' / 'ament_index' / 'resource_index' / 'packages' / 'rviz2'
    marker.unlink()
    try:
        launched = start('demo.launch.py', 'goals:=false')
        with Client('tp_controller') as client:
            client.wait(client.task_names, DEADLINE)
    finally:
        marker.touch()
    assert launched.running() and not launched.told()


def test_another_robot_stays_where_it_is(start, listener):
    launched = start('demo.launch.py', 'rviz:=false',
                     'robot:=package://tp_controller/config/robots/planar_3r.yaml')
    listener.wait(lambda: listener.commands and not listener.client.stop_reason(), 'motion',
                  [launched])
    assert listener.client.task_names() == ['posture']
    assert not listener.moving()
    assert 'goal_' not in launched.output()


def test_the_controller_takes_a_stack_as_text_and_another_topic(start, listener):
    from std_msgs.msg import Float64MultiArray
    heard = []
    listener.client.node.create_subscription(Float64MultiArray, '/arm/commands', heard.append, 10)
    launched = start('controller.launch.py', 'stack:=[home: {type: posture}]',
                     'robot:=package://tp_controller/config/robots/planar_3r.yaml',
                     'commands:=/arm/commands')
    listener.wait(lambda: heard and listener.client.task_names(), 'zeros', [launched])
    assert listener.client.task_names() == ['home']


def test_a_robot_in_xacro_has_the_arguments(start, listener, tmp_path):
    robot = tmp_path / 'arm.urdf.xacro'
    robot.write_text(XACRO)
    launched = start('demo.launch.py', f'robot:={robot}', 'rviz:=false',
                     'xacro_arguments:=name:=turn upper:=1.5', 'stack:=[home: {type: posture}]')
    listener.wait(lambda: listener.client.task_names(), 'the node', [launched])
    assert 'commands for turn' in launched.output() and 'joints turn,' in launched.output()


def test_a_scale_that_is_no_number_is_named(start, listener):
    launched = start('servo_compatible.launch.py', 'scale_linear:=fast')
    listener.wait(lambda: not launched.running(), 'the end')
    assert "scale_linear must be a number, not 'fast'" in launched.output()


def test_the_controller_alone_waits_for_a_robot(start, listener):
    launched = start('controller.launch.py')
    listener.wait(lambda: listener.client.stop_reason() == 'no robot description yet', 'the node',
                  [launched])


@pytest.mark.parametrize('commands, output', [
    ('unitless', 'velocity'), ('speed_units', 'velocity'), ('unitless', 'position'),
    ('pose', 'velocity'), ('pose', 'trajectory')])
def test_tool_moves_as_a_program_of_servo_says(start, listener, domain, tmp_path, commands,
                                               output):
    from geometry_msgs.msg import PoseStamped, TwistStamped
    from tp_controller.ros.interface.markers import to_pose
    robot = DEMOS['panda'].robot
    listener.promise = promise_of(robot, 0.1, math.inf)

    def tool():
        return robot.state(listener.states[-1][0]).position('panda_hand_tcp')

    with NodeProcess('simulator_node', ['--params-file', str(CONFIG / 'demo.yaml')], domain,
                     tmp_path / 'simulator.log') as simulator:
        node = listener.client.node
        twist = TwistStamped()
        if commands == 'pose':
            arguments, kind, topic = ['command_type:=pose'], PoseStamped, 'pose_target_cmds'
        else:
            arguments, kind, topic = [f'command_in_type:={commands}'], TwistStamped, \
                'delta_twist_cmds'
            # 0.1 m/s along y of the root, as the scale has it.
            twist.twist.linear.y = 0.1 if commands == 'speed_units' else 0.25
        launched = start('servo_compatible.launch.py', f'robot:={PANDA_DH}', f'output:={output}',
                         *arguments)
        publisher = node.create_publisher(kind, f'/servo_node/{topic}', 10)
        both = [launched, simulator]
        listener.wait(lambda: listener.client.task_names() == ['tool', 'posture']
                      and not listener.client.stop_reason() and listener.states
                      and publisher.get_subscription_count(), 'the controller', both)
        first = tool()
        if commands == 'pose':
            state = robot.state(listener.states[-1][0])
            goal = PoseStamped(pose=to_pose(state.pose('panda_hand_tcp')))
            goal.pose.position.y += 0.05
            publisher.publish(goal)
        else:
            def driven():
                publisher.publish(twist)
                return tool()[1] > first[1] + 0.05
            listener.wait(driven, 'the motion', both)
            # Drives that follow positions tell no speed.
            fastest = max(np.abs(robot.state(q).jacobian('panda_hand_tcp')[:3].dot(v)).max()
                          for q, v in listener.states[-50:])
            assert output != 'velocity' or fastest == pytest.approx(0.1, rel=0.05)
        listener.wait(lambda: np.abs(tool() - first - [0.0, 0.05, 0.0]).max() < 2e-3
                      if commands == 'pose' else np.abs(listener.states[-1][1]).max() < 0.01,
                      'the end', both)
        # Along y alone.
        assert np.abs((tool() - first)[[0, 2]]).max() < 2e-3
