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

"""
References over time: a value and its velocity at every time.

Knots with times become a smooth curve (`curve`, `forms`); chunks of a stream are joined to one
reference without a jump in value, velocity or acceleration (`reference`, where to begin reading).
It imports the model's rotations and the errors only: no robot, no task, no clock.
"""
