# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Parameters of a controller, and of other nodes, read and set from outside."""

from collections.abc import Iterable

from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.parameter import Parameter
from tp_controller.errors import GoalError
from tp_controller.ros.client.client import Client
from tp_controller.ros.client.graph import absence


def set_parameter(client: Client, node: str, name: str, value: object, wait: float) -> bool:
    """
    Set a parameter of any node.

    Parameters
    ----------
    client : Client
        Client that calls the node.
    node, name : str
        Names of the node and of its parameter.
    value : object
        New value.
    wait : float
        Timeout for the node, and for its answer [s].

    Returns
    -------
    bool
        True if the node has accepted it.

    """
    service = client.node.create_client(SetParameters, f'/{node}/set_parameters')
    if not client.wait(service.service_is_ready, wait):
        return False
    future = service.call_async(SetParameters.Request(
        parameters=[Parameter(name, value=value).to_parameter_msg()]))
    return client.wait(future.done, wait) and future.result().results[0].successful


def revolute(client: Client, joints: Iterable[str], wait: float = 10.0) -> set[str]:
    """
    Return the revolute ones of some joints of a controller; the others are prismatic.

    Parameters
    ----------
    client : Client
        Client of the controller.
    joints : iterable of str
        Driven joints.
    wait : float
        Timeout for the controller [s].

    Raises
    ------
    GoalError
        The controller does not answer, or lacks some of these joints.

    """
    names = list(joints)
    service = client.node.create_client(DescribeParameters,
                                        f'/{client.controller}/describe_parameters')
    if not client.wait(service.service_is_ready, wait):
        raise GoalError(absence(f'/{client.controller}'))
    # The description of a limit contains its unit.
    future = service.call_async(DescribeParameters.Request(
        names=[f'limits.{name}.lower' for name in names]))
    client.wait(future.done, wait)
    found = future.result().descriptors if future.done() else []
    if len(found) < len(names):
        raise GoalError('cannot tell which joints turn: the controller has not all of '
                        f'{", ".join(names)}')
    return {name for name, limit in zip(names, found) if limit.description.endswith('[rad]')}
