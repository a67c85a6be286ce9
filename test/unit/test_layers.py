# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The architecture: imports run one way, no ROS in the method, one version, documented names."""

import ast
import importlib
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest
import robots
import tp_controller

PACKAGE = robots.REPOSITORY / 'tp_controller'
TESTS = robots.REPOSITORY / 'test'
# Files of tests in folders that mirror those of the package.
MIRRORS = [path.relative_to(TESTS).as_posix() for wing in ('unit', 'ros')
           for path in sorted((TESTS / wing).glob('*/**/test_*.py'))]
# Parts of the library, lowest first: each imports only itself and those before it. `root` are the
# modules beside the parts, `package` is what `import tp_controller` gives.
LIBRARY = ('core', 'solver', 'untrusted', 'root', 'model', 'references', 'tasks', 'control',
           'positions', 'package')
# Parts of the wings, and what each imports besides itself and the library.
WINGS = {
    'ros.declarations': (),
    'ros': ('ros.declarations',),
    'ros.loop': ('ros', 'ros.declarations'),
    'ros.interface': ('ros', 'ros.declarations', 'ros.loop'),
    'ros.client': ('ros', 'ros.declarations', 'ros.loop'),
    'ros.nodes': ('ros', 'ros.declarations', 'ros.loop', 'ros.interface'),
    'tools': (),
    'tools.plots': ('tools',),
    'tools.check': ('tools', 'ros.declarations'),
    'tools.recording': ('tools', 'tools.plots', 'ros', 'ros.client'),
    'tools.view': ('tools', 'tools.recording', 'ros', 'ros.client'),
    'tools.teleop': ('tools', 'ros.declarations', 'ros', 'ros.client'),
    'tools.demos': ('tools', 'tools.plots', 'tools.check', 'tools.recording', 'tools.view',
                    'ros', 'ros.client'),
    'tools.cli': ('tools', 'tools.plots', 'tools.check', 'tools.recording', 'tools.view',
                  'tools.teleop', 'tools.demos', 'ros', 'ros.client'),
    'start': ('tools.cli',),
}
# Reader of the status, which recordings need without ROS.
READER = 'ros.client.status'
SPEAK_ROS = ('ros', 'tools.view', 'tools.teleop', 'tools.recording', 'tools.demos')
# What the library may use: the standard library and these. ROS only says where packages are.
LIBRARIES = {'numpy', 'scipy', 'pinocchio', 'coal', 'yaml', 'tp_controller'}
OPTIONAL = {('resources', 'ament_index_python'), ('model.xacro_files', 'xacro')}
# Lines of a module, with its licence, and of a class, with its docstrings.
LONGEST, LONGEST_CLASS = 450, 300


def module_name(path):
    """Return the name of a module below the package, '' for the package itself."""
    parts = path.relative_to(PACKAGE).with_suffix('').parts
    return '.'.join(part for part in parts if part != '__init__')


MODULES = {module_name(path): path for path in sorted(PACKAGE.rglob('*.py'))}


def test_no_module_is_longer_than_can_be_read():
    assert max(len(path.read_text(encoding='utf-8').splitlines())
               for path in MODULES.values()) <= LONGEST


@pytest.mark.slow
def test_no_class_is_longer_than_can_be_read():
    long = {node.name: node.end_lineno - node.lineno + 1 for path in MODULES.values()
            for node in ast.walk(ast.parse(path.read_text(encoding='utf-8')))
            if isinstance(node, ast.ClassDef)
            and node.end_lineno - node.lineno >= LONGEST_CLASS}
    assert not long


def part(module):
    """Return the part of a module, by its name below the package; fail if it has none."""
    first, *rest = module.split('.')
    if module in ('', '__main__'):
        return 'start' if module else 'package'
    if first == 'ros' and len(rest) == 1 and rest[0].endswith('_node'):
        return 'ros.nodes'
    found = f'{first}.{rest[0]}' if rest and f'{first}.{rest[0]}' in WINGS else first
    if found in WINGS or found in LIBRARY:
        # Parts have no folders, and a wing has those above only.
        assert len(rest) <= found.count('.') + 1, f'{module} is in a folder that is no part'
        return found
    assert not rest, f'{module} is in a folder that is no part'
    return 'root'


METHOD = [name for name in MODULES if part(name) in LIBRARY]


