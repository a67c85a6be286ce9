# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Write the tables of README.md and the pages in docs/ that repeat what is in the code.

``python docs/generate.py`` rewrites every region between ``<!-- begin generated: name -->`` and
``<!-- end generated -->``; with ``--check`` it changes nothing, and fails if a region is out of
date. Regions about the nodes need rclpy; without it they stay as they are.

Pages that repeat the code from top to bottom are on the site only: `write_site_pages` writes them
whenever Sphinx builds it.
"""

import argparse
import ast
from contextlib import contextmanager, redirect_stdout
from dataclasses import fields
from functools import cache
import importlib.util
import inspect
import io
import os
from pathlib import Path
import re
import sys

from tp_controller import Controller, Robot, Settings, Stack
from tp_controller.tasks import Task, task_types
from tp_controller.tasks.keys import DEFAULT_TOLERANCE
from tp_controller.tasks.needs import lacks
from tp_controller.tools.check.results import schema
from tp_controller.tools.cli.main import COMMANDS, make_parser
import yaml

ROOT = Path(__file__).resolve().parents[1]
# Pages of the families of task types, in the order of the table of all types.
FAMILIES = [ROOT / 'docs' / 'tasks' / f'{name}.md'
            for name in ('frames', 'joints', 'inequality', 'gradient')]
PAGES = (ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md')), *FAMILIES)
REGION = re.compile(r'(<!-- begin generated: (?P<name>[\w ]+) -->\n).*?(<!-- end generated -->)',
                    re.DOTALL)
TITLE = re.compile(r'^# (.+)$', re.MULTILINE)
SECTION = re.compile(r'^## (\w+)$', re.MULTILINE)
PANDA = ROOT / 'config' / 'robots' / 'panda.yaml'
# Packages of the types that every node's own topics and services have.
EVERY_NODE = ('lifecycle_msgs', 'rcl_interfaces', 'type_description_interfaces')
# Tests that declare faults and their outcomes.
DECLARING = ('test_joint_states', 'test_odometry', 'test_stops', 'test_outputs',
             'test_locks', 'test_permits', 'test_faults')
NAMESPACE, NODE = '/namespace', 'tp_controller'
GENERAL_KEYS = 'docs/tasks.md#what-all-tasks-have-in-common'
# Packages of the nodes that are tools.
PARTS = {'viewer': 'tools.view', 'teleop': 'tools.teleop'}

# What a goal is for `Controller.set_goal`, and the fields of its message that count.
GOALS = {
    'point': ('`x, y, z` [m]', '`point`'),
    'direction': ('`x, y, z` of any length', '`vector`'),
    'quaternion': ('`qx, qy, qz, qw`, or a 3×3 rotation matrix', '`quaternion`'),
    'pose': ('`x, y, z, qx, qy, qz, qw`, or a 4×4 matrix', '`pose`'),
    'joints': ('positions in the order of `joints`, or `{joint: position}`',
               '`name`, `position`; `velocity` as feed-forward'),
    'joint_velocities': ('velocities in the order of `joints`, or `{joint: velocity}`',
                         '`name`, `velocity`'),
    'obstacles': ('`{name: {shape: …, at: …, lifetime: …}}`; `{name: None}` removes one, '
                  "`{'*': None}` all",
                  '`ns`, `id`, `type`, `action`, `pose`, `scale`, `lifetime`, `header.frame_id` '
                  'of each marker'),
    'twist': ('`vx, vy, vz, wx, wy, wz` [m/s, rad/s]', '`twist.linear`, `twist.angular`'),
}
# Topic or service: what it is for.
TOPICS = {
    'joint_states': 'positions, merged by name, from any number of publishers; may contain '
                    'other joints',
    'odom': '[pose of a moving base](docs/ros.md#moving-bases)',
    'cmd_vel': '[velocities of a moving base](docs/ros.md#moving-bases), as those of the joints',
    'velocity_controller/commands/watchdog': 'names of [watchdogs](docs/ros.md#watchdog_node)',
    'cmd_vel/watchdog': 'the same for a moving base',
    'robot_description': 'URDF text, transient local; only without the parameters `robot` and '
                         '`robot_description`',
    '~/<task>/goal': 'the goal of a task',
    '~/<task>/obstacles': '[obstacles](docs/ros.md#obstacles), for tasks of that type',
    '~/<task>/trajectory': '[poses, points or orientations with times](docs/trajectories.md'
                           '#over-ros), or joint positions',
    '~/<task>/path': 'the same as poses with stamps',
    '~/<task>/trajectory/cancel': 'come to rest on a trajectory, and stay there',
    '~/<task>/twist': 'velocity of a frame, as feed-forward or as the goal of a `twist` task; '
                      'times out',
    'velocity_controller/commands': 'joint velocities, every cycle; zeros while the robot is '
                                    'stopped',
    'position_controller/commands': 'in its place with `output: position`: [joint positions]'
                                    '(docs/ros.md#positions-in-place-of-velocities)',
    'joint_trajectory_controller/joint_trajectory':
        'in its place with `output: trajectory`: the same, as trajectories of one point',
    '~/status': '[status](docs/ros.md#status) of the node and each task',
    '/diagnostics': 'the same once a second, where ROS tools look for it',
    '~/<task>/numbers': '[numbers](docs/ros.md#plots) of a task: error, tolerance, speeds',
    '~/<task>/transform': '[pose](docs/ros.md#poses) of the frame that a task moves',
    '~/markers': '[markers](docs/ros.md#markers) of the tasks, for RViz and the browser',
    '~/stop': 'stop the robot until `~/start`, [ramped](docs/safety.md#stops) where told',
    '~/start': 'move again; tasks without a goal take their current value as the goal',
    '~/solve_position': 'where the goals in force lead, without a motion ([inverse kinematics]'
                        '(docs/ik.md)); configuration and reasons as JSON',
    '~/lock': '[lock](docs/ros.md#locked-joints) the joint that has stopped the robot, and go on '
              '(true), or unlock all (false)',
    '~/reload': 'read the stack file again; one with faults changes nothing',
    '~/<task>/enable': 'enable (true) or disable (false) a task',
    '/clock': 'simulated time, with `publish_clock`',
    '~/reset': 'back to the initial positions; a running controller stops until its `~/start`',
}
SIMULATOR_TOPICS = {
    **TOPICS,
    'joint_states': 'positions and velocities, `rate` times a second',
    'robot_description': 'the URDF of the robot, transient local',
    'odom': 'pose and velocity of a moving base, `rate` times a second',
    'cmd_vel': 'velocities of a moving base, which stops in the same way',
    'velocity_controller/commands': 'joint velocities; the robot stops if none was received '
                                    'for `command_timeout`',
    'position_controller/commands': 'joint positions, which apply until the next command',
    'joint_trajectory_controller/joint_trajectory': 'the same: the last point, reached at its '
                                                    '`time_from_start`',
}
WATCHDOG_TOPICS = {
    'velocity_controller/commands': 'joint velocities; zeros if none came for `timeout` after '
                                    'one that moves the robot',
    'cmd_vel': 'the same for a moving base',
    'velocity_controller/commands/watchdog': 'name of the watchdog, ten times a second',
    'cmd_vel/watchdog': 'the same for a moving base',
}
TELEOP_TOPICS = {
    'joy': 'axes and buttons of the device (parameter `joy_topic`)',
    '/tp_controller/tool/twist': 'twist of the task (parameters `controller` and `task`)',
    'pose': 'poses of the device (parameter `pose_topic`)',
    'clutch': 'dead-man switch of a device that sends poses (parameter `dead_man_topic`)',
    '/tp_controller/tool/transform': 'pose of the tool, for a device that sends poses',
    '/tp_controller/tool/goal': 'goal of the task, by a device that sends poses',
    '~/status': '`driving`, or why nothing moves, ten times a second and when it changes',
    '~/gripper': 'state of the button `gripper`, when it changes',
}
DIRECTIONS = {('in',): 'Subscribed', ('out',): 'Published', ('service',): 'Services',
              ('in', 'out'): 'Subscribed and published'}
# Page about a command, or section of one.
COMMAND_PAGES = {
    'demo': 'docs/robots.md#three-robots-at-work', 'goal': 'docs/ros.md#goals-from-the-shell',
    'status': 'docs/ros.md#status', 'check': 'docs/check.md',
    'ik': 'docs/ik.md#from-the-shell', 'view': 'docs/view.md',
    'teleop': 'docs/teleop.md#keyboard',
    'record': 'docs/record.md', 'plot': 'docs/record.md#plot',
}
STATUS = {
    'scale': 'smallest share of its velocity that limits leave a task; 1 if no limit is active',
    'limiting': 'joint and limit that cost the uppermost limited task most',
    'locked': 'joints that are [locked](#locked-joints)',
    'cycles': 'cycles since the node was configured',
    'rate [Hz]': 'cycles per second; this and the times are of the last 1000 cycles',
    **{f'cycle {which} [ms]': 'time that a cycle takes; p99: 99 of 100 take less'
       for which in ('median', 'p99', 'max')},
    **{f'state to command {which} [ms]': 'time from the receipt of joint states to the command'
       for which in ('median', 'p99', 'max')},
    'overruns': 'cycles that began more than a period late, or took longer than a period',
    'solver': '[which one](docs/core.md) runs: `compiled` or `python`',
    'cycles left to Python': 'cycles that the compiled solver could not solve',
    'stalls': 'how often the loop stood still for longer than `state_timeout`',
    'missed deadlines': 'how often joint states came later than `state_deadline`',
    'lead': 'with [positions](docs/ros.md#positions-in-place-of-velocities): largest distance '
            'of a joint from its commanded position, as a share of the one allowed',
    'ignored description': 'what to do about another `robot_description` that has arrived',
    'not following': 'joint that has stopped the robot as it does not follow',
    'other publishers': 'other nodes that publish the same commands',
    'listeners': 'other nodes that listen to the commands, besides watchdogs',
    'watchdogs': 'watchdogs that do',
    'type': 'its type',
    'level': 'level in the stack, 1 is the highest; `disabled` for a disabled task',
    'status': '`reached`, `satisfied` (bounds), `moving`, `limited`, `failed`, `disabled` or '
              '`stopped` (zeros are commanded)',
    'error [m]': 'norm of the error, or distance outside its bounds; one key for each unit: '
                 '`[m]`, `[rad]`, `[1]` for ratios, `[m/s]`, `[rad/s]` for velocities',
    'tolerance [m]': 'error below which the goal counts as reached; one key for each unit',
    **{f'{which} speed': 'norm of the demanded velocity, and of the part that is commanded'
       for which in ('wanted', 'achieved')},
    'progress': 'share of the time of its [trajectory](docs/trajectories.md) that has passed',
    'hint': 'what would help',
    'reason': 'what limits or blocks the task',
    'causes': 'its causes one by one, without numbers, the largest share first, separated by '
              'semicolons',
    **{f'goals {outcome}': 'goals and velocities since the task is in the stack'
       for outcome in ('accepted', 'refused')},
    'last refusal': 'reason of the last refusal',
    'gain warning': 'whether its gain is [too high](docs/method.md#time-steps-and-gains) at the '
                    'rate of the last cycles',
    'goal warning': 'probable mistake in the last goal: out of reach, or coordinates that do not '
                    'count',
    'goal listeners': 'subscriptions to `~/<task>/goal`, the controller among them; one key for '
                      'each topic of the task',
}


def table(head, rows):
    """Return a table in Markdown."""
    titles, *lines = ['| ' + ' | '.join(str(cell).replace('|', r'\|') for cell in line) + ' |'
                      for line in (head, *rows)]
    return '\n'.join((titles, '|' + '---|' * len(head), *lines)) + '\n'


def listing(entries):
    """Return a list in Markdown of names with their meanings; an empty text without any."""
    return ''.join(f'- {name}: {meaning}\n' for name, meaning in entries)


def literal(value):
    """Return a default as it is written in YAML."""
    if value is inspect.Parameter.empty:
        return '**needed**'
    if value is None or value == '':
        return ''
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    return f'`{value}`'


def interval(lower, upper, valid=()):
    """Return the values that are valid, as text."""
    if valid:
        return ', '.join(f'`{value}`' for value in valid)
    if lower is None or (lower == float('-inf') and upper == float('inf')):
        return ''
    return f'{lower:g} … {upper:g}'.replace('inf', '∞')


def summary(described):
    """Return the first line of a docstring, without its sources and final full stop."""
    line = inspect.getdoc(described).partition('\n')[0]
    return re.sub(r' \((lecture|slides|lab|wiki|notes)\b.*\)', '', line).rstrip('.')


# What needs no ROS -----------------------------------------------------------------------


@cache
def families():
    """Return {page: {name: class}} of this package's task types, in the order of the pages."""
    known = {name: kind for name, kind in task_types().items()
             if kind.__module__.startswith('tp_controller.')}
    return {page: {name: known[name] for name in SECTION.findall(page.read_text(encoding='utf-8'))
                   if name in known} for page in FAMILIES}


