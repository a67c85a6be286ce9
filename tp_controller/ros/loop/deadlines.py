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

"""What publishers promise about their messages: how often they come, and that somebody lives."""

from rclpy.duration import Duration
from rclpy.event_handler import (
    QoSRequestedDeadlineMissedInfo,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.qos import LivelinessPolicy, QoSProfile, ReliabilityPolicy
from tp_controller.ros.log import Log
from tp_controller.ros.loop.loop_statistics import Figures

# After this receivers that request it are told that the process does not live any more [s].
LEASE_SECONDS = 0.5


def promise(deadline: float) -> QoSProfile:
    """
    Return what is promised to the receivers of commands, or of joint states.

    One that requests nothing gets the messages as from any publisher.

    Parameters
    ----------
    deadline : float
        Longest time between two messages [s]; 0: none is promised.

    """
    qos = QoSProfile(depth=10, liveliness=LivelinessPolicy.AUTOMATIC,
                     liveliness_lease_duration=Duration(seconds=LEASE_SECONDS))
    if deadline > 0.0:
        qos.deadline = Duration(seconds=deadline)
    return qos


def state_qos(deadline: float) -> QoSProfile:
    """Return what is requested of joint states: a deadline [s], unless it is 0."""
    # They need no repetition, and there may be several publishers in one cycle.
    qos = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
    if deadline > 0.0:
        qos.deadline = Duration(seconds=deadline)
    return qos


def state_events(deadline: float, figures: Figures, log: Log) -> SubscriptionEventCallbacks | None:
    """Return what counts missed deadlines, and says who cannot be heard; None without one."""
    if deadline <= 0.0:
        return None

    def missed(info: QoSRequestedDeadlineMissedInfo) -> None:
        figures.missed_deadlines = info.total_count
        log.warning(f'no joint state for {deadline:g} s (parameter state_deadline)', 'deadline')

    def incompatible(info: QoSRequestedIncompatibleQoSInfo) -> None:
        log.warning('a publisher of joint states is not heard: it offers no deadline of '
                    f'{deadline:g} s or less (parameter state_deadline)', 'no deadline')

    return SubscriptionEventCallbacks(deadline=missed, incompatible_qos=incompatible)