def imported(path):
    """Return the absolute names of all modules that a file imports, wherever it does."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            found.add(node.module)
            # `from package import module` names a module too.
            found.update(f'{node.module}.{alias.name}' for alias in node.names
                         if (PACKAGE.parent / node.module.replace('.', '/') / f'{alias.name}.py'
                             ).is_file())
    return found


def own_imports(name):
    """Return the modules of the package that a module imports, named below the package."""
    found = {module.partition('.')[2] for module in imported(MODULES[name])
             if module.split('.')[0] == 'tp_controller'}
    # A name that a module defines is imported from the module.
    return {module if module in MODULES else module.rpartition('.')[0] for module in found}


def named(name):
    """Return how a module is called in the names of tests."""
    return name or 'tp_controller'


def test_every_part_has_modules_and_every_module_a_part():
    assert {part(name) for name in MODULES} == {*LIBRARY, *WINGS}


@pytest.mark.slow
@pytest.mark.parametrize('name', MODULES, ids=named)
def test_module_imports_only_from_its_part_and_those_below(name):
    own = part(name)
    allowed = LIBRARY[:LIBRARY.index(own) + 1] if own in LIBRARY \
        else (*LIBRARY, own, *WINGS[own])
    assert {part(module) for module in own_imports(name)} <= set(allowed)


@pytest.mark.parametrize('name', ['ros.loop.loops.fast', 'tools.games.chess', 'extra.module'])
def test_a_module_in_no_part_is_noticed(name):
    with pytest.raises(AssertionError, match='is in a folder that is no part'):
        part(name)


@pytest.mark.parametrize('folder', sorted({path.parent for path in MODULES.values()}),
                         ids=lambda folder: folder.name)
def test_every_folder_says_what_is_in_it(folder):
    assert ast.get_docstring(ast.parse((folder / '__init__.py').read_text(encoding='utf-8')))


def modules_of(file):
    """Return the modules that a file of tests may be about, by its name below the tests."""
    wing, *folders, name = Path(file).with_suffix('').parts
    if wing == 'ros' and folders[0] != 'tools':
        folders = ['ros', *folders]
    return [path.stem for path in PACKAGE.joinpath(*folders).glob('*.py')
            if f'{name}_'.startswith(f'test_{path.stem}_')]


@pytest.mark.parametrize('file', MIRRORS)
def test_file_of_tests_in_a_folder_has_the_name_of_a_module_there(file):
    assert modules_of(file)


@pytest.mark.parametrize(('file', 'modules'), [
    ('unit/solver/test_solve.py', ['solve']), ('unit/solver/test_solve_rows.py', ['solve']),
    ('ros/loop/test_clocks.py', ['clocks']), ('ros/tools/view/test_page.py', ['page']),
    ('unit/solver/test_solver.py', []), ('unit/physics/test_solve.py', [])])
def test_file_of_tests_without_a_module_is_noticed(file, modules):
    assert modules_of(file) == modules


@pytest.mark.slow
def test_no_module_needs_itself_to_be_imported():
    # Peeling off, again and again, what imports nothing that is left leaves the circles.
    left = {name: own_imports(name) - {name} for name in MODULES}
    while left:
        free = [name for name, needed in left.items() if not needed & set(left)]
        assert free, f'these import each other in a circle: {sorted(left)}'
        for name in free:
            del left[name]


@pytest.mark.parametrize('name', METHOD, ids=named)
def test_method_uses_its_libraries_and_nothing_of_ros(name):
    for module in imported(MODULES[name]):
        top = module.split('.')[0]
        assert top in sys.stdlib_module_names | LIBRARIES or (name, top) in OPTIONAL, module


@pytest.mark.slow
def test_only_the_nodes_and_tools_beside_them_speak_ros():
    for name, path in MODULES.items():
        speaks = part(name).startswith(SPEAK_ROS) and part(name) != 'ros.declarations'
        for module in () if speaks else imported(path):
            top = module.split('.')[0]
            assert top != 'rclpy' and not top.endswith(('_msgs', '_srvs', '_interfaces')), path


def test_a_recorded_status_is_read_without_ros():
    for module in (READER, *own_imports(READER)):
        for name in imported(MODULES[module]):
            top = name.split('.')[0]
            assert top in sys.stdlib_module_names or top == 'tp_controller', (module, name)


@pytest.mark.slow
def test_only_one_module_uses_private_parts_of_rclpy():
    used = set()
    for name, path in MODULES.items():
        nodes = list(ast.walk(ast.parse(path.read_text(encoding='utf-8'))))
        private = {node.attr for node in nodes if isinstance(node, ast.Attribute)} & {
            '_parameter_overrides', '_parameters', '_service_change_state'}
        modules = [f'{node.module}.{alias.name}' for node in nodes
                   if isinstance(node, ast.ImportFrom) for alias in node.names]
        if private or any(module.startswith('rclpy.') and '._' in module for module in modules):
            used.add(name)
    assert used == {'ros.rclpy_internals'}


def test_importing_the_package_leaves_ros_alone():
    program = ('import sys; sys.modules["rclpy"] = None; import tp_controller; '
               'print([name for name in sys.modules if name.split(".")[0].endswith("_msgs")])')
    done = subprocess.run([sys.executable, '-c', program], cwd=robots.REPOSITORY, check=True,
                          capture_output=True, text=True)
    assert done.stdout.strip() == '[]'


def test_package_has_one_version():
    xml = ElementTree.parse(robots.REPOSITORY / 'package.xml').getroot()
    setup = (robots.REPOSITORY / 'setup.py').read_text(encoding='utf-8')
    version, = re.findall(r"version='([^']*)'", setup)
    assert xml.findtext('version') == version
    assert xml.findtext('name') == 'tp_controller'


def test_public_names_exist_and_are_documented():
    assert len(set(tp_controller.__all__)) == len(tp_controller.__all__)
    for name in tp_controller.__all__:
        documentation = getattr(tp_controller, name).__doc__
        # A dataclass without a docstring gets its signature as one.
        assert documentation and not documentation.startswith(f'{name}('), name


def test_public_names_come_from_where_type_checkers_look_for_them():
    tree = ast.parse((PACKAGE / '__init__.py').read_text(encoding='utf-8'))
    block, = (node for node in tree.body if isinstance(node, ast.If))
    told = {alias.name: node.module for node in block.body for alias in node.names}
    assert set(told) == set(tp_controller.__all__)
    for name, module in told.items():
        assert getattr(tp_controller, name) is getattr(importlib.import_module(module), name)


@pytest.mark.slow
def test_the_package_loads_what_is_used_and_names_what_there_is():
    done = subprocess.run(
        [sys.executable, '-c', 'import sys, tp_controller; print(*dir(tp_controller)); '
         'assert not {"numpy", "scipy", "pinocchio"} & set(sys.modules); '
         'tp_controller.errors; tp_controller.GoalError; '
         'assert not {"scipy", "pinocchio"} & set(sys.modules); '
         'assert tp_controller.solve([([[1.0]], [2.0])]).velocity == [2.0]'],
        capture_output=True, text=True, cwd=robots.REPOSITORY)
    assert done.returncode == 0, done.stderr
    assert {*tp_controller.__all__, 'errors', 'tasks'} <= set(done.stdout.split())
    with pytest.raises(AttributeError, match="no attribute 'Wheel'"):
        tp_controller.Wheel


@pytest.mark.parametrize('name', METHOD, ids=named)
def test_public_functions_classes_and_methods_say_what_they_do(name):
    tree = ast.parse(MODULES[name].read_text(encoding='utf-8'))
    assert ast.get_docstring(tree)
    classes = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    for node in [*tree.body, *(member for each in classes for member in each.body)]:
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith('__'):
            setter = any(isinstance(decorator, ast.Attribute) and decorator.attr == 'setter'
                         for decorator in node.decorator_list)
            assert setter or ast.get_docstring(node), node.name


def test_all_errors_share_one_base():
    for name in tp_controller.__all__:
        member = getattr(tp_controller, name)
        if isinstance(member, type) and issubclass(member, Exception):
            assert issubclass(member, tp_controller.TpControllerError)


@pytest.mark.slow
def test_page_about_tests_names_tests_that_exist():
    page = (robots.REPOSITORY / 'docs' / 'testing.md').read_text(encoding='utf-8')
    named = set(re.findall(r'`(test_\w+)`', page))
    assert len(named) > 5
    assert named <= {node.name for path in Path(__file__).parent.rglob('test_*.py')
                     for node in ast.parse(path.read_text(encoding='utf-8')).body
                     if isinstance(node, ast.FunctionDef)}


@pytest.mark.slow
def test_tests_here_need_no_ros():
    for path in sorted(Path(__file__).parent.rglob('*.py')):
        for module in imported(path):
            top = module.split('.')[0]
            assert top != 'rclpy' and not top.endswith('_msgs'), path
            assert not module.startswith('tp_controller.ros') \
                or module == f'tp_controller.{READER}', path


@pytest.mark.slow
def test_only_solids_and_their_distances_know_the_collision_library():
    assert [name for name in METHOD if 'coal' in imported(MODULES[name])] == [
        'model.clearance', 'model.solids', 'model.urdf_solids']