def types_in_order():
    """Return {name: class} of this package's task types, in the order of their sections."""
    return {name: kind for kinds in families().values() for name, kind in kinds.items()}


def tasks():
    """Return a list of task types for each family."""
    parts = []
    for page, kinds in families().items():
        path = page.relative_to(ROOT)
        title = TITLE.search(page.read_text(encoding='utf-8'))[1]
        lines = [f'- [`{name}`]({path}#{name}): {lowered(summary(kind).partition(":")[0])}'
                 for name, kind in kinds.items()]
        parts.append(f'**[{title}]({path})**\n\n' + '\n'.join(lines) + '\n')
    return '\n'.join(parts)


def lowered(text):
    """Return a text that does not begin with a capital letter."""
    return text[0].lower() + text[1:]


def goal_forms():
    """Return the list of the forms of goals in Python."""
    return '\n'.join(f'- {goal.replace("_", " ")}: {form}'
                     for goal, (form, _) in GOALS.items()) + '\n'


def goal_types(kind):
    """Return the kinds of goals that a type of tasks takes, the default one first."""
    return kind.goal_types or tuple(
        filter(None, [kind.goal_type or kind.feed_forward_type]))


def keys(name):
    """Return the keys of a task type: a list, and those that are described elsewhere."""
    rows, general = key_entries(task_types()[name]), key_entries(Task)
    shown = {}
    for other, kind in next((kinds for kinds in families().values() if name in kinds), {}).items():
        if other == name:
            break
        for row in key_entries(kind):
            shown.setdefault(row, other)
    new, known = [row for row in rows if row not in {*shown, *general}], {}
    for row in rows:
        if row in shown and row not in general:
            known.setdefault(shown[row], []).append(key_of(row))
    lines = [f'As for [{other}](#{other}): {", ".join(names)}.' for other, names in known.items()]
    lines += general_part(rows, general)
    return '\n'.join((*([listing(new)] if new else ()),
                      *([' '.join(lines) + '\n'] if lines else ())))


