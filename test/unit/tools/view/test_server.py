# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The page is where it is told to be, and opens to nobody else by itself."""

from contextlib import ExitStack
from http.client import HTTPConnection
import socket
import sys

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.tools.view import guard, incoming
from tp_controller.tools.view import server as page
from tp_controller.tools.view.guard import Guard
import viser
from websockets.exceptions import ConnectionClosed
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


def ask(server, target='/', upgrade=True, **headers):
    """Return status and headers of the answer to a request, which opens a connection."""
    port = server.get_port()
    lines = {'Host': f'127.0.0.1:{port}', **headers}
    if upgrade:
        lines |= {'Upgrade': 'websocket', 'Connection': 'Upgrade', 'Sec-WebSocket-Version': '13',
                  'Sec-WebSocket-Key': 'A' * 22 + '=='}
    connection = HTTPConnection('127.0.0.1', port, timeout=60.0)
    try:
        connection.putrequest('GET', target, skip_host=True)
        for name, values in lines.items():
            for value in [values] if isinstance(values, str) else values:
                connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders())
    finally:
        connection.close()


@pytest.fixture(scope='module')
def exposed():
    """Return a server that all of this machine's addresses lead to."""
    found = page.open_server('0.0.0.0', page.unused_port())
    yield found
    found.stop()


OWN = '127.0.0.1:1234'


@pytest.mark.parametrize('which', ['server', 'exposed'])
@pytest.mark.parametrize('headers, let_in', [
    ({}, True), ({'Host': OWN, 'Origin': f'http://{OWN}'}, True),
    ({'Host': 'localhost', 'Origin': 'https://LOCALHOST'}, True),
    ({'Host': '[::1]:80', 'Origin': 'http://[::1]:80'}, True),
    # Another site, one in a sandbox, another port, another name of this machine, another scheme.
    ({'Origin': 'http://evil.example'}, False), ({'Origin': 'null'}, False),
    ({'Host': OWN, 'Origin': 'http://127.0.0.1:4321'}, False),
    ({'Host': OWN, 'Origin': 'http://localhost:1234'}, False),
    ({'Host': OWN, 'Origin': f'file://{OWN}'}, False),
    ({'Host': OWN, 'Origin': f'http://{OWN}.evil.example'}, False),
    ({'Host': OWN, 'Origin': [f'http://{OWN}', f'http://{OWN}']}, False),
    # A name that leads here since somebody else says so.
    ({'Host': 'evil.example:1234', 'Origin': 'http://evil.example:1234'}, False),
    ({'Host': 'evil.example'}, False), ({'Host': '127.0.0.1.evil.example'}, False),
    ({'Host': 'localhost@evil.example'}, False), ({'Host': [OWN, 'evil.example']}, False),
    ({'Host': []}, False), ({'Host': ''}, False)])
@pytest.mark.parametrize('upgrade', [True, False])
def test_who_comes_from_another_site_is_refused(request, which, headers, let_in, upgrade):
    status, _ = ask(request.getfixturevalue(which), upgrade=upgrade, **headers)
    assert status == ((101 if upgrade else 200) if let_in else 403)


@pytest.mark.parametrize('host, let_in_here, let_in_there', [
    ('192.168.1.7:80', False, True), ('[fe80::1]:80', False, True),
    (f'{socket.gethostname()}:80', False, True), (f'{socket.gethostname()}.local', False, True)])
def test_a_page_that_others_may_open_is_found_by_addresses_and_the_name_of_the_machine(
        server, exposed, host, let_in_here, let_in_there):
    for found, let_in in ((server, let_in_here), (exposed, let_in_there)):
        status, _ = ask(found, Host=host, Origin=f'http://{host}')
        assert status == (101 if let_in else 403)


@pytest.mark.parametrize('query, let_in', [
    ('', True), ('?', True), ('?fixedDpr=1&initialCameraPosition=1,2,3&darkMode', True),
    ('?websocket=ws://evil.example', False), ('?playbackPath=https://evil.example/a', False),
    ('?playbackPath=data:,a', False), ('?darkMode&%77ebsocket=ws://evil.example', False),
    ('?websocket', False), ('?&websocket=', False)])
