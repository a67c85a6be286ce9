# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Node that shows a running controller on a page in the browser."""

from collections.abc import Sequence
from functools import partial
import sys
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.parameter import Parameter
from tp_controller.ros.client.client import Client
from tp_controller.ros.parameters import declare, keep_fixed, Spec, warn_unknown
from tp_controller.ros.runner import ClosableNode, run
from tp_controller.tools.view.link import Link
from tp_controller.tools.view.page import Page, RATE
from tp_controller.tools.view.server import address, exposure, LOCAL, open_server

NAME, CONCLUSION = 'tp_viewer', 'conclusion'
PARAMETERS = (
    Spec('controller', 'tp_controller', 'name of the controller node, with its namespace',
         fixed=True),
    Spec('host', LOCAL, 'address that the page is shown at; whoever can reach it can move the '
         'robot', fixed=True),
    Spec(CONCLUSION, '', 'text that is shown once a demo has finished, in place of the state of '
         'the controller; its first line is a title'),
    Spec('port', 0, 'port of the page (0: the first that is free from 8080 on)', fixed=True),
)


class ViewerNode(ClosableNode):
    """Node of the page."""

    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        values = declare(self, PARAMETERS)
        self._client = Client(values['controller'], self.context)
        self._server = open_server(values['host'], values['port'])
        warning = exposure(values['host'])
        if warning:
            self.get_logger().warning(warning)
        self.get_logger().info(f'the page is at {address(self._server)}')
        self._page = Page(self._server, Link(self._client))
        self.create_timer(1.0 / RATE, self._page.update,
                          clock=Clock(clock_type=ClockType.STEADY_TIME))
        keep_fixed(self)
        self.add_post_set_parameters_callback(self._on_parameters)
        warn_unknown(self)

    def _on_parameters(self, parameters: Sequence[Parameter]) -> None:
        """Show the conclusion of a demo."""
        for parameter in parameters:
            if parameter.name == CONCLUSION and parameter.value:
                self._page.conclude(parameter.value)

    def close(self, reason: str) -> None:
        """Close the page."""
        self._server.stop()
        self._client.close()


main = partial(run, ViewerNode, NAME)

if __name__ == '__main__':
    sys.exit(main())