def general_part(rows, general):
    """Yield the shorter sentence about keys of all tasks that a type lacks or has; none if all."""
    names = set(map(key_of, rows))
    taken = [key_of(row) for row in general if row in rows]
    lacking = [key_of(row) for row in general if key_of(row) not in names]
    if len(lacking) >= len(taken):
        yield f'Of the [keys of all tasks]({GENERAL_KEYS}) only {", ".join(taken)}.'
    elif lacking:
        yield f'Without {", ".join(lacking)}.'


def general_keys():
    """Return the list of the keys that all types share."""
    return listing(key_entries(Task))


def key_of(row):
    """Return the key of an entry, without its default and range."""
    return row[0].partition(' ')[0]


def key_entries(kind):
    """Return the entries of the list of the keys of a task type."""
    described, valid, rows = kind.described_keys(), kind.key_ranges(), []
    for key, default in kind.accepted_keys().items():
        if key == 'accept':
            # Every type has it, and docs/check.md explains it.
            continue
        if key == 'tolerance':
            default = '{' + ', '.join(f'{unit}: {value:g}'
                                      for unit, value in DEFAULT_TOLERANCE.items()) + '}'
        rows.append((with_range(key, literal(default), valid[key]), described[key]))
    return rows


def with_range(name, default, values, unit=''):
    """Return a name with its default and range, the default first; any part may be empty."""
    parts = (values,) if default and values.startswith(default) else (default, values)
    text = f'{", ".join(filter(None, parts))} {unit}'.strip()
    return f'`{name}` ({text})' if text else f'`{name}`'