def test_an_address_that_names_another_server_is_refused(server, query, let_in):
    # What that sends could be a script, which would run in this page.
    assert ask(server, f'/{query}', upgrade=False)[0] == (200 if let_in else 403)


@pytest.mark.parametrize('upgrade, headers', [
    (False, {}), (False, {'Host': 'evil.example'}), (True, {'Origin': 'http://evil.example'})])
def test_no_answer_can_be_framed(server, upgrade, headers):
    _, found = ask(server, upgrade=upgrade, **headers)
    assert found['X-Frame-Options'] == 'DENY'
    assert "frame-ancestors 'none'" in found['Content-Security-Policy']
    assert 'evil' not in found['Content-Security-Policy']


def test_the_page_connects_to_its_own_server_only(server):
    policy = ask(server, upgrade=False)[1]['Content-Security-Policy']
    own = f'127.0.0.1:{server.get_port()}'
    assert f"connect-src 'self' ws://{own} wss://{own} data: blob:;" in policy


def unguarded(monkeypatch, **methods):
    """Let a guard do less than it does."""
    for name, method in methods.items():
        monkeypatch.setattr(Guard, name, method)


@pytest.mark.slow
@pytest.mark.parametrize('methods, fault', [
    ({'_process': lambda self, connection, request: self._answer(connection, request)},
     'another site is allowed; .*another port .*another name .*X-Frame-Options is not sent'),
    ({'_serve': lambda self, serve, *arguments, **options: serve(*arguments, **options)},
     'it is not guarded'),
    ({'_count_refusal': lambda self: None}, 'messages are not checked')])
def test_a_server_that_lets_others_in_is_not_started(monkeypatch, methods, fault):
    unguarded(monkeypatch, **methods)
    monkeypatch.setattr(page, 'CHECK_SECONDS', 0.5)
    port = page.unused_port()
    with pytest.raises(TpControllerError, match=f'pages of other sites could .*{fault}'):
        page.open_server(port=port)
    page.check_port(page.LOCAL, port)


def test_there_is_a_limit_of_browsers(server, monkeypatch):
    monkeypatch.setattr(guard, 'MOST_CLIENTS', 2)
    protocol = f'viser-v{viser.__version__}'
    with ExitStack() as stack:
        browsers = [stack.enter_context(connect(
            f'ws://127.0.0.1:{server.get_port()}', subprotocols=[protocol]))
            for _ in range(3)]
        with pytest.raises(ConnectionClosed, match='too many browsers'):
            while True:
                browsers[-1].recv(timeout=60.0)
        assert browsers[0].recv(timeout=60.0)


def test_a_page_of_another_version_is_sent_away_without_a_word(server, capfd):
    with connect(f'ws://127.0.0.1:{server.get_port()}',
                 subprotocols=['viser-v0.0.1']) as browser, \
            pytest.raises(ConnectionClosed, match='Version mismatch'):
        browser.recv(timeout=60.0)
    assert capfd.readouterr().out == ''


def test_a_message_that_is_too_long_ends_its_connection(server):
    with connect(f'ws://127.0.0.1:{server.get_port()}',
                 subprotocols=[f'viser-v{viser.__version__}']) as browser:
        browser.send(bytes(incoming.LONGEST_MESSAGE + 1))
        with pytest.raises(ConnectionClosed, match='too big'):
            while True:
                browser.recv(timeout=60.0)


def test_nothing_that_browsers_do_fills_the_log(capsys):
    log = guard.quiet_log()
    log.handlers[0].setStream(sys.stderr)
    for _ in range(100):
        try:
            raise ValueError('\x1b[2J')
        except ValueError:
            log.error('connection handler %s', 'failed', exc_info=True)
    log.error('opening handshake failed')
    assert capsys.readouterr().err == \
        'tp_controller: page: connection handler failed: ValueError: \ufffd[2J\n'


def test_no_way_in_from_the_internet_is_opened(server):
    assert server.request_share_url() is None


def test_panel_is_as_wide_in_every_browser(server):
    # That of the theme comes too late where a browser docks the panel first.
    widths = [message.width for message in
              server._websock_server._broadcast_buffer.message_from_id.values()
              if type(message).__name__ == 'GuiSetPanelWidthMessage']
    assert widths == [page.PANEL_WIDTH]
