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

"""The page is where it is told to be, and opens to nobody else by itself."""

import socket

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.view import server as page
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect


@pytest.fixture
def taken():
    """Return a port of this machine that somebody listens on."""
    with socket.socket() as listener:
        listener.bind((page.LOCAL, 0))
        listener.listen()
        yield listener.getsockname()[1]


@pytest.fixture(scope='module')
def server():
    """Return a server, found by itself."""
    found = page.open_server()
    yield found
    found.stop()


def test_page_is_for_this_machine_only_unless_somebody_says_otherwise(server):
    assert server.get_host() == '127.0.0.1'
    assert page.address(server) == f'http://127.0.0.1:{server.get_port()}'
    assert page.exposure(server.get_host()) == ''


def test_port_that_is_taken_is_refused_and_named(taken):
    with pytest.raises(TpControllerError, match=f'127.0.0.1:{taken}.*in use'):
        page.open_server(port=taken)


def test_without_a_port_the_first_free_one_is_taken(taken, monkeypatch):
    monkeypatch.setattr(page, 'PORTS', range(taken, taken + 1))
    with pytest.raises(TpControllerError, match=f'no free port from {taken}'):
        page.free_port(page.LOCAL)
    monkeypatch.setattr(page, 'PORTS', range(taken, taken + 20))
    assert taken < page.free_port(page.LOCAL) < taken + 20


@pytest.mark.parametrize('host', ['192.0.2.1', 'no-such-host.invalid'])
def test_address_of_another_machine_is_refused(host):
    with pytest.raises(TpControllerError, match=host):
        page.open_server(host, 8080)


@pytest.mark.parametrize('host, local', [
    ('127.0.0.1', True), ('localhost', True), ('::1', True), ('127.0.0.5', True),
    ('0.0.0.0', False), ('192.168.1.7', False), ('robot.example', False)])
def test_who_can_be_reached_by_others_is_warned(host, local):
    assert page.is_local(host) is local
    assert bool(page.exposure(host)) is not local


@pytest.mark.parametrize('host, shown', [
    ('0.0.0.0', 'http://localhost:81'), ('::1', 'http://[::1]:81'),
    ('192.168.1.7', 'http://192.168.1.7:81')])
def test_address_is_one_that_a_browser_takes(host, shown):
    assert page.url(host, 81) == shown


@pytest.mark.parametrize('origin, let_in', [
    ('http://127.0.0.1:8080', True), ('http://localhost:9000', True), (None, True),
    ('http://evil.example', False), ('http://127.0.0.1.evil.example', False)])
def test_pages_of_other_sites_cannot_move_the_robot(server, origin, let_in):
    def knock():
        with connect(f'ws://127.0.0.1:{server.get_port()}', origin=origin):
            pass

    if let_in:
        knock()
    else:
        with pytest.raises(InvalidStatus, match='403'):
            knock()


def test_no_way_in_from_the_internet_is_opened(server):
    assert server.request_share_url() is None


def test_panel_is_as_wide_in_every_browser(server):
    # That of the theme comes too late where a browser docks the panel first.
    widths = [message.width for message in
              server._websock_server._broadcast_buffer.message_from_id.values()
              if type(message).__name__ == 'GuiSetPanelWidthMessage']
    assert widths == [page.PANEL_WIDTH]