def classes():
    """Return the directives of Sphinx for the classes of this package's task types."""
    lines = [f'.. autoclass:: {kind.__name__}' for kind in types_in_order().values()]
    return '\n'.join(['```{eval-rst}', *lines, '```\n'])


def settings():
    """Return the list of settings."""
    rows = []
    for item in fields(Settings):
        about = item.metadata
        values = interval(about.get('lower'), about.get('upper'), about.get('valid', ()))
        rows.append((with_range(item.name, literal(item.default), values, about['unit']),
                     about['description']))
    return listing(rows)


def commands():
    """Return the list of the commands."""
    return listing((f'[`{name}`]({COMMAND_PAGES[name]})', command.brief)
                   for name, command in COMMANDS.items())


def command_help(*arguments):
    """Return the output of the command line with some arguments and --help."""
    printed = io.StringIO()
    with environment(COLUMNS='80', NO_COLOR='1'), redirect_stdout(printed):
        try:
            make_parser().parse_args([*arguments, '--help'])
        except SystemExit:
            pass
    return f'```text\n$ {" ".join(("tp_controller", *arguments, "--help"))}\n' \
           f'{printed.getvalue()}```\n'


def launch_arguments(name):
    """Return the table of the arguments of a launch file, read off its code."""
    code = (ROOT / 'launch' / f'{name}.launch.py').read_text(encoding='utf-8')
    rows = []
    for node in ast.walk(ast.parse(code)):
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == 'DeclareLaunchArgument':
            values = {keyword.arg: keyword.value for keyword in node.keywords}
            default = values['default_value']
            shown = literal(default.value) if isinstance(default, ast.Constant) \
                else '`config/controller.rviz`'
            rows.append((f'`{node.args[0].value}`', shown,
                         ast.literal_eval(values['description'])))
    return table(('argument', 'default', 'meaning'), rows)


