# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Controllers and their goal topics in the graph of ROS."""

from rclpy.node import Node
from tp_controller.ros.client.goal_fields import TYPES
from tp_controller.ros.client.trajectory_fields import TRAJECTORY_TYPES

# {last part of a topic: message types}
TOPIC_TYPES = {'goal': TYPES, 'twist': TYPES, 'trajectory': TRAJECTORY_TYPES}


def goal_topics(node: Node, controller: str) -> dict[str, dict[str, type]]:
    """Return {task: {topic: message type}} of the goal topics of a controller."""
    prefix = f'/{controller}/'
    found: dict[str, dict[str, type]] = {}
    for topic, types in node.get_topic_names_and_types():
        name, _, last = topic.removeprefix(prefix).partition('/')
        kind = TOPIC_TYPES.get(last, {}).get(types[0])
        if topic.startswith(prefix) and kind is not None and node.count_subscribers(topic):
            found.setdefault(name, {})[last] = kind
    return found


def absence(names: str) -> str:
    """Return the error message for nodes, of some names or any, that are not running."""
    return (f'no node {f"{names} " if names else ""}with tasks is running (ROS_DOMAIN_ID and '
            "ROS_AUTOMATIC_DISCOVERY_RANGE must be the same as the controller's)")
