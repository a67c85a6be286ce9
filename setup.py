# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

from glob import glob
import os
from pathlib import Path
import re
import runpy
import sys
import sysconfig

import setuptools
from setuptools import Extension, find_packages, setup

package_name = 'tp_controller'
executables = {
    'tp_controller': 'tp_controller.tools.cli.main:main',
    'controller_node': 'tp_controller.tools.cli.main:controller_node',
    'simulator_node': 'tp_controller.tools.cli.main:simulator_node',
    'watchdog_node': 'tp_controller.tools.cli.main:watchdog_node',
    'viewer_node': 'tp_controller.tools.cli.main:viewer_node',
    'teleop_node': 'tp_controller.tools.cli.main:teleop_node',
}
plots = ['matplotlib<4', 'Pillow']
# Recordings, written and read.
record = ['rosbags>=0.11,<0.12']
# The page in the browser; pycollada reads meshes in COLLADA (.dae).
view = ['viser>=1,<2', 'pycollada']
# Robots in xacro, and by name.
models = ['xacro', 'robot_descriptions']
docs = ['sphinx<10', 'myst-parser<6', 'furo<2027']
# What benchmarks/peers.py compares with; not placo and tsid, which need other Pinocchios.
peers = ['pin-pink', 'mink', 'daqp', 'embodik; python_version < "3.13"', 'roboplan-oink',
         'example-robot-data']

# A quick linter, and those of ament_flake8 and ament_pep257 with their plugins.
style = ['ruff<0.18', 'flake8<8', 'flake8-builtins<4', 'flake8-comprehensions<4',
         'flake8-import-order<0.20', 'flake8-quotes<4', 'pydocstyle<7']

# One build for every Python from 3.11 on: before it the limited API has no buffer protocol.
LIMITED = sys.version_info >= (3, 11) and not sysconfig.get_config_var('Py_GIL_DISABLED')
# The core is loaded only beside the sources that it was built from.
core = Path(__file__).resolve().parent / package_name / 'core'
sources = runpy.run_path(str(core / 'sources.py'))['digest'](core)
# It does no more than Python does in its place where there is no compiler, but faster.
extensions = [
    Extension(
        package_name + '.core.extension', [package_name + '/core/extension.cpp'],
        depends=sorted(glob(package_name + '/core/*.h')),
        # The same digits on every processor: no fused products.
        extra_compile_args=['-std=c++17', '-O3', '-ffp-contract=off', '-fno-math-errno',
                            '-fopenmp-simd', '-g0'],
        define_macros=[('SOURCES', f'{sources:#x}ULL'),
                       *([('Py_LIMITED_API', '0x030b0000')] if LIMITED else [])],
        py_limited_api=LIMITED, optional=True)]


# Sections of README.md whose commands need the files of the repository.
OF_THE_REPOSITORY = ('See it', 'With ROS 2', 'Documentation')


def description():
    """
    Return README.md for where there is no repository around it.

    Its links to other files and its picture would lead nowhere there, and an installed package
    has neither a Makefile nor a workspace.
    """
    # colcon may run a link to this file, in a folder that has no other of these.
    folder = os.path.dirname(os.path.realpath(__file__))
    with open(os.path.join(folder, 'README.md'), encoding='utf-8') as file:
        sections = re.split('^(?=## )', file.read(), flags=re.MULTILINE)
    text = ''.join(section for section in sections
                   if section.partition('\n')[0][3:] not in OF_THE_REPOSITORY)
    text = re.sub(r'`pip install \.` installs the library, which needs no ROS[^:]*',
                  'The library needs no ROS', text)
    file_beside = r'\((?!https?://)[^)]*\)'
    text = re.sub(rf'^!\[[^]]*\]{file_beside}\n+', '', text, flags=re.MULTILINE)
    return re.sub(rf'\[([^]]*)\]{file_beside}', r'\1', text).rstrip() + '\n'


def licence():
    """Return the licence: an SPDX expression where setuptools has a field for it (from 77 on)."""
    known = int(setuptools.__version__.partition('.')[0]) >= 77
    return dict.fromkeys(['license', 'license_expression'] if known else ['license'], 'Apache-2.0')


def shims():
    """
    Return scripts that stand where an installer puts no console scripts.

    colcon installs console scripts into lib/tp_controller (setup.cfg), where `ros2 run` looks for
    executables, but not into bin/, which a sourced workspace has on its PATH. pip puts them into
    bin/ only.
    """
    if {'bdist_wheel', 'sdist'} & set(sys.argv):
        return [(os.path.join('lib', package_name), sorted(glob('scripts/*')))]
    return [('bin', ['bin/tp_controller'])]


setup(
    name=package_name,
    version='0.3.0',
    packages=find_packages(exclude=['test*']),
    package_data={package_name: ['py.typed']},
    # An editable installation builds the core each time, which the Makefile does only once.
    ext_modules=[] if 'TP_CONTROLLER_KEEP_CORE' in os.environ else extensions,
    options={'bdist_wheel': {'py_limited_api': 'cp311'}} if LIMITED else {},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/config',
         glob('config/*.yaml') + glob('config/*.rviz') + glob('config/*.xml')),
        ('share/' + package_name + '/config/robots',
         glob('config/robots/*.yaml') + glob('config/robots/*.urdf')),
        ('share/' + package_name + '/config/teleop', glob('config/teleop/*.yaml')),
        ('share/' + package_name + '/launch', glob('launch/*.launch.py')),
        *shims(),
    ],
    install_requires=['setuptools', 'numpy<3', 'scipy<2', 'PyYAML<7', 'pin>=4,<5', 'coal>=3,<4',
                      'argcomplete'],
    extras_require={
        'ros': ['ros-jazzy-rclpy[fastrtps]', 'ros-jazzy-common-interfaces'],
        'peers': peers,
        'plots': plots,
        'models': models,
        'record': record,
        'view': view,
        'docs': docs,
        # playwright drives the Chromium that is there; it brings none.
        'test': [*plots, *models, *record, *view, 'dask[distributed]', *docs, 'pytest',
                 'pytest-xdist', 'hypothesis', 'playwright', 'example-robot-data', *style,
                 'mypy<2.5', 'types-PyYAML', 'catkin_pkg', 'setuptools>=70.1'],
    },
    python_requires='>=3.10',
    zip_safe=False,
    maintainer='tp_controller contributors',
    maintainer_email='maintainers@users.noreply.github.com',
    description='Prioritized velocity control of redundant robots',
    long_description=description(),
    long_description_content_type='text/markdown',
    **licence(),
    keywords=['robotics', 'ROS 2', 'task-priority control', 'redundancy resolution',
              'hierarchical inverse kinematics'],
    classifiers=[
        'Operating System :: POSIX :: Linux',
        'Programming Language :: C++',
        'Programming Language :: Python :: 3',
        'Topic :: Scientific/Engineering',
        'Typing :: Typed',
    ],
    entry_points={'console_scripts': [f'{name} = {target}'
                                      for name, target in executables.items()]},
)
