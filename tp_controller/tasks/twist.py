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

"""Desired velocity of a frame (slides (1)-(5): linear and angular velocity of a link)."""

from tp_controller.tasks.frame import FrameTask
from tp_controller.tasks.velocity import VelocityTask


class Twist(VelocityTask, FrameTask):
    """
    Move a frame with a desired velocity, linear and angular (slides (1)-(5)).

    The goal is a twist (6,), linear then angular [m/s, rad/s], in the axes of the reference
    frame. After a timeout the demand is zero.
    """

    type_name = 'twist'
    without = ('approach', 'gain', 'tolerance')
    example = {'frame': 'panda_hand_tcp'}
    make_twin = FrameTask.twin_of_velocity
    sketch_parts = {'frame': True}