# What needs ROS --------------------------------------------------------------------------


def parameters(node):
    """Return the list of the parameters of a node."""
    module = importlib.import_module(f'tp_controller.{PARTS.get(node, "ros")}.{node}_node')
    fixed, changing = (listing(map(parameter_entry, (
        spec for spec in module.PARAMETERS
        if spec.fixed is kind and not listed_elsewhere(node, spec)))) for kind in (True, False))
    if not changing:
        return fixed
    return f'*Fixed:*\n\n{fixed}\n*Any time:*\n\n{changing}'


def listed_elsewhere(node, spec):
    """Return whether the list of a node leaves a parameter to that of something else."""
    from tp_controller.ros.interface.settings_parameters import SETTINGS
    from tp_controller.ros.parameters import ROBOT
    return spec in {'controller': SETTINGS, 'simulator': ROBOT}.get(node, ())


def parameter_entry(spec):
    """Return a parameter with its default and range, and its description."""
    values = interval(spec.lower, spec.upper)
    return with_range(spec.name, literal(spec.default), values, spec.unit), spec.description


def goals():
    """Return the lists of goal messages by topic."""
    from tp_controller.ros.interface import goal_messages as messages
    lists = {}
    for kind, entry in (*messages.GOALS.items(), *messages.FEED_FORWARD.items()):
        takers = [f'`{name}`' for name, task in types_in_order().items()
                  if kind in (task.feed_forward_type,) * (entry.topic == 'twist')
                  or (entry.topic != 'twist' and kind in goal_types(task))]
        lists.setdefault(entry.topic, []).append(
            (f'`{message_name(entry.kind)}` ({GOALS[kind][1]})', ', '.join(takers)))
    return '\n'.join(f'*`~/<task>/{topic}`:*\n\n{listing(entries)}'
                     for topic, entries in lists.items())


