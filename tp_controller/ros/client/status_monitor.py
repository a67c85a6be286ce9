# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Monitor of the status of several controllers, or of all in the graph."""

from collections.abc import Callable, Collection
from functools import partial
import time

from tp_controller.ros.client.client import Client
from tp_controller.ros.client.received_status import subscribe_status
from tp_controller.ros.client.status import ControllerStatus, STATUS_TYPE

STATUS_SUFFIX = '/status'


class Watch:
    """
    Node that receives the status of controllers.

    Parameters
    ----------
    names : collection of str
        Names of controller nodes, with their namespaces; if empty, all that are found.
    clock : callable
        Returns a time [s].

    """

    def __init__(self, names: Collection[str] = (),
                 clock: Callable[[], float] = time.monotonic) -> None:
        self._names = [name.strip('/') for name in names]
        self._clock = clock
        self._client = Client(self._names[0]) if self._names else Client()
        self._received: dict[str, tuple[ControllerStatus, float]] = {}
        self._followed: set[str] = set()
        for name in self._names:
            self._follow(name)

    def __enter__(self) -> 'Watch':
        """Return the watch."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the client."""
        self._client.close()

    def wait(self, seconds: float) -> bool:
        """Wait until all named controllers, or any, have sent a status; return False otherwise."""
        return self._client.wait(self._complete, seconds)

    def listen(self, seconds: float) -> None:
        """Receive status messages for a time [s]."""
        self._client.wait(lambda: self._complete() and False, seconds)

    def missing(self) -> list[str]:
        """Return the named controllers without a received status."""
        return [name for name in self._names if name not in self._received]

    def statuses(self) -> dict[str, tuple[ControllerStatus, float]]:
        """Return {controller: (latest status, time since then [s])}."""
        now = self._clock()
        return {name: (status, now - arrived)
                for name, (status, arrived) in sorted(self._received.items())}

    def _complete(self) -> bool:
        """Find controllers if none are named; return whether all expected ones have sent."""
        if not self._names:
            for topic, types in self._client.node.get_topic_names_and_types():
                if topic.endswith(STATUS_SUFFIX) and types == [STATUS_TYPE]:
                    self._follow(topic.removesuffix(STATUS_SUFFIX).strip('/'))
        return bool(self._received) and not self.missing()

    def _follow(self, name: str) -> None:
        """Subscribe to the status of a controller."""
        if name not in self._followed:
            self._followed.add(name)
            subscribe_status(self._client.node, name, partial(self._on_status, name))

    def _on_status(self, name: str, status: ControllerStatus) -> None:
        """Store the latest status."""
        self._received[name] = status, self._clock()
