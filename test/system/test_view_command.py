# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""The page from the command line: where it is, when it is not, and how it ends."""

from contextlib import ExitStack
import os
from pathlib import Path
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from urllib.request import urlopen

from processes_harness import command_line, DEADLINE, hear_ctrl_c
import pytest
from robots import CONFIG
from tp_controller.errors import TpControllerError
from tp_controller.tools.demos import live_page
from tp_controller.tools.demos.processes import own_domain
from tp_controller.tools.extras import install_command

pytest.importorskip('viser', reason="needs pip install '.[view]'")
pytest.importorskip('rclpy', reason='needs ROS 2')


@pytest.fixture
def taken():
    """Return a port of this machine that somebody listens on."""
    with socket.socket() as listener:
        listener.bind(('127.0.0.1', 0))
        listener.listen()
        yield listener.getsockname()[1]


def children_of(pid):
    """Return the ids of the processes that a process has started."""
    return [int(found) for found in
            Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]


def test_view_says_where_it_is_and_how_to_send_goals_and_ctrl_c_ends_all(environment):
    another_terminal = {name: value for name, value in environment.items()
                        if name not in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')}
    with subprocess.Popen([sys.executable, '-m', 'tp_controller', 'view'], env=environment,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                          preexec_fn=hear_ctrl_c) as process:
        try:
            word, address = process.stdout.readline().split()[:2]
            assert word == 'page:'
            with urlopen(address, timeout=DEADLINE) as answer:
                assert b'<html' in answer.read()
            while len(children := children_of(process.pid)) < 2:
                assert process.poll() is None, process.stderr.read()
            assert 'another terminal' in process.stdout.readline()
            lines = ''.join(process.stdout.readline() for _ in range(2))
            sent = subprocess.run(['bash', '-e', '-c', f'{lines.rstrip()} --wait 60'],
                                  env=another_terminal, capture_output=True, text=True)
            assert sent.stdout == 'goal sent to task tool\n', sent.stderr
            process.send_signal(signal.SIGINT)
            # Python may end by the signal itself afterwards; a shell says 130 then, too.
            assert process.wait(2.0 * DEADLINE) in (130, -signal.SIGINT)
        finally:
            process.kill()
        assert process.stderr.read() == 'tp_controller: interrupted\n'
        for child in children:
            with pytest.raises(ProcessLookupError):
                os.kill(child, 0)


def test_port_that_is_taken_is_said_and_nothing_is_started(environment, taken):
    status, said, complaint = command_line(environment, 'view', '--port', str(taken))
    assert (status, said) == (1, '')
    assert f'http://127.0.0.1:{taken}' in complaint and 'in use' in complaint


def test_scene_without_nodes_refuses_another_output(environment):
    status, said, complaint = command_line(
        environment, 'view', '--demo', 'weights', '--commands', 'position')
    assert (status, said) == (1, '')
    assert '--commands: weights is computed without nodes' in complaint


@pytest.mark.parametrize('demo', ['failed_joint', 'camera'])
def test_page_of_a_scene_has_its_question(environment, demo):
    playwright = pytest.importorskip('playwright.sync_api', reason='needs playwright')
    from tp_controller.tools.demos.chromium import chromium_flags, find_chromium
    from tp_controller.tools.demos.scenes import SCENES
    if find_chromium() is None:
        pytest.skip('needs a Chromium on the PATH')
    with subprocess.Popen([sys.executable, '-m', 'tp_controller', 'view', '--demo', demo],
                          env=environment, stdout=subprocess.PIPE, text=True,
                          preexec_fn=hear_ctrl_c) as process:
        try:
            address = process.stdout.readline().split()[1]
            with playwright.sync_playwright() as driver:
                browser = driver.chromium.launch(executable_path=find_chromium(),
                                                 args=chromium_flags())
                page = browser.new_page()
                page.set_default_timeout(1e3 * DEADLINE)
                page.goto(address)
                scene = SCENES[demo]()
                page.get_by_text(scene.question).wait_for()
                page.get_by_text('Answer').click()
                page.get_by_text(scene.answer[:40]).wait_for()
                browser.close()
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(2.0 * DEADLINE)


@pytest.mark.parametrize('port', ['0', '65536', 'http', '-1'])
def test_port_that_is_none_is_refused(environment, port):
    status, _, complaint = command_line(environment, 'view', '--port', port)
    assert status == 2 and '--port' in complaint


def wait_for_page(live):
    """Return what is said of the page of a demo, once that is known."""
    return live.wait(time.sleep, lambda line: None)


def test_demo_has_a_page_that_answers(tmp_path):
    with ExitStack() as stack:
        environment = stack.enter_context(own_domain())
        said = wait_for_page(live_page.start_page(stack, environment, tmp_path))
        word, address = said.split()
        with urlopen(address, timeout=DEADLINE) as answer:
            assert word == 'page:' and b'<html' in answer.read()


def test_results_of_a_demo_go_to_its_page(domain, tmp_path):
    from tp_controller.ros.client.client import Client
    with ExitStack() as stack:
        live = live_page.start_page(stack, domain, tmp_path)
        assert wait_for_page(live).startswith('page: ')
        client = stack.enter_context(Client())
        assert live.conclude(client, 'The demo has finished')
        assert 'Traceback' not in (tmp_path / 'viewer_node.log').read_text()


def test_demo_without_viser_goes_on_and_says_so(tmp_path, monkeypatch):
    monkeypatch.setattr(live_page, 'find_spec', lambda name: None)
    with pytest.raises(TpControllerError, match=live_page.WITHOUT_PAGE) as error:
        live_page.start_page(ExitStack(), {}, tmp_path)
    assert install_command('view') in str(error.value)


def test_demo_without_a_free_port_goes_on_and_says_so(tmp_path, monkeypatch, taken):
    from tp_controller.tools.view import server
    monkeypatch.setattr(server, 'PORTS', range(taken, taken + 1))
    with pytest.raises(TpControllerError,
                       match=f'{live_page.WITHOUT_PAGE}no free port from {taken}'):
        live_page.start_page(ExitStack(), {}, tmp_path)


def test_demo_whose_page_cannot_start_goes_on_and_says_why(tmp_path, monkeypatch, taken):
    # Somebody took it meanwhile.
    from tp_controller.tools.view import server
    monkeypatch.setattr(server, 'free_port', lambda host: taken)
    monkeypatch.setattr(live_page, '_answers', lambda address: False)
    with ExitStack() as stack:
        environment = stack.enter_context(own_domain())
        said = wait_for_page(live_page.start_page(stack, environment, tmp_path))
    assert said.startswith(live_page.WITHOUT_PAGE) and 'in use' in said
    assert str(tmp_path / 'viewer_node.log') in said


def test_view_names_the_log_of_a_node_that_cannot_start(environment, tmp_path):
    folder = tmp_path / 'config'
    shutil.copytree(CONFIG, folder)
    (folder / 'demo.yaml').write_text((folder / 'demo.yaml').read_text().replace(
        'rate: 0.0', 'rate: -7.0'))
    patched = f"""
import sys
from pathlib import Path
from tp_controller.tools.cli import main
from tp_controller.tools.cli import view
view._file = lambda demo, ending: Path({str(folder)!r}) / f'demo{{ending}}.yaml'
sys.exit(main.main(['view']))
"""
    # Its logs are in a temporary directory.
    done = subprocess.run([sys.executable, '-c', patched], env={
        **environment, 'TMPDIR': str(tmp_path)}, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert 'controller_node has ended' in done.stderr and '-7' in done.stderr
    log = re.search(r'log of controller_node: (\S+)', done.stderr).group(1)
    assert '-7' in Path(log).read_text()