def topics(node):
    """Return the lists of topics and services, read off a running node."""
    described = {'controller': TOPICS, 'simulator': SIMULATOR_TOPICS,
                 'watchdog': WATCHDOG_TOPICS, 'teleop': TELEOP_TOPICS}[node]
    opened = interfaces(node)
    # In the graph of ROS the loop of the controller is a node of its own.
    several = len({owner for *_, owner in opened}) > 1
    rows, lists = {}, {}
    for direction, name, kind, owner in opened:
        kind = '[by task](docs/ros.md#goals)' if name == '~/<task>/goal' else f'`{kind}`'
        entry = f'`{name}` ({kind})', described[name]
        rows.setdefault((f', at `{owner}`' if several else '', entry), {})[direction] = True
    for (at, entry), directions in rows.items():
        lists.setdefault(f'*{DIRECTIONS[tuple(directions)]}{at}:*', []).append(entry)
    return '\n'.join(f'{head}\n\n{listing(entries)}' for head, entries in lists.items())


@cache
def interfaces(node):
    """Return (direction, name, type, node) of the topics and services that a node opens."""
    import rclpy
    from rclpy.parameter import Parameter
    # On a base that moves, or its topics would be missing.
    robot = {'robot': str(PANDA), 'base': 'planar'}
    if node == 'controller':
        from tp_controller.ros.controller_node import ControllerNode as Node
        arm = Robot.from_file(PANDA, base='planar')
        stack = [{name: {'type': name, **kind.example}} for name, kind in task_types().items()
                 if not lacks(name, kind.needs, arm, kind.example)]
        starts = ({**robot, 'stack': yaml.safe_dump(stack)}, {}, *(
            {**robot, 'output': output} for output in ('position', 'trajectory')))
    elif node == 'watchdog':
        from tp_controller.ros.watchdog_node import WatchdogNode as Node
        starts = ({'base': 'planar'},)
    elif node == 'teleop':
        from tp_controller.tools.teleop.teleop_node import TeleopNode as Node
        starts = ({'x': 'axis 1', 'gripper': 'button 0'},
                  {'pose_topic': 'pose', 'dead_man_topic': 'clutch'})
    else:
        from tp_controller.ros.simulator_node import SimulatorNode as Node
        starts = ({**robot, 'publish_clock': True},)
    found = []
    quiet = [f'--disable-{logs}-logs' for logs in ('external-lib', 'stdout', 'rosout')]
    with environment(ROS_AUTOMATIC_DISCOVERY_RANGE='OFF'):
        for values in starts:
            context = rclpy.Context()
            rclpy.init(context=context, args=['--ros-args', *quiet])
            try:
                made = Node(context=context, namespace=NAMESPACE, parameter_overrides=[
                    Parameter(name, value=value) for name, value in values.items()])
                found += _opened(made, made.get_name())
                if node == 'controller':
                    found += _opened(made.loop_node, made.get_name())
                made.destroy_node()
            finally:
                rclpy.try_shutdown(context=context)
    order = ('in', 'out', 'service')
    # Those of a package that may be missing have a section of their own.
    found = [entry for entry in found if not entry[1].startswith('~/interactive_goals/')]
    return sorted(dict.fromkeys(found), key=lambda entry: order.index(entry[0]))


