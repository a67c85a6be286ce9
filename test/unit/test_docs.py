# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
README.md and docs/ cannot rot: what they show is run, loaded, parsed or looked up.

- ``python`` blocks of a page run in order, in one namespace, from the root of the repository. A
  ``text`` block that follows directly is what they print.
- ``yaml`` lists are stacks and load for the Panda; mappings are DH tables or parameter files.
- Lines of ``bash`` blocks, and of blocks without a language, must be ones the programs accept.
- A block after ``<!-- file: name -->`` is a file of an example; it is not run by itself.

What is about messages and parameters needs ROS and is skipped without.
"""

from contextlib import redirect_stdout
from dataclasses import dataclass
import importlib
import importlib.util
import io
import os
from pathlib import Path
import re
import runpy
import shlex
import subprocess
import sys

from PIL import Image
import pytest
import robots
import setuptools
import tp_controller
from tp_controller import Robot, Stack
from tp_controller.resources import find_file
from tp_controller.tasks import Task, task_types
from tp_controller.tasks.needs import NEEDS
from tp_controller.tools.cli.main import COMMANDS, make_parser
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / 'docs'
HOW_TO = sorted((DOCS / 'howto').glob('*.md'))
ROBOTS = sorted((DOCS / 'robots').glob('*.md'))
FAMILIES = sorted((DOCS / 'tasks').glob('*.md'))
# Pages that are made with the site; index.md leads to them.
GENERATED = DOCS / 'generated'
BESIDE = [ROOT / f'{name}.md' for name in (
    'README', 'CONTRIBUTING', 'RELEASING', 'QUALITY_DECLARATION')]
PAGES = [*BESIDE, *sorted(DOCS.glob('*.md')), *HOW_TO, *ROBOTS, *FAMILIES]
# What they show is a file beside the folder.
INCLUDING = {DOCS / f'{name}.md' for name in (
    'contributing', 'changelog', 'versions', 'quality_declaration')}
# Messages are made on first use, by packages that import deprecated modules.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")
FENCE = re.compile(r'^(?P<fence>```+|~~~+)(?P<language>\w*|\{[\w-]+\})(?: \S+)?$')
FILE = re.compile(r'<!-- file: (\S+) -->')
LINK = re.compile(r'\[[^\]]*\]\(([^)\s]+)\)')
# Programs that are not ours; what they are told is not looked at.
FOREIGN = {'bloom-generate', 'bloom-release', 'cd', 'colcon', 'dpkg-buildpackage', 'export', 'git',
           'mkdir', 'pip', 'rosdep', 'source', '.'}
# Parameters that every node has.
EVERY_NODE = {'use_sim_time': False}
# Packages of drivers, whose launch files and executables are not looked at either.
DRIVERS = {'controller_manager', 'franka_bringup', 'kortex_bringup', 'ur_robot_driver',
           'xarm_controller'}
# The folder of the installed package, as users of ROS write it; it has what is in the repository.
SHARE = '$(ros2 pkg prefix --share tp_controller)/'
EXECUTABLES = ('controller_node', 'simulator_node', 'teleop_node', 'tp_controller',
               'viewer_node', 'watchdog_node')


@dataclass(frozen=True)
class Block:
    """A fenced block of a page; `file` is its name if it is a file of an example."""

    page: Path
    line: int
    language: str
    text: str
    file: str

    def __str__(self):
        """Return where it is."""
        return f'{self.page.name}:{self.line}'


def blocks_of(page):
    """Return the fenced blocks of a page, and for each the index of the line after it."""
    found, start, file = [], None, ''
    lines = page.read_text(encoding='utf-8').splitlines()
    for number, line in enumerate(lines, 1):
        fence = FENCE.match(line)
        if start is None and fence:
            start, opened = number, fence
        elif start is not None and line == opened['fence']:
            found.append((Block(page, start, opened['language'],
                                '\n'.join(lines[start:number - 1]) + '\n', file), number))
            start, file = None, ''
        elif start is None and line.strip():
            file = (FILE.match(line) or ['', ''])[1]
    assert start is None, f'{page.name}:{start}: the block is not closed'
    return found


def blocks(*languages):
    """Return the blocks of all pages in some languages."""
    return [block for page in PAGES for block, _ in blocks_of(page)
            if block.language in languages]


def output_of(page, block, end):
    """Return the text block that follows a block directly; None if there is none."""
    lines = page.read_text(encoding='utf-8').splitlines()
    for other, _ in blocks_of(page):
        if other.language == 'text' and other.line > end \
                and not ''.join(lines[end:other.line - 1]).strip():
            return other.text
    return None


def commands():
    """Return (block, words) of every command line, continued lines joined."""
    found = []
    for block in blocks('bash', ''):
        if block.file:
            continue
        for line in block.text.replace('\\\n', ' ').splitlines():
            words = shlex.split(line, comments=True)
            if words and (block.language or words[0] in ('tp_controller', 'make', 'python')):
                found.append((block, words))
    return found


def commands_of(*first):
    """Return the command lines of this package that begin with some words, for a test."""
    return [pytest.param(words, id=f'{block} {shlex.join(words)[:60]}')
            for block, words in commands()
            if words[:len(first)] == list(first) and not DRIVERS.intersection(words[2:3])]


def identity(value):
    """Return the name of a parameter in the names of tests."""
    return value.name if isinstance(value, Path) else str(value)


@pytest.fixture(scope='module')
def generate():
    """Return docs/generate.py as a module."""
    spec = importlib.util.spec_from_file_location('generate', DOCS / 'generate.py')
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope='module')
def panda():
    """Return the robot that the stacks are for; those of the pages may be about its base."""
    return Robot.from_file(ROOT / 'config' / 'robots' / 'panda.yaml', base='planar')


@pytest.fixture
def own_task_types(monkeypatch):
    """Keep task types that an example registers out of all other tests."""
    monkeypatch.setattr(Task, 'types', dict(Task.types))


# Tables ----------------------------------------------------------------------------------


@pytest.mark.parametrize('page', PAGES, ids=identity)
def test_generated_tables_are_current(page, generate):
    assert generate.same(generate.renewed(page, ros=False), page.read_text(encoding='utf-8')), \
        'run: python docs/generate.py'


@pytest.mark.slow
@pytest.mark.parametrize('page', PAGES, ids=identity)
def test_generated_tables_about_the_nodes_are_current(page, generate):
    pytest.importorskip('rclpy')
    assert generate.same(generate.renewed(page), page.read_text(encoding='utf-8')), \
        'run: python docs/generate.py'


@pytest.mark.slow
def test_lists_of_topics_name_the_node_at_which_ros_tools_show_them(generate):
    pytest.importorskip('rclpy')
    nodes = {}
    for part in re.split(r'^\*', generate.topics('controller'), flags=re.MULTILINE)[1:]:
        head, _, entries = part.partition(':*')
        nodes |= dict.fromkeys(re.findall('^- `(\\S+)`', entries, re.MULTILINE), head)
    for name in ('joint_states', 'velocity_controller/commands', '~/stop'):
        assert nodes[name].endswith(', at `tp_controller_loop`')
    for name in ('~/status', '~/start', '~/<task>/goal'):
        assert nodes[name].endswith(', at `tp_controller`')
    assert generate.topics('watchdog').startswith('*Subscribed and published:*')


def test_every_table_is_shown(generate):
    shown = {match['name'] for page in PAGES
             for match in generate.REGION.finditer(page.read_text(encoding='utf-8'))}
    assert {*generate.REGIONS, *generate.ROS_REGIONS} == shown


@pytest.mark.parametrize('message', [
    # A refusal that is put together, a log line, an argument, a reason, a hint.
    'unknown key {other}; valid: {accepted}',
    'commanding {what}: {reason}',
    '{text} is not of the form NAME=VALUE',
    'blocked by the bounds of {}',
    'choose a goal that the bounds of {name} allow'])
@pytest.mark.slow
def test_list_of_messages_has_messages_of_every_kind(message, generate):
    assert f'- `{message}`\n' in generate.messages()


@pytest.mark.slow
def test_pages_of_the_site_only_have_all_messages_and_the_help_of_all_commands(generate, tmp_path):
    generate.write_site_pages(tmp_path / 'pages')
    texts = {path.stem: path.read_text(encoding='utf-8')
             for path in (tmp_path / 'pages').iterdir()}
    assert set(texts) == {'messages', 'command_line', 'check_report'}
    assert generate.check_report() in texts['check_report']
    assert generate.messages() in texts['messages']
    for name, command in COMMANDS.items():
        assert f'\n$ tp_controller {name} --help\n' in texts['command_line']
        assert command.examples.strip() in texts['command_line']
    for name in ('controller', 'demo', 'servo_compatible'):
        arguments = generate.launch_arguments(name)
        assert f'\n## {name}.launch.py\n\n{arguments}' in texts['command_line']


@pytest.mark.slow
def test_pages_of_the_site_are_written_only_if_they_have_changed(generate, tmp_path):
    generate.write_site_pages(tmp_path)
    unchanged, changed = tmp_path / 'command_line.md', tmp_path / 'messages.md'
    changed.write_text('# Messages\n', encoding='utf-8')
    for path in (unchanged, changed):
        os.utime(path, (1, 1))
    generate.write_site_pages(tmp_path)
    assert unchanged.stat().st_mtime == 1 and changed.stat().st_mtime > 1
    assert generate.messages() in changed.read_text(encoding='utf-8')


def test_pages_of_the_site_only_are_not_committed(generate):
    first = LINK.findall((DOCS / 'index.md').read_text(encoding='utf-8'))
    linked = {link.partition('/')[2] for link in first if link.startswith(f'{GENERATED.name}/')}
    assert linked == {f'{name}.md' for name in generate.SITE_PAGES}
    ignored = (ROOT / '.gitignore').read_text(encoding='utf-8').splitlines()
    assert f'{GENERATED.relative_to(ROOT)}/' in ignored
    assert not {page for page in PAGES if GENERATED in page.parents}


@pytest.mark.slow
def test_list_of_messages_has_nothing_else(generate):
    # A docstring, the description of a key and of a parameter.
    for text in ('Collects what is wrong', 'gain K, one', 'cycles per second', '<robot name'):
        assert text not in generate.messages()


def test_every_task_type_has_a_section_with_its_keys_and_an_example(generate):
    own = {name for name, kind in generate.task_types().items()
           if kind.__module__.startswith('tp_controller.')}
    assert sorted(generate.FAMILIES) == FAMILIES
    assert all(generate.families().values())
    assert set(generate.types_in_order()) == own
    text = '\n'.join(page.read_text(encoding='utf-8') for page in FAMILIES)
    for section in re.split(r'^## ', text, flags=re.MULTILINE)[1:]:
        name = section.partition('\n')[0]
        if name in own:
            assert re.search(rf'type: {name}\b', section), name
            assert f'begin generated: keys {name} ' in section, name


def test_generator_notices_a_table_that_is_out_of_date(generate, tmp_path):
    page = tmp_path / 'page.md'
    page.write_text('<!-- begin generated: settings -->\nold\n<!-- end generated -->\n',
                    encoding='utf-8')
    assert not generate.same(generate.renewed(page), page.read_text(encoding='utf-8'))
    page.write_text(generate.renewed(page), encoding='utf-8')
    assert generate.renewed(page) == page.read_text(encoding='utf-8')


def test_robot_page_names_every_key_of_a_dh_table():
    from tp_controller.model.dh import CONVENTIONS, FRAME_KEYS, JOINT_KEYS, JOINT_TYPES, TABLE_KEYS
    text = (DOCS / 'robots.md').read_text(encoding='utf-8')
    for word in {*CONVENTIONS, *FRAME_KEYS, *JOINT_KEYS, *JOINT_TYPES, *TABLE_KEYS}:
        assert f'`{word}`' in text, word


def test_reference_has_every_public_name():
    text = (DOCS / 'reference.md').read_text(encoding='utf-8')
    shown = [name.rpartition('.')[2]
             for name in re.findall(r'^\.\. auto\w+:: (\S+)$', text, re.MULTILINE)]
    assert len(shown) == len(set(shown))
    names = {*tp_controller.__all__, *tp_controller.tasks.__all__, 'Report', 'TaskReport', 'Cause'}
    assert names <= set(shown)


# Python ----------------------------------------------------------------------------------


@pytest.mark.parametrize('page', [page for page in PAGES if any(
    block.language == 'python' and not block.file for block, _ in blocks_of(page))], ids=identity)
@pytest.mark.slow
def test_python_blocks_run_and_print_what_is_shown(page, monkeypatch, own_task_types):
    monkeypatch.chdir(ROOT)
    namespace = {'__name__': 'example'}
    for block, end in blocks_of(page):
        if block.language != 'python' or block.file:
            continue
        printed = io.StringIO()
        # Lines before it, so that a traceback shows the line of the page.
        code = compile('\n' * block.line + block.text, str(page), 'exec')
        with redirect_stdout(printed):
            exec(code, namespace)
        assert printed.getvalue() == (output_of(page, block, end) or ''), block


@pytest.mark.slow
def test_task_type_of_another_package_works_as_documented(tmp_path):
    page = DOCS / 'howto' / 'own_task_type.md'
    files = {block.file: block.text for block in blocks('python', 'yaml')
             if block.file and block.page == page}
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')
    arguments = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path)
        patch.setattr(setuptools, 'setup', arguments.update)
        runpy.run_path('setup.py')
    # What an installer would write.
    installed = tmp_path / f'{arguments["name"]}-{arguments["version"]}.dist-info'
    installed.mkdir()
    (installed / 'METADATA').write_text(
        f'Metadata-Version: 2.1\nName: {arguments["name"]}\nVersion: {arguments["version"]}\n')
    (installed / 'entry_points.txt').write_text(''.join(
        f'[{group}]\n' + '\n'.join(lines) + '\n'
        for group, lines in arguments['entry_points'].items()))
    script, = (name for name in files if name.startswith('try_'))
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, text=True, capture_output=True, timeout=60,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join((str(tmp_path), str(ROOT)))})
    assert done.returncode == 0, done.stderr
    shown, = (output_of(page, block, end) for block, end in blocks_of(page)
              if block.file == script)
    assert done.stdout == shown


# YAML ------------------------------------------------------------------------------------


def robot_for(stack, panda):
    """Return the Panda of the pages; another one for a stack with a type that this one lacks."""
    levels = [level if isinstance(level, list) else [level] for level in stack]
    kinds = [task_types()[keys['type']] for level in levels for task in level
             for keys in task.values()]
    met = all(NEEDS[need].met(panda) or NEEDS[need].instead for kind in kinds
              for need in kind.needs)
    return panda if met else robots.robot_for(*kinds)


@pytest.mark.parametrize('block', [block for block in blocks('yaml') if not block.file],
                         ids=identity)
def test_yaml_blocks_load(block, panda):
    content = yaml.safe_load(block.text)
    if isinstance(content, list):
        assert Stack.from_yaml(block.text, robot_for(content, panda)).tasks
    elif 'joints' in content:
        assert Robot.from_dh(content).n == len(content['joints'])
    else:
        assert all('ros__parameters' in values for values in content.values()), \
            'neither a stack nor a DH table nor a parameter file'


@pytest.mark.parametrize('block', [block for block in blocks('yaml') if not block.file],
                         ids=identity)
def test_parameter_files_set_what_the_nodes_have(block):
    pytest.importorskip('rclpy')
    content = yaml.safe_load(block.text)
    for node, module in (('tp_controller', 'controller_node'), ('tp_simulator', 'simulator_node')):
        if isinstance(content, dict) and node in content:
            for name, value in content[node]['ros__parameters'].items():
                check_parameter(module, name, value)


def check_parameter(module, name, value):
    """Check that a node has a parameter, and that its type suits a value."""
    part = {'viewer_node': 'tools.view', 'teleop_node': 'tools.teleop'}.get(module, 'ros')
    specs = importlib.import_module(f'tp_controller.{part}.{module}').PARAMETERS
    defaults = {**EVERY_NODE, **{spec.name: spec.default for spec in specs}}
    if name.startswith(('limits', 'tasks')):
        return
    assert name in defaults, name
    if isinstance(defaults[name], (str, bool, int, float)):
        assert isinstance(value, type(defaults[name])), (name, value)
    if name in ('robot', 'stack') and isinstance(value, str) and '://tp_controller/' in value:
        assert find_file(value)


# Commands --------------------------------------------------------------------------------


@pytest.mark.parametrize('words', commands_of('tp_controller'))
def test_command_line_accepts(words):
    try:
        make_parser().parse_args(words[1:])
    except SystemExit as ended:
        assert not ended.code and words[-1] in ('--help', '--version')


def make_targets():
    """Return the targets of the Makefile that have a description."""
    text = (ROOT / 'Makefile').read_text(encoding='utf-8')
    return set(re.findall(r'^([a-z]+):.*##', text, re.MULTILINE))


@pytest.mark.parametrize('page', PAGES, ids=identity)
def test_make_targets_exist(page):
    text = page.read_text(encoding='utf-8')
    named = [words[1:] for block, words in commands()
             if block.page == page and words[0] == 'make']
    named += [shlex.split(line) for line in re.findall(r'`make ([^`]*)`', text)]
    for words in named:
        targets = [word for word in words if '=' not in word]
        assert set(targets) <= make_targets(), words


@pytest.mark.parametrize('words', commands_of('python'))
def test_python_scripts_exist(words):
    assert (ROOT / words[1]).is_file()


def test_every_other_command_is_known():
    known = {'tp_controller', 'make', 'python', 'ros2', *FOREIGN}
    assert {words[0] for _, words in commands()} <= known


def values_of(option, words):
    """Return the values of an option that may be given several times."""
    return [words[index + 1] for index, word in enumerate(words) if word == option]


def shared(path):
    """Return the file of this repository that a path in the installed package stands for."""
    assert path.startswith(SHARE), f'{path} is a file of a clone only'
    return ROOT / path.removeprefix(SHARE)


@pytest.mark.parametrize('words', [pytest.param(words, id=f'{block} {shlex.join(words)[:60]}')
                                   for block, words in commands()
                                   if words[0] in ('ros2', 'tp_controller')])
def test_commands_need_no_clone(words):
    values = {part for word in words for part in re.split(':=|=', word)}
    assert not {value for value in values if '/' in value and (ROOT / value).exists()}


@pytest.mark.parametrize('words', commands_of('ros2', 'run'))
def test_ros2_run_names_executables_and_parameters(words):
    assert words[2] == 'tp_controller' and words[3] in EXECUTABLES
    for file in values_of('--params-file', words):
        assert '/' not in file or shared(file).is_file()
    assignments = values_of('-p', words)
    if assignments:
        pytest.importorskip('rclpy')
    for assignment in assignments:
        name, _, value = assignment.partition(':=')
        check_parameter(words[3], name, yaml.safe_load(value))


@pytest.mark.parametrize('words', commands_of('ros2', 'launch'))
def test_ros2_launch_names_files_and_arguments(words, generate):
    assert words[2] == 'tp_controller'
    arguments = [argument.partition(':=')[0] for argument in words[4:]]
    assert (ROOT / 'launch' / words[3]).is_file()
    table = generate.launch_arguments(words[3].partition('.')[0])
    assert all(f'| `{argument}` |' in table for argument in arguments)


def blocks_until_ended(words):
    """Say whether a command runs until it is ended."""
    program, *rest = words
    if program == 'ros2':
        return rest[0] == 'launch' or rest[:2] == ['topic', 'echo'] \
            or (rest[:2] == ['topic', 'pub'] and not {'--once', '--times'} & set(rest)) \
            or (rest[0] == 'run' and rest[2].endswith('_node'))
    return (rest[0] == 'view' or rest[0] == 'status' and '--once' not in rest
            or rest[0] == 'record' and '--for' not in rest)


@pytest.mark.parametrize('block', sorted({block for block, _ in commands()}, key=str), ids=str)
def test_a_block_can_be_pasted_as_a_whole(block):
    lines = [words for other, words in commands() if other == block]
    waiting = [words for words in lines[:-1] if blocks_until_ended(words)]
    assert not waiting, 'what follows would not run'


def message_type(name):
    """Return a message or service type, as ROS tools do."""
    package, kind, last = name.split('/')
    return getattr(importlib.import_module(f'{package}.{kind}'), last)


def fill(message, values):
    """Set the fields of a message, as ROS tools do."""
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            kind = message.get_fields_and_field_types()[name]
            package, element = re.fullmatch(r'sequence<(\w+)/(\w+)>', kind).groups()
            made = message_type(f'{package}/msg/{element}')
            setattr(message, name, [fill(made(), each) for each in value])
        else:
            setattr(message, name, value)
    return message


def documented_tasks(panda):
    """Return the tasks of the stacks on the page about ROS, by name."""
    texts = [block.text for block in blocks('yaml') if block.page == DOCS / 'ros.md'
             and isinstance(yaml.safe_load(block.text), list)]
    texts.append((ROOT / 'config' / 'demo_stack.yaml').read_text(encoding='utf-8'))
    tasks = {}
    for text in reversed(texts):
        tasks.update(Stack.from_yaml(text, panda).tasks)
    return tasks


@pytest.mark.parametrize('words', commands_of('ros2', 'topic', 'pub'))
def test_ros2_topic_pub_sends_goals_that_tasks_take(words, panda):
    pytest.importorskip('rclpy')
    messages_of = importlib.import_module('tp_controller.ros.interface.goal_messages').messages_of
    rest = [word for index, word in enumerate(words[3:], 3)
            if not word.startswith('-') and words[index - 1] not in ('--rate', '-r', '--times')]
    topic, kind, values = rest
    name, last = re.fullmatch('/tp_controller/([a-z]+)/(goal|twist|obstacles|trajectory)',
                              topic).groups()
    task = documented_tasks(panda)[name]
    trajectories_of = importlib.import_module(
        'tp_controller.ros.interface.trajectory_messages').trajectories_of
    entry, = (entry for entry in (*messages_of(task), *trajectories_of(task))
              if entry.topic == last)
    assert message_type(kind) is entry.kind
    message = fill(entry.kind(), yaml.safe_load(values))
    if last == 'trajectory':
        assert [task.parse_goal(goal) for goal in entry.timed(message, task.goal_type).values]
        return
    if entry.parts is not None:
        for frame, goal in entry.parts(message):
            assert frame in ('', *panda.frame_names) and task.parse_goal(goal)
        return
    if entry.framed:
        assert message.header.frame_id in ('', *panda.frame_names)
    goal, feed_forward = entry.goal(message), entry.feed_forward(message)
    assert goal is not None or feed_forward is not None
    if goal is not None:
        task.parse_goal(goal)
    if feed_forward is not None:
        task.parse_feed_forward(feed_forward)


@pytest.mark.parametrize('words', commands_of('ros2', 'topic', 'info'))
def test_ros2_topic_info_is_about_commands_that_a_documented_node_publishes(words):
    default = 'velocity_controller/commands'
    remapped = {value.partition(':=')[2] for _, other in commands()
                for value in values_of('-r', other) if value.startswith(default)}
    assert words[-1].removeprefix('/') in {default, *remapped}


@pytest.mark.parametrize('words', commands_of('ros2', 'service', 'call'))
def test_ros2_service_call_names_services(words, panda, generate):
    pytest.importorskip('rclpy')
    name, kind, *values = words[3:]
    known = {topic: message for node in ('controller', 'simulator')
             for direction, topic, message, _ in generate.interfaces(node)
             if direction == 'service'}
    node, *task = name.strip('/').split('/')
    assert node in ('tp_controller', 'tp_simulator')
    if task[1:]:
        assert task[0] in documented_tasks(panda)
        task[0] = '<task>'
    assert known['/'.join(('~', *task))] == kind
    fill(message_type(kind).Request(), yaml.safe_load(values[0]) if values else {})


@pytest.mark.parametrize('words', commands_of('ros2', 'param'))
def test_ros2_param_names_parameters(words):
    pytest.importorskip('rclpy')
    assert words[3] in ('/tp_controller', '/tp_simulator')
    if words[2] == 'set':
        check_parameter('controller_node', words[4], yaml.safe_load(words[5]))


@pytest.mark.parametrize('words', commands_of('ros2', 'lifecycle', 'set'))
def test_ros2_lifecycle_names_transitions(words):
    assert words[3] == '/tp_controller'
    assert words[4] in ('configure', 'activate', 'deactivate', 'cleanup', 'shutdown')


@pytest.mark.parametrize('words', commands_of('ros2', 'action'))
def test_ros2_action_sends_goals_to_actions_of_drivers(words):
    verb, name, kind, goal = words[2:]
    package, part, _ = kind.split('/')
    assert (verb, part) == ('send_goal', 'action')
    assert name.startswith('/')
    assert not package.startswith('tp_')
    assert isinstance(yaml.safe_load(goal), dict)


def test_ros2_commands_are_all_looked_at():
    verbs = {tuple(words[1:3]) for _, words in commands() if words[0] == 'ros2'}
    verbs = {verb if verb[0] in ('topic', 'service', 'param') else verb[:1] for verb in verbs}
    assert verbs <= {('run',), ('launch',), ('topic', 'pub'), ('topic', 'echo'), ('topic', 'info'),
                     ('service', 'call'), ('param', 'set'), ('param', 'describe'),
                     ('param', 'list'), ('param', 'dump'), ('param', 'load'), ('control',),
                     ('action',), ('lifecycle',), ('security',), ('bag',)}


# Links and layout -------------------------------------------------------------------------


def anchors(page):
    """Return the anchors of the headings of a page."""
    lines, inside = [], False
    for line in page.read_text(encoding='utf-8').splitlines():
        inside ^= line.startswith(('```', '~~~'))
        if not inside and line.startswith('#'):
            lines.append(line.lstrip('#').strip().lower())
    return {re.sub(r'[^\w\- ]', '', line).replace(' ', '-') for line in lines}


@pytest.mark.parametrize('page', PAGES, ids=identity)
def test_links_and_images_lead_somewhere(page, generate):
    text = re.sub(r'```.*?```', '', page.read_text(encoding='utf-8'), flags=re.DOTALL)
    for link in LINK.findall(re.sub(r'`[^`\n]*`', '', text)):
        if '://' in link:
            continue
        path, _, anchor = link.partition('#')
        target = (page.parent / path).resolve() if path else page
        if target.parent == GENERATED:
            assert target.stem in generate.SITE_PAGES and not anchor, link
            continue
        assert target.exists() and ROOT in (target, *target.parents), link
        if anchor:
            assert anchor in anchors(target), link


def test_every_test_that_safety_names_is_there():
    text = (DOCS / 'safety.md').read_text(encoding='utf-8')
    named = set(re.findall(r'`(test_\w+)`', text))
    defined = {name for path in (ROOT / 'test').rglob('test_*.py')
               for name in re.findall(r'^def (test_\w+)', path.read_text(encoding='utf-8'),
                                      re.MULTILINE)}
    assert named and named <= defined, named - defined


def test_every_page_can_be_found_from_the_first():
    seen, to_read = set(), [ROOT / 'README.md']
    while to_read:
        page = to_read.pop()
        if page in seen:
            continue
        seen.add(page)
        if page.parent.name == 'generated':
            # On the site only.
            continue
        links = LINK.findall(page.read_text(encoding='utf-8'))
        to_read += [(page.parent / link.partition('#')[0]).resolve() for link in links
                    if link.partition('#')[0].endswith('.md') and '://' not in link]
    assert set(PAGES) - INCLUDING - {DOCS / 'index.md'} <= seen


def test_pictures_are_small():
    for picture in (DOCS / 'images').iterdir():
        # Films have a hundred pictures.
        limit = 2_000_000 if picture.suffix == '.webp' else 1_000_000
        assert picture.stat().st_size < limit, picture


def test_readme_comes_to_the_point():
    text = (ROOT / 'README.md').read_text(encoding='utf-8')
    first, = [block for block in blocks('bash') if block.page == ROOT / 'README.md'][:1]
    assert first.line <= 20
    assert text.index('](docs/images/') < text.index('```')
    assert text.count('\n') <= 120


def test_readme_begins_with_what_people_search_for_and_a_film():
    title, first, picture = (ROOT / 'README.md').read_text().split('\n\n')[:3]
    assert title == '# tp_controller' and 'differential inverse kinematics' in first
    film = re.fullmatch(r'!\[.+\]\((.+)\)', picture).group(1)
    with Image.open(ROOT / film) as opened:
        assert opened.is_animated
