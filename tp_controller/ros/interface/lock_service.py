# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Service that locks the joint that has stopped the robot, or unlocks all joints."""

from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool
from tp_controller.control.reasons import listed
from tp_controller.ros.declarations.controller import LOCKED
from tp_controller.ros.interface.controlled_robot import ControlledRobot
from tp_controller.ros.parameters import names_in


class LockService:
    """
    Service ``~/lock``, which sets the parameter ``locked_joints``.

    Parameters
    ----------
    node : rclpy.node.Node
        Node of the service and the parameter.
    robot : callable
        Returns the robot under control, or None.
    absence : callable
        Returns the reason for which there is none.

    """

    def __init__(self, node: Node, robot: Callable[[], ControlledRobot | None],
                 absence: Callable[[], str]) -> None:
        self._node, self._robot, self._absence = node, robot, absence
        node.create_service(SetBool, '~/lock', self._on_call)

    def _on_call(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        """Lock the joint that does not follow, and go on; or unlock all joints."""
        response.success, response.message = self._lock() if request.data else self._unlock()
        return response

    def _lock(self) -> tuple[bool, str]:
        """Lock the joint that has stopped the robot, and go on; return success and a message."""
        robot = self._robot()
        if robot is None:
            return False, f'nothing locked: {self._absence()}'
        joint = robot.loop.stops.joint
        if not joint:
            names = listed(robot.controller.robot.velocity_names)
            return False, ('nothing locked: no joint that does not follow has stopped the robot; '
                           f'{LOCKED} locks joints by name: {names}')
        robot.note_locks()
        locked = self._locked()
        refusal = '' if joint in locked else self._set([*locked, joint])
        if refusal:
            return False, f'{joint} is not locked: {refusal}'
        reason = robot.go_on()
        return True, f'locked {joint}, ' + (f'but the robot does not move: {reason}' if reason
                                            else 'the others go on')

    def _unlock(self) -> tuple[bool, str]:
        """Unlock all joints, even without a robot; return success and a message."""
        robot = self._robot()
        if robot is not None:
            robot.note_locks()
        locked = self._locked()
        refusal = self._set(['']) if locked else ''
        if refusal:
            return False, f'nothing unlocked: {refusal}'
        return True, f'unlocked {", ".join(locked)}' if locked else 'no joint was locked'

    def _locked(self) -> list[str]:
        """Return the joints that the parameter names."""
        return names_in(self._node.get_parameter(LOCKED).value) or []

    def _set(self, names: Sequence[str]) -> str:
        """Set the parameter; return the reason for which it is refused, or an empty string."""
        result, = self._node.set_parameters([Parameter(LOCKED, value=list(names))])
        return '' if result.successful else str(result.reason)