def _opened(node, owner):
    """Yield (direction, name, type, node) of a node's own topics and services, as of `owner`."""
    opened = [('in', entry.topic_name, entry.msg_type) for entry in node.subscriptions]
    opened += [('out', entry.topic_name, entry.msg_type) for entry in node.publishers]
    opened += [('service', entry.srv_name, entry.srv_type) for entry in node.services]
    own = f'{NAMESPACE}/{owner}/'
    for direction, name, kind in opened:
        if kind.__module__.partition('.')[0] in EVERY_NODE:
            continue
        if not name.startswith('/'):
            name = f'{NAMESPACE}/{name.replace("~", node.get_name())}'
        if name.startswith(own):
            name = '~/' + name.removeprefix(own)
            _, task, *last = name.split('/')
            if last and task != 'interactive_goals':
                name = '/'.join(('~/<task>', *last))
        elif name.startswith(f'{NAMESPACE}/'):
            name = name.removeprefix(f'{NAMESPACE}/')
        yield direction, name, message_name(kind), node.get_name()


def message_name(kind):
    """Return the name that ROS tools use for a message or service type."""
    package, part = kind.__module__.split('.')[:2]
    return f'{package}/{part}/{kind.__name__}'


def status():
    """Return the lists of the keys of a status message, read off a message."""
    from builtin_interfaces.msg import Time
    from tp_controller.ros.interface.status import diagnostics
    from tp_controller.ros.interface.task_topics import GoalRecord
    from tp_controller.ros.loop.loop_statistics import Figures
    robot = Robot.from_file(PANDA)
    stack = Stack.from_yaml('[tool: {type: position, frame: panda_hand_tcp}]', robot)
    controller = Controller(robot, stack)
    report = controller.update(robot.neutral(), 0.0).report
    message = diagnostics(Time(), NODE, '', report, controller,
                          {'tool': GoalRecord(listeners={'goal': 1})}, Figures(0.01).as_text(),
                          lambda: None)
    lists = []
    for of, entry in zip(('the node', 'a task'), message.status):
        rows = {}
        for value in entry.values:
            rows.setdefault(STATUS[value.key], []).append(f'`{value.key}`')
        keys = listing((', '.join(keys), meaning) for meaning, keys in rows.items())
        lists.append(f'*Keys of {of}:*\n\n{keys}')
    return '\n'.join(lists)


