# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Service that tells where the goals in force lead, without a motion."""

import json

from rclpy.node import Node
from std_srvs.srv import Trigger
from tp_controller.errors import in_words
from tp_controller.positions.solution import PositionSolution
from tp_controller.positions.solve_position import PositionSolver
from tp_controller.ros.loop.shared_controller import SharedController

# Time of a search: so short that other services need not wait for long [s].
SEARCH_SECONDS = 0.1
NO_POSITIONS = 'no joint positions yet'


class PositionService:
    """
    Service ``~/solve_position``: the configuration at which the goals in force are reached.

    It copies the tasks, and searches from the present configuration, beside the loop.

    Parameters
    ----------
    node : rclpy.node.Node
        Node of the service.
    controller : SharedController
        Controller with the stack and its goals.

    """

    def __init__(self, node: Node, controller: SharedController) -> None:
        self._node, self._controller = node, controller
        self._service = node.create_service(Trigger, '~/solve_position', self._on_call)

    def close(self) -> None:
        """Close the service."""
        self._node.destroy_service(self._service)

    def _on_call(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Search; `success` tells whether all goals are reached, `message` is JSON."""
        controller = self._controller
        place = controller.configuration()
        if place is None:
            response.success, response.message = False, NO_POSITIONS
            return response
        q, passive = place
        try:
            with controller.mutex:
                solver = PositionSolver(controller.robot, controller.stack, controller.locked, q)
            found = solver.solve(start=q, passive=passive, timeout=SEARCH_SECONDS)
            response.success, response.message = found.reached, self._text(found)
        except Exception as error:
            response.success, response.message = False, in_words(error)
        return response

    def _text(self, found: PositionSolution) -> str:
        """Return the configuration, and the reasons of tasks that miss their goals, as JSON."""
        names = self._controller.robot.coordinate_names
        return json.dumps({
            'q': dict(zip(names, found.q.tolist())),
            'reasons': {task.name: task.reason for task in found.tasks if task.reason}})
