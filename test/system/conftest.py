# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Fixtures of the tests that run whole processes."""

from importlib.util import find_spec
import os
import warnings

from processes_harness import Listener
import pytest
from robots import PLANAR_DH, REPOSITORY

STACK = '[{swing: {type: joint, joints: [joint1, joint2, joint3], target: [1, 1, 1]}}]'


# By default a participant that was missed at first is heard of again after 3 s only.
DISCOVERY = """<?xml version="1.0" encoding="UTF-8"?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <participant profile_name="often" is_default_profile="true">
    <rtps><builtin><discovery_config>
      <leaseAnnouncement><sec>0</sec><nanosec>100000000</nanosec></leaseAnnouncement>
    </discovery_config></builtin></rtps>
  </participant>
</profiles>
"""


@pytest.fixture(scope='session')
def environment():
    """Return the environment of a user's shell in which the package can be imported."""
    paths = [str(REPOSITORY), *filter(None, [os.environ.get('PYTHONPATH')])]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(paths)}


@pytest.fixture(scope='module')
def domain(environment, tmp_path_factory):
    """Return the environment of processes that hear each other, soon, and nobody else."""
    if find_spec('rclpy') is None:
        pytest.skip('needs ROS 2')
    with warnings.catch_warnings():
        # The generator of the messages' Python code has a dependency that is behind the times.
        warnings.filterwarnings('ignore', "module 'sre_", DeprecationWarning)
        import rosidl_generator_py  # noqa: F401
    from tp_controller.demos.processes import own_domain
    profiles = tmp_path_factory.mktemp('discovery') / 'profiles.xml'
    profiles.write_text(DISCOVERY)
    with own_domain() as given, pytest.MonkeyPatch.context() as patch:
        own = {name: given[name] for name in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')}
        own['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(profiles)
        for name, value in own.items():
            patch.setenv(name, value)
        yield {**environment, **own}


@pytest.fixture
def listener(domain):
    """Return a listener in the domain."""
    listener = Listener()
    yield listener
    listener.client.close()


@pytest.fixture
def start(domain, tmp_path):
    """Return what starts a node with the planar arm, or another; all are ended at last."""
    from tp_controller.demos.processes import NodeProcess
    nodes = []

    def start(executable, *arguments, robot=PLANAR_DH):
        if robot is not None:
            arguments = ('-p', f'robot:={robot}', *arguments)
        nodes.append(NodeProcess(executable, list(arguments), domain,
                                 tmp_path / f'{executable}{len(nodes)}.log'))
        return nodes[-1]

    yield start
    for node in nodes:
        node.stop()


@pytest.fixture
def cell(start, listener):
    """Return controller and simulator of the planar arm, on its way."""
    nodes = (start('controller_node', '-p', f"stack:='{STACK}'"), start('simulator_node'))
    listener.wait(listener.moving, 'motion', nodes)
    return nodes