def messages():
    """Return the list of all messages."""
    spec = importlib.util.spec_from_file_location('messages', ROOT / 'docs' / 'messages.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.listing()


def check_report():
    """Return the parts of the report of a check with their fields, as JSON has them."""
    parts = []
    for kind, described in schema():
        rows = ''.join(f'- `{name}`{unit and f" [{unit}]"}: {text}\n'
                       for name, unit, text in described)
        parts.append(f'**{kind.__name__}**: {inspect.getdoc(kind).partition(chr(10))[0]}\n\n'
                     f'{rows}')
    return '\n'.join(parts).rstrip()


def faults():
    """Return the table of faults by their outcomes, as the tests declare them."""
    folders = [str(ROOT / 'test' / name)
               for name in ('', 'faults', 'ros', 'ros/loop', 'system')]
    before, sys.path[:0] = list(sys.path), folders
    try:
        declared = importlib.import_module('fault_table').TABLE
        for module in DECLARING:
            importlib.import_module(module)
    finally:
        sys.path[:] = before
    grouped = {}
    for area, found in declared.items():
        for outcome, test in found:
            within = '' if outcome.within == float('inf') else f'{outcome.within:g} s'
            alike = grouped.setdefault((area, outcome.commanded, within, outcome.ends), ([], []))
            for texts, text in zip(alike, (outcome.fault, f'`{test}`')):
                if text not in texts:
                    texts.append(text)
    areas = [area for area, *_ in grouped]
    rows = [('' if area == before else area, '; '.join(faults), *outcome, ', '.join(tests))
            for before, ((area, *outcome), (faults, tests)) in zip(
                ['', *areas], grouped.items())]
    return table(('area', 'faults', 'commanded', 'noticed within', 'ends', 'test'), rows)


REGIONS = {
    'tasks': tasks, 'settings': settings, 'commands': commands,
    'classes': classes,
    'general keys': general_keys,
    **{f'keys {name}': lambda name=name: keys(name) for name in task_types()},
    'goal forms': goal_forms,
}
ROS_REGIONS = {
    'goals': goals, 'status': status, 'faults': faults,
    **{f'{what.__name__} {node}': lambda what=what, node=node: what(node)
       for what in (topics, parameters)
       for node in ('controller', 'simulator', 'watchdog', 'teleop')},
    'parameters viewer': lambda: parameters('viewer'),
}


# Pages of the site only ------------------------------------------------------------------


def messages_page():
    """Return the page of all messages."""
    return ('# Messages\n\nEvery message that the product can print, by the file of '
            '`tp_controller/` that it comes from. `{name}` stands for what is filled in. The '
            'reasons and hints of the status are in `control/reasons.py`.\n\n' + messages())


def command_line_page():
    """Return the page of the help of all commands, and of the arguments of launch files."""
    commands = [f'## {" ".join(("tp_controller", *words))}\n\n{command_help(*words)}'
                for words in ((), *((name,) for name in COMMANDS))]
    files = [f'## {name}.launch.py\n\n{launch_arguments(name)}'
             for name in ('controller', 'demo', 'servo_compatible')]
    return '# The command line\n\n' + '\n'.join(commands + files)


def check_report_page():
    """Return the page of the fields of the report of a check."""
    return ('# The report of a check\n\nThe parts of the report of `tp_controller check --json` '
            'with their fields.\n\n' + check_report())


SITE_PAGES = {'messages': messages_page, 'command_line': command_line_page,
              'check_report': check_report_page}


def write_site_pages(folder):
    """
    Write the pages of the site only, those that have changed.

    Parameters
    ----------
    folder : pathlib.Path
        Made where it is missing.

    """
    folder.mkdir(exist_ok=True)
    for name, page in SITE_PAGES.items():
        path, text = folder / f'{name}.md', page()
        if not path.exists() or path.read_text(encoding='utf-8') != text:
            path.write_text(text, encoding='utf-8')


# Pages -----------------------------------------------------------------------------------


@contextmanager
def environment(**changes):
    """Change environment variables for a while."""
    before = {name: os.environ.get(name) for name in changes}
    os.environ.update(changes)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@cache
def content(name):
    """Return the current text of a region."""
    return {**REGIONS, **ROS_REGIONS}[name]()


def renewed(page, ros=True):
    """
    Return the text of a page with current regions.

    Parameters
    ----------
    page : pathlib.Path
        Its file.
    ros : bool
        Whether to renew the regions that need ROS, too.

    Returns
    -------
    str

    """
    def region(match):
        name = match['name']
        if name not in REGIONS and name not in ROS_REGIONS:
            raise SystemExit(f'{page}: unknown region {name!r}; '
                             f'valid: {", ".join((*REGIONS, *ROS_REGIONS))}')
        if name in ROS_REGIONS and not ros:
            return match[0]
        text = content(name)
        if page.parent != ROOT:
            up = '../' * (page in FAMILIES)
            text = text.replace('(docs/', f'({up}').replace(f'({page.name}#', '(#')
        return f'{match[1]}\n{text}\n{match[3]}'

    return REGION.sub(region, page.read_text(encoding='utf-8'))


def same(one, other):
    """Return whether two texts differ at most in white space: line breaks of argparse vary."""
    return one.split() == other.split()


def main():
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('--check', action='store_true', help='only say what is out of date')
    check = parser.parse_args().check
    ros = importlib.util.find_spec('rclpy') is not None
    if not ros:
        print('no rclpy: the tables about the nodes stay as they are', file=sys.stderr)
    outdated = 0
    for page in PAGES:
        text = renewed(page, ros)
        if same(text, page.read_text(encoding='utf-8')):
            continue
        outdated += 1
        print(f'{page.relative_to(ROOT)}: {"out of date" if check else "renewed"}')
        if not check:
            page.write_text(text, encoding='utf-8')
    return 1 if check and outdated else 0


if __name__ == '__main__':
    sys.exit(main())
