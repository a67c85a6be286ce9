# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
The package as others get it: metadata, wheel, and what `ros2 run` finds after `pip install`.

Nothing here needs a network; a ROS machine that lacks pip or a new setuptools skips the builds.
"""

import ast
import configparser
import importlib.metadata
import importlib.util
import os
from pathlib import Path
import re
import runpy
import shutil
import stat
import subprocess
import sys
import sysconfig
from xml.etree import ElementTree
import zipfile

from packaging.requirements import Requirement
import pytest
import setuptools
import yaml

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = 'tp_controller'
EXECUTABLES = {'tp_controller', 'controller_node', 'simulator_node', 'teleop_node',
               'viewer_node', 'watchdog_node'}
# What colcon needs of the tree.
BUILT = ('LICENSE', 'README.md', 'bin', 'config', 'launch', 'package.xml', 'pyproject.toml',
         'resource', 'scripts', 'setup.cfg', 'setup.py', PACKAGE)
# What a source distribution has besides.
SHIPPED = (*BUILT, '.ci', '.github', '.pre-commit-config.yaml', 'CHANGELOG.rst', 'CITATION.cff',
           'CONTRIBUTING.md', 'MANIFEST.in', 'Makefile', 'QUALITY_DECLARATION.md', 'RELEASING.md',
           'benchmarks', 'constraints.txt', 'docs', 'examples', 'rosdoc2.yaml', 'test')
# Files that are made here, and belong to no distribution.
MADE = shutil.ignore_patterns('__pycache__', '*.so', '_build', 'generated')

# Module: (requirement in setup.py, key in package.xml; None where rosdep has none).
# Every other module that is not Python's own is a ROS package.
THIRD_PARTY = {
    'PIL': ('Pillow', None),
    # Before Python 3.14, and from then on; rosbags brings it.
    'backports': ('rosbags', None),
    'compression': ('rosbags', None),
    'catkin_pkg': ('catkin_pkg', 'python3-catkin-pkg-modules'),
    'coal': ('coal', 'coal'),
    'distributed': ('dask', None),
    'example_robot_data': ('example-robot-data', None),
    'lz4': ('rosbags', None),
    'msgspec': ('viser', None),
    'hypothesis': ('hypothesis', 'python3-hypothesis'),
    'matplotlib': ('matplotlib', None),
    'mpl_toolkits': ('matplotlib', None),
    'numpy': ('numpy', 'python3-numpy'),
    # pytest brings it.
    'packaging': ('pytest', 'python3-pytest'),
    'pinocchio': ('pin', 'pinocchio'),
    'playwright': ('playwright', None),
    'pytest': ('pytest', 'python3-pytest'),
    'rosbags': ('rosbags', None),
    'trimesh': ('viser', None),
    'websockets': ('viser', None),
    'scipy': ('scipy', 'python3-scipy'),
    'argcomplete': ('argcomplete', 'python3-argcomplete'),
    'setuptools': ('setuptools', 'python3-setuptools'),
    'viser': ('viser', None),
    'xacro': ('xacro', 'xacro'),
    # What benchmarks/peers.py compares with; placo and tsid need environments of their own.
    'embodik': ('embodik', None),
    'mink': ('mink', None),
    'mujoco': ('mink', None),
    'pink': ('pin-pink', None),
    'placo': (None, None),
    # What benchmarks/jerk.py compares with, where it is installed.
    'ruckig': (None, None),
    'roboplan': ('roboplan-oink', None),
    'tsid': (None, None),
    'yaml': ('PyYAML', 'python3-yaml'),
    'zstandard': ('viser', None),
}
# Folders with libraries of their own.
BESIDE = ('ros', 'tools')
ROS_PACKAGE_OF_MODULE = {'tf2_ros': 'tf2_ros_py'}


def arguments_of_setup(folder):
    """Return the arguments of setup() in the setup.py of a folder."""
    arguments = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(setuptools, 'setup', arguments.update)
        runpy.run_path('setup.py')
    return arguments


@pytest.fixture(scope='module')
def metadata():
    """Return the arguments of setup()."""
    return arguments_of_setup(ROOT)


@pytest.fixture(scope='module')
def package_xml():
    """Return the root element of package.xml."""
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def imported_modules(folder):
    """Return the top-level names of other people's modules that a folder's files import."""
    files = sorted((ROOT / folder).rglob('*.py'))
    own = {PACKAGE, 'conftest', *(path.stem for path in files)}
    names = set()
    for path in files:
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.partition('.')[0])
    return names - own - set(sys.stdlib_module_names)


def requirements(metadata):
    """Return the names of all distributions that setup.py requires, with any extra."""
    wanted = [*metadata['install_requires'], *sum(metadata['extras_require'].values(), [])]
    return {re.match(r'[\w.-]+', requirement)[0] for requirement in wanted}


def dependencies(package_xml):
    """Return the names of all dependencies in package.xml."""
    return [element.text for element in package_xml if element.tag.endswith('depend')]


def test_package_xml_and_setup_py_agree(metadata, package_xml):
    for key in ('name', 'version', 'license'):
        assert metadata[key] == package_xml.findtext(key)
    maintainer = package_xml.find('maintainer')
    assert metadata['maintainer'] == maintainer.text
    assert metadata['maintainer_email'] == maintainer.get('email')
    assert f'{metadata["version"]} (' in (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')


# catkin_pkg calls a method of docutils that is obsolete.
@pytest.mark.filterwarnings('ignore:nodes.Node.traverse:DeprecationWarning')
def test_changelog_is_one_that_catkin_prepare_release_and_bloom_can_read():
    changelog = pytest.importorskip('catkin_pkg.changelog')
    package_version = pytest.importorskip('catkin_pkg.package_version')
    text = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
    forthcoming = package_version.get_forthcoming_label(text)
    if forthcoming:
        text = package_version.rename_section(text, forthcoming, '9.9.9 (2099-01-01)')
    read = changelog.populate_changelog_from_rst(changelog.Changelog(PACKAGE), text)
    headings = re.findall(r'^(\d+\.\d+\.\d+) \(', text, re.MULTILINE)
    assert [version for version, _, _ in read.foreach_version(reverse=True)] == headings
    for section in re.split(r'^\d+\.\d+\.\d+ \(', text, flags=re.MULTILINE)[1:]:
        assert section.count('\n* ') <= 60


def test_citation_names_this_version(metadata):
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert citation['cff-version'] == '1.2.0'
    assert citation['title'] == metadata['name']
    assert citation['version'] == metadata['version']
    assert citation['license'] == metadata['license']
    assert citation['keywords'] == metadata['keywords']
    assert citation['authors'] == [{'name': metadata['maintainer']}]


def test_package_xml_is_what_colcon_needs(package_xml):
    # A faulty one only warns there, and the folder is built as plain Python.
    assert package_xml.get('format') == '3'
    assert package_xml.findtext('export/build_type') == 'ament_python'
    names = dependencies(package_xml)
    assert sorted(names) == sorted(set(names))


def test_package_xml_is_valid():
    parse_package = pytest.importorskip('catkin_pkg.package').parse_package
    warnings = []
    package = parse_package(ROOT, warnings=warnings)
    package.validate(warnings=warnings)
    assert package.get_build_type() == 'ament_python'
    assert warnings == []


def test_nodes_and_commands_for_them_run_with_what_package_xml_names(package_xml):
    """The computer of a robot has no use for RViz and plots: they are no dependencies."""
    assert not {'rviz2', 'python3-matplotlib', 'python3-pil'} & {*dependencies(package_xml)}
    pytest.importorskip('rclpy')
    modules = [module for module, (name, key) in THIRD_PARTY.items() if name and key is None]
    assert {'matplotlib', 'PIL', 'viser'} <= {*modules}
    code = (f'import importlib, sys; sys.modules.update(dict.fromkeys({modules!r}))\n'
            'for name in ("ros.controller_node", "ros.simulator_node", "ros.watchdog_node", '
            '"ros.client.client", "tools.cli.main", "tools.demos.scenarios"):\n'
            '    importlib.import_module(f"tp_controller.{name}")')
    run(sys.executable, '-c', code, PYTHONPATH=python_path(ROOT))


def test_continuous_integration_runs_what_is_run_by_hand(metadata):
    workflow = yaml.safe_load((ROOT / '.github/workflows/ci.yml').read_text(encoding='utf-8'))
    jobs = workflow['jobs'].values()
    assert '.ci/run' in [step.get('run') for job in jobs for step in job['steps']]
    oldest = metadata['python_requires'].removeprefix('>=')
    assert oldest in workflow['jobs']['unit']['strategy']['matrix']['python']
    hooks = yaml.safe_load((ROOT / '.pre-commit-config.yaml').read_text(encoding='utf-8'))
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    for hook in hooks['repos'][0]['hooks']:
        assert f"@{hook['entry'].replace('.venv/bin', '$(BIN)')} .\n" in makefile
    for form in (ROOT / '.github' / 'ISSUE_TEMPLATE').glob('*.yml'):
        assert {'name', 'description', 'body'} <= {*yaml.safe_load(form.read_text('utf-8'))}


@pytest.mark.parametrize('folder', [PACKAGE, 'launch', 'test', 'benchmarks'])
def test_every_import_is_a_dependency(folder, metadata, package_xml):
    wanted, keys = requirements(metadata), dependencies(package_xml)
    for module in imported_modules(folder):
        requirement, key = THIRD_PARTY.get(
            module, (None, ROS_PACKAGE_OF_MODULE.get(module, module)))
        assert requirement is None or requirement in wanted, f'setup.py lacks {requirement}'
        assert key is None or key in keys, f'package.xml lacks {key}'


def test_library_needs_no_extra(metadata):
    needed = {THIRD_PARTY[module][0] for path in (ROOT / PACKAGE).glob('[a-z]*')
              for module in imported_modules(path.relative_to(ROOT))
              if path.is_dir() and path.name not in BESIDE}
    # Imported when a xacro is read, with an error that says how to install it.
    needed -= {'xacro'}
    assert needed <= {re.split('[<>=]', entry)[0] for entry in metadata['install_requires']}


def compiled_below(name):
    """Return the names of the distributions with compiled code of cmeel that one needs."""
    found, left = set(), [name]
    while left:
        distribution = importlib.metadata.distribution(left.pop())
        if 'cmeel' in (distribution.read_text('WHEEL') or '') or distribution.name == 'cmeel':
            found.add(distribution.name)
        left += [needed for requirement in distribution.requires or ()
                 if 'extra ==' not in requirement
                 and (needed := re.match(r'[\w.-]+', requirement)[0]) not in found
                 and needed.startswith(('cmeel', 'coal', 'eigenpy', 'lib'))]
    return found


def test_compiled_packages_have_an_upper_bound(metadata):
    bounded = {requirement.name for requirement in map(Requirement, metadata['install_requires'])
               if any(each.operator == '<' for each in requirement.specifier)}
    assert bounded >= {'numpy', 'scipy', 'pin', 'coal'}


def test_constraints_are_within_the_bounds_and_cover_what_pinocchio_needs(metadata):
    pytest.importorskip('cmeel', reason='Pinocchio does not come from PyPI here')
    pinned = [Requirement(line) for line in (ROOT / 'constraints.txt').read_text().splitlines()
              if not line.startswith('#')]
    versions = {each.name: next(iter(each.specifier)).version for each in pinned}
    assert versions.keys() >= compiled_below('pin') | compiled_below('coal')
    for requirement in map(Requirement, metadata['install_requires']):
        assert requirement.name not in versions \
            or versions[requirement.name] in requirement.specifier


def test_ros_is_an_extra(metadata):
    # An apt ROS has no such distributions, so pip would install a second one.
    assert not [name for name in metadata['install_requires'] if name.startswith('ros')]
    assert any(name.startswith('ros-jazzy-rclpy') for name in metadata['extras_require']['ros'])


def test_every_subpackage_is_shipped(metadata):
    folders = {path.parent.relative_to(ROOT) for path in (ROOT / PACKAGE).rglob('*.py')}
    assert {'.'.join(folder.parts) for folder in folders} == set(metadata['packages'])


def test_every_source_in_cpp_is_compiled(metadata):
    sources = [source for extension in metadata['ext_modules'] for source in extension.sources]
    assert sorted(sources) == sorted(str(path.relative_to(ROOT))
                                     for path in (ROOT / PACKAGE).rglob('*.cpp'))


def test_annotations_are_shipped_by_an_old_setuptools_too(metadata):
    # Only from 69 on, newer than on Ubuntu 24.04, does it take py.typed along by itself.
    assert metadata['package_data'] == {PACKAGE: ['py.typed']}


def test_executables_have_code_and_shims(metadata):
    scripts = dict(map(str.strip, line.split('='))
                   for line in metadata['entry_points']['console_scripts'])
    assert set(scripts) == EXECUTABLES
    assert {path.name for path in (ROOT / 'scripts').iterdir()} == EXECUTABLES
    assert all(os.access(path, os.X_OK) for path in (ROOT / 'scripts').iterdir())
    for target in scripts.values():
        module, _, function = target.partition(':')
        source = (ROOT / f'{module.replace(".", "/")}.py').read_text(encoding='utf-8')
        assert re.search(rf'^(def )?{function}\b', source, re.MULTILINE)


def test_colcon_puts_executables_where_ros2_run_looks():
    config = configparser.ConfigParser()
    config.read(ROOT / 'setup.cfg')
    assert config['install']['install_scripts'] == f'$base/lib/{PACKAGE}'
    assert config['develop']['script_dir'] == f'$base/lib/{PACKAGE}'


def test_a_sourced_workspace_has_the_command_on_its_path(metadata):
    # Neither pip nor a source distribution is told to install this one.
    assert ('bin', ['bin/tp_controller']) in metadata['data_files']
    assert os.access(ROOT / 'bin' / 'tp_controller', os.X_OK)


def test_the_command_of_a_workspace_runs_the_program_beside_it(tmp_path):
    for folder in ('bin', 'lib/tp_controller', 'elsewhere'):
        (tmp_path / folder).mkdir(parents=True)
    program = tmp_path / 'lib' / PACKAGE / 'tp_controller'
    program.write_text('#!/bin/sh\necho $$ "$#" "$2"\nexit 7\n')
    program.chmod(0o755)
    # As with `colcon build --symlink-install`.
    command = tmp_path / 'bin' / 'tp_controller'
    command.symlink_to(ROOT / 'bin' / 'tp_controller')
    child = subprocess.Popen(['tp_controller', 'one', 'two words'], stdout=subprocess.PIPE,
                             text=True, cwd=tmp_path / 'elsewhere',
                             env={'PATH': f'{command.parent}:/usr/bin:/bin'})
    said, _ = child.communicate(timeout=60)
    assert (said, child.returncode) == (f'{child.pid} 2 two words\n', 7)


def test_colcon_builds_a_workspace_in_which_the_command_is_found(tmp_path):
    if importlib.util.find_spec('colcon_ros') is None:
        pytest.skip('needs colcon')
    for name in BUILT:
        (tmp_path / 'src' / name).parent.mkdir(exist_ok=True)
        (tmp_path / 'src' / name).symlink_to(ROOT / name)
    said = run(sys.executable, '-m', 'colcon', '--log-base', tmp_path / 'log', 'build',
               '--base-paths', tmp_path / 'src', '--build-base', tmp_path / 'build',
               '--install-base', tmp_path / 'install', '--event-handlers', 'console_direct+')
    assert 'Finished <<< tp_controller' in said
    setup = tmp_path / 'install' / 'setup.bash'
    assert re.match(r'\d+\.\d+\.\d+, solver: \w+\n', run(
        'bash', '-c', f'source {setup} && tp_controller --version'))
    share = tmp_path / 'install' / PACKAGE / 'share' / PACKAGE
    assert {path.name for path in (share / 'launch').iterdir()} \
        == {'controller.launch.py', 'demo.launch.py', 'servo_compatible.launch.py'}


def child_environment(**changes):
    """Return the environment for a child; what the ROS wheels set is for this process only."""
    environment = dict(os.environ)
    if environment.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None):
        environment.pop('LD_LIBRARY_PATH', None)
    return {**environment, **changes}


def run(*command, **changes):
    """Run a command and return what it printed."""
    done = subprocess.run(list(map(str, command)), env=child_environment(**changes), cwd='/',
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=600)
    assert done.returncode == 0, done.stdout
    return done.stdout


def pip(*arguments, **changes):
    """Run pip without a network, in this very environment."""
    return run(sys.executable, '-m', 'pip', '--disable-pip-version-check', '--no-input',
               arguments[0], '--quiet', '--no-deps', '--no-index', *arguments[1:], **changes)


def build_sdist(source, target):
    """Return the folder of an unpacked source distribution."""
    run(sys.executable, '-c', 'import os, sys; os.chdir(sys.argv[1]); '
        'from setuptools import build_meta; build_meta.build_sdist(sys.argv[2])', source, target)
    archive, = target.glob('*.tar.gz')
    shutil.unpack_archive(archive, target)
    return target / archive.name[:-len('.tar.gz')]


@pytest.fixture(scope='module')
def unpacked(tmp_path_factory):
    """Return the folder of a source distribution of this tree."""
    pytest.importorskip('pip')
    if importlib.util.find_spec('setuptools.command.bdist_wheel') is None:
        pytest.importorskip('wheel', reason='setuptools is older than 70.1, and no wheel')
    folder = tmp_path_factory.mktemp('wheel')
    source = folder / 'source'
    source.mkdir()
    for name in SHIPPED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=MADE)
        elif (ROOT / name).exists():
            shutil.copy2(ROOT / name, source / name)
    return build_sdist(source, folder)


def files_of(folder):
    """Return the files in a folder, but for what is made there."""
    return {str(path.relative_to(folder)) for path in folder.rglob('*') if path.is_file()
            and not {'__pycache__', '_build', 'generated'} & set(path.parts)
            and path.suffix != '.so'}


def test_source_distribution_holds_all_that_its_tests_need(unpacked):
    assert {path.name for path in unpacked.iterdir()} >= {*SHIPPED}
    for folder in ('test', 'docs', 'examples', 'benchmarks', 'config', 'launch', PACKAGE):
        assert files_of(unpacked / folder) == files_of(ROOT / folder), folder


def test_tests_of_a_source_distribution_run(unpacked):
    # The links of the pages lead all over the tree.
    said = run(sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '-k', 'link',
               unpacked / 'test' / 'unit' / 'test_docs.py', PYTHONPATH=python_path(unpacked))
    assert re.search(r'^[1-9]\d* passed', said, re.MULTILINE)


def build_wheel(unpacked, folder, **changes):
    """Return a wheel, built from a source distribution."""
    pip('wheel', '--no-build-isolation', '--wheel-dir', folder, unpacked, **changes)
    result, = folder.glob('*.whl')
    return result


@pytest.fixture(scope='module')
def wheel(unpacked):
    """Return a wheel."""
    return build_wheel(unpacked, unpacked.parent)


@pytest.fixture(scope='module')
def prefix(wheel, tmp_path_factory):
    """Return the folder to which the wheel was installed."""
    folder = tmp_path_factory.mktemp('prefix')
    pip('install', '--ignore-installed', '--no-warn-script-location', '--prefix', folder, wheel)
    marker, = folder.rglob(f'share/ament_index/resource_index/packages/{PACKAGE}')
    return marker.parents[4]


@pytest.fixture(scope='module')
def site_packages(prefix):
    """Return the folder of the installed modules."""
    module, = prefix.rglob(f'*-packages/{PACKAGE}/__init__.py')
    return module.parents[1]


def test_wheel_holds_every_file(wheel):
    with zipfile.ZipFile(wheel) as archive:
        modes = {entry.filename.partition('.data/data/')[2] or entry.filename:
                 entry.external_attr >> 16 for entry in archive.infolist()}
    data = [path.relative_to(ROOT) for folder in ('config', 'launch')
            for path in (ROOT / folder).rglob('*.*') if path.suffix != '.pyc']
    assert {path.suffix for path in data} == {'.yaml', '.urdf', '.rviz', '.xml', '.py'}
    assert {f'share/{PACKAGE}/{path}' for path in data} <= set(modes)
    assert {f'share/{PACKAGE}/package.xml',
            f'share/ament_index/resource_index/packages/{PACKAGE}'} <= set(modes)
    sources = {str(path.relative_to(ROOT)) for path in (ROOT / PACKAGE).rglob('*.py')}
    assert sources == {name for name in modes if name.endswith('.py') and 'share/' not in name}
    assert f'{PACKAGE}/py.typed' in modes, 'type checkers would ignore the annotations'
    for name in EXECUTABLES:
        assert modes[f'lib/{PACKAGE}/{name}'] & stat.S_IXUSR


def test_wheel_says_what_the_package_is_without_links_to_what_is_not_there(wheel):
    with zipfile.ZipFile(wheel) as archive:
        file, = [name for name in archive.namelist() if name.endswith('.dist-info/METADATA')]
        header, _, text = archive.read(file).decode().replace('\r\n', '\n').partition('\n\n')
    assert 'Description-Content-Type: text/markdown' in header.splitlines()
    expression = int(setuptools.__version__.partition('.')[0]) >= 77
    assert f'License{"-Expression" * expression}: Apache-2.0' in header.splitlines()
    assert re.findall('^## (.*)', text, re.MULTILINE) == [
        'From Python', 'Measured', 'What it does not do']
    # Where it is read there is neither the repository nor a workspace.
    assert not re.search('make |colcon|rosdep|pip install [^ ]*[.]', text)
    assert all(link.startswith('https://') for link in re.findall(r'\]\((.*?)\)', text))


def test_setup_py_can_be_a_link(metadata, tmp_path):
    # As with `colcon build --symlink-install`, where README.md is not beside the link.
    (tmp_path / 'setup.py').symlink_to(ROOT / 'setup.py')
    assert arguments_of_setup(tmp_path)['long_description'] == metadata['long_description']


@pytest.mark.skipif(not any(map(shutil.which, ('c++', 'g++', 'clang++'))), reason='no compiler')
def test_wheel_holds_all_compiled_modules_for_all_later_versions_of_python(
        wheel, site_packages, metadata):
    with zipfile.ZipFile(wheel) as archive:
        built = [name for name in archive.namelist() if name.endswith('.so')]
    names = [extension.name.replace('.', '/') for extension in metadata['ext_modules']]
    assert sorted(name.partition('.')[0] for name in built) == sorted(names)
    if sys.version_info >= (3, 11) and not sysconfig.get_config_var('Py_GIL_DISABLED'):
        assert all(name.endswith('.abi3.so') for name in built) and '-cp311-abi3-' in wheel.name
        # As with the wheel for each kind of processor.
        run(sys.executable, '-I', '-S', ROOT / '.ci' / 'try_core.py', site_packages, *names)
    assert solver_of(site_packages) == 'compiled'


def test_package_installs_and_works_without_a_compiler(unpacked, tmp_path):
    # Without what was built in it before.
    tree = shutil.copytree(unpacked, tmp_path / 'tree', ignore=shutil.ignore_patterns('build'))
    wheel = build_wheel(tree, tmp_path, CC='false', CXX='false')
    with zipfile.ZipFile(wheel) as archive:
        assert not [name for name in archive.namelist() if name.endswith('.so')]
        archive.extractall(tmp_path / 'installed')
    assert solver_of(tmp_path / 'installed') == 'python'


def solver_of(folder):
    """Return which solver an installed library has, after it solved something."""
    code = ('import tp_controller\n'
            'from tp_controller.solver.compiled import running\n'
            'assert tp_controller.solve([([[2.0]], [1.0])]).velocity == [0.5]\n'
            'print(running(), tp_controller.__file__)')
    name, module = run(sys.executable, '-c', code, PYTHONPATH=python_path(folder),
                       TP_CONTROLLER_SOLVER='').split()
    assert Path(module).parents[1] == folder
    return name


def test_ros2_run_finds_the_executables(prefix, monkeypatch):
    # As `ros2 run` looks: executable files in lib/<package> of the prefix in the ament index.
    packages = pytest.importorskip('ament_index_python.packages')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    folder = Path(packages.get_package_prefix(PACKAGE)) / 'lib' / PACKAGE
    found = [path for path in folder.rglob('*') if os.access(path, os.X_OK) and path.is_file()]
    assert sorted(path.name for path in found) == sorted(EXECUTABLES)
    assert all((prefix / 'bin' / path.name).is_file() for path in found)


def test_documented_parameter_files_are_in_the_installed_package(prefix, tmp_path):
    pages = [path.read_text(encoding='utf-8') for path in (ROOT / 'docs').rglob('*.md')]
    blocks = re.findall(r'^```bash\n(ros2 run [^`]*share[^`]*)```$', '\n'.join(pages),
                        re.MULTILINE)
    assert len(blocks) >= 10
    # In place of ROS: the folder of the package, and a node that only opens its parameter files.
    (tmp_path / 'ros2').write_text(f"""#!/bin/sh
        if [ "$1" = pkg ]; then echo '{prefix}/share/{PACKAGE}'; exit; fi
        for word; do
          if [ "$before" = --params-file ]; then : < "$word" || exit 1; fi
          before=$word
        done
        """, encoding='utf-8')
    (tmp_path / 'ros2').chmod(0o755)
    run('bash', '-e', '-c', '\n'.join(blocks), PATH=f'{tmp_path}:{os.environ["PATH"]}')


def test_shim_runs_the_program_with_its_own_python(prefix, site_packages, tmp_path):
    # No activated environment: nothing on PATH but the system's shell tools.
    shim = prefix / 'lib' / PACKAGE / 'tp_controller'
    (tmp_path / 'link').symlink_to(prefix)
    for path in (shim, tmp_path / 'link' / shim.relative_to(prefix)):
        text = run(path, '--help', PATH='/usr/bin:/bin', PYTHONPATH=python_path(site_packages))
        assert 'usage: tp_controller' in text


def test_shim_leaves_signals_and_exit_code_to_the_program(prefix, tmp_path):
    # A launch file or `ros2 run` must reach the program itself, not a shell before it.
    for folder in ('bin', 'lib/tp_controller'):
        (tmp_path / folder).mkdir(parents=True)
    shim = tmp_path / 'lib' / PACKAGE / 'controller_node'
    shutil.copy2(prefix / 'lib' / PACKAGE / 'controller_node', shim)
    program = tmp_path / 'bin' / 'controller_node'
    program.write_text('#!/bin/sh\necho $$ "$#" "$2"\nexit 7\n')
    program.chmod(0o755)
    child = subprocess.Popen([shim, 'one', 'two words'], stdout=subprocess.PIPE, text=True)
    text, _ = child.communicate(timeout=60)
    assert text == f'{child.pid} 2 two words\n'
    assert child.returncode == 7


def python_path(*folders):
    """Return PYTHONPATH with these folders in front."""
    return os.pathsep.join([*map(str, folders), os.environ.get('PYTHONPATH', '')]).rstrip(':')


def test_installed_library_works_without_ros(site_packages, package_xml):
    ros = [name for name in dependencies(package_xml)
           if not name.startswith('python3-') and name not in ('pinocchio', 'coal')]
    code = (
        'import sys\n'
        f'sys.modules.update(dict.fromkeys({ros!r}))\n'  # importing these raises ImportError
        'import tp_controller\n'
        'from tp_controller.resources import find_file, package_share\n'
        'robot = tp_controller.Robot.from_file(\n'
        '    "package://tp_controller/config/robots/planar_3r.yaml")\n'
        'stack = tp_controller.Stack.from_yaml("- home: {type: posture}", robot)\n'
        'command = tp_controller.Controller(robot, stack).update(robot.neutral(), 0.0)\n'
        'print(len(command.velocity), package_share(), tp_controller.__file__, sep="\\n")\n')
    size, share, module = run(sys.executable, '-c', code, AMENT_PREFIX_PATH='',
                              PYTHONPATH=python_path(site_packages)).split()
    assert size == '3'
    assert Path(module).parents[1] == site_packages
    assert Path(share).parts[-2:] == ('share', PACKAGE)
    assert (Path(share) / 'package.xml').is_file()
