# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Show what the page in the browser costs the controller at 1 kHz.

Run as ``python benchmarks/page.py`` (or ``make bench``). A simulated Panda publishes joint states
at 1 kHz, and the controller answers each. Beside them run, one after the other: nothing, the page
that nobody looks at, and the page that takes and sends all that it does for browsers. No browser
runs: what one needs to draw is its own, and depends on the machine. Shares are of one processor,
of a whole process with all its threads.
"""

import argparse
from contextlib import ExitStack
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from tp_controller.ros.client.client import Client
from tp_controller.tools.demos.processes import NodeProcess, own_domain

PARAMETERS = """\
/**/tp_simulator:
  ros__parameters:
    robot: package://tp_controller/config/robots/panda.yaml
    rate: 1000.0
/**/tp_controller:
  ros__parameters:
    stack: package://tp_controller/config/demo_stack.yaml
    rate: 0.0
    status_rate: RATE
"""
# A page that does all that it does for browsers, without one.
WATCHED = """
from tp_controller.ros.client.client import Client
from tp_controller.tools.view.link import Link
from tp_controller.tools.view.page import Page
from tp_controller.tools.view.server import open_server
server = open_server()
server.get_clients = lambda: {0: None}
page = Page(server, Link(Client()))
while True:
    page.turn()
"""
PATIENCE_SECONDS, WARM_UP_SECONDS = 20.0, 3.0
TICKS = os.sysconf('SC_CLK_TCK')
STATUS_RATES = (10.0, 50.0)
KEYS = ('cycle median [ms]', 'cycle p99 [ms]', 'cycle max [ms]')


def processor_seconds(pid):
    """Return what a process has taken of the processors [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def start_page(stack, watched, environment, folder):
    """Start a page; return the id of its process."""
    if not watched:
        return stack.enter_context(NodeProcess('viewer_node', [], environment,
                                               folder / 'viewer.log')).process.pid
    process = stack.enter_context(subprocess.Popen([sys.executable, '-c', WATCHED],
                                                   env=environment))
    stack.callback(process.terminate)
    return process.pid


def measure(page, status_rate, seconds):
    """Return the shares of controller and page, and what the controller says of its cycles."""
    with ExitStack() as stack:
        environment = stack.enter_context(own_domain())
        os.environ.update(environment)
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        parameters = folder / 'parameters.yaml'
        parameters.write_text(PARAMETERS.replace('RATE', str(status_rate)))
        pids = [stack.enter_context(NodeProcess(
            name, ['--params-file', str(parameters)], environment, folder / name)).process.pid
            for name in ('simulator_node', 'controller_node')][1:]
        if page is not None:
            pids.append(start_page(stack, page, environment, folder))
        client = stack.enter_context(Client())
        assert client.wait(lambda: client.status and not client.stop_reason(), PATIENCE_SECONDS)
        client.wait(lambda: False, WARM_UP_SECONDS)
        before, begin = [processor_seconds(pid) for pid in pids], time.monotonic()
        time.sleep(seconds)
        passed = time.monotonic() - begin
        shares = [(processor_seconds(pid) - early) / passed for pid, early in zip(pids, before)]
        client.catch_up()
        told = [float(client.status.values[key]) for key in KEYS]
        return (*shares, *[float('nan')] * (2 - len(shares))), told


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--seconds', type=float, default=10.0, help='of each case')
    options = parser.parse_args()
    print(f'{"status rate, beside the controller":<40} {"controller":>10} {"page":>8} '
          f'{"median":>8} {"p99":>8} {"max":>8} ms')
    for rate in STATUS_RATES:
        for name, page in (('no page', None), ('page, no browser', False),
                           ('page, as with a browser', True)):
            shares, times = measure(page, rate, options.seconds)
            print(f'{f"{rate:g} Hz, {name}":<40} {100 * shares[0]:>8.1f} % '
                  f'{100 * shares[1]:>6.1f} % ' + ' '.join(f'{each:8.3f}' for each in times),
                  flush=True)


if __name__ == '__main__':
    main()
