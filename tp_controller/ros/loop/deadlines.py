# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Quality of service of commands and joint states: deadlines and liveliness."""

from rclpy.duration import Duration
from rclpy.event_handler import (
    QoSRequestedDeadlineMissedInfo,
    QoSRequestedIncompatibleQoSInfo,
    SubscriptionEventCallbacks,
)
from rclpy.qos import LivelinessPolicy, QoSProfile, ReliabilityPolicy
from tp_controller.ros.log import Log
from tp_controller.ros.loop.loop_statistics import Figures

# Lease duration of the liveliness: time after which subscribers that request it are notified [s].
LEASE_SECONDS = 0.5


def promise(deadline: float) -> QoSProfile:
    """
    Return the quality of service offered to subscribers of commands, or of joint states.

    Subscribers without a request receive the messages as from any publisher.

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
    """Return the requested quality of service of joint states, with a deadline [s] unless 0."""
    # Lost messages need not be repeated, and several publishers may send in one cycle.
    qos = QoSProfile(depth=20, reliability=ReliabilityPolicy.BEST_EFFORT)
    if deadline > 0.0:
        qos.deadline = Duration(seconds=deadline)
    return qos


def state_events(deadline: float, figures: Figures, log: Log) -> SubscriptionEventCallbacks | None:
    """Return callbacks that count missed deadlines and log incompatible publishers, if any."""
    if deadline <= 0.0:
        return None

    def missed(info: QoSRequestedDeadlineMissedInfo) -> None:
        figures.missed_deadlines = info.total_count
        log.warning(f'no joint state for {deadline:g} s (parameter state_deadline)', 'deadline')

    def incompatible(info: QoSRequestedIncompatibleQoSInfo) -> None:
        log.warning('incompatible QoS: a publisher of joint states offers no deadline of '
                    f'{deadline:g} s or less (parameter state_deadline); its messages are dropped',
                    'no deadline')

    return SubscriptionEventCallbacks(deadline=missed, incompatible_qos=incompatible)
