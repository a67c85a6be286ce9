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

"""A check without ROS knows the parameters that the node has."""

from tp_controller.ros.interface.controller_parameters import PARAMETERS
from tp_controller.tools.check.parameter_file import (
    CHECKED_PARAMETERS,
    NODE_PARAMETERS,
    RATE,
    STATE_TIMEOUT,
)


def test_a_check_knows_every_parameter_of_the_controller():
    names = {spec.name for spec in PARAMETERS}
    assert {*CHECKED_PARAMETERS, *NODE_PARAMETERS} == names | {'use_sim_time'}
    assert not set(CHECKED_PARAMETERS) & set(NODE_PARAMETERS)


def test_a_check_has_the_defaults_of_the_controller():
    defaults = {spec.name: spec.default for spec in PARAMETERS}
    assert (RATE, STATE_TIMEOUT) == (defaults['rate'], defaults['state_timeout'])
