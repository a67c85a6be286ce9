# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Buffers of the page: they are written while the thread of the server reads them."""

import threading

import pytest

pytest.importorskip('viser', reason="needs pip install '.[view]'")

from tp_controller.tools.view.server import LOCAL, open_server, unused_port  # noqa: E402


class Changing:
    """Those who wait for an event, in a row that another thread changes meanwhile."""

    def __init__(self, waiters):
        self._waiters, self._thread = waiters, threading.get_ident()

    def __iter__(self):
        if threading.get_ident() == self._thread:
            raise RuntimeError('deque mutated during iteration')
        return iter(self._waiters)

    def __getattr__(self, name):
        return getattr(self._waiters, name)


def test_a_write_goes_well_while_the_server_changes_what_waits_for_it():
    server = open_server(LOCAL, unused_port())
    try:
        event = server._websock_server._broadcast_buffer.message_event
        event._waiters = Changing(event._waiters)
        event.clear()
        text = server.gui.add_html('before')
        text.content = 'after'
        assert text.content == 'after'
    finally:
        server.stop()


def test_what_waits_is_woken_on_the_thread_of_the_server():
    server = open_server(LOCAL, unused_port())
    try:
        buffer = server._websock_server._broadcast_buffer
        woken = threading.Event()

        async def wait():
            await buffer.message_event.wait()
            woken.set()

        def begin():
            buffer.message_event.clear()
            tasks.append(buffer.event_loop.create_task(wait()))

        tasks = []
        buffer.event_loop.call_soon_threadsafe(begin)
        server.gui.add_html('a text')
        assert woken.wait(60.0)
    finally:
        server.stop()
