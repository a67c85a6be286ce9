# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What a page of another site can do to the page of a controller in the same browser: nothing."""

from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
import threading

from browser_harness import NEEDS_BROWSER, SECONDS
import pytest

pytestmark = NEEDS_BROWSER

# Says in its title what came of framing and of connecting.
FOREIGN = """\
<title>waiting</title>
<iframe src="http://OWN/" onload="framed()"></iframe>
<script>
let connected = null, loaded = false;
function tell() { if (connected !== null && loaded) document.title = 'told ' + connected; }
function framed() { loaded = true; tell(); }
const socket = new WebSocket('ws://OWN/', ['viser-vVERSION']);
socket.onopen = () => { connected = 'open'; tell(); };
socket.onerror = () => { connected = 'refused'; tell(); };
</script>
"""
# What a script of somebody in the page reaches.
REACHES = """\
async address => {
  const found = [];
  try { await fetch('http://' + address + '/', {mode: 'no-cors'}); found.push('fetch'); }
  catch { }
  await new Promise(done => {
    try {
      const socket = new WebSocket('ws://' + address + '/');
      document.addEventListener('securitypolicyviolation', done);
      socket.onopen = () => { found.push('socket'); done(); };
      socket.onerror = done;
    } catch { done(); }
  });
  return found;
}
"""


@pytest.fixture(scope='module')
def site(server):
    """Return the address of another site, and the requests that it got."""
    import viser
    own = f'127.0.0.1:{server.get_port()}'
    body = FOREIGN.replace('OWN', own).replace('VERSION', viser.__version__).encode()
    requests = []

    class Handler(BaseHTTPRequestHandler):

        def do_GET(self):
            requests.append(self.path)
            self.send_response(200)
            self.send_header('Content-Type', 'text/html')
            self.end_headers()
            self.wfile.write(body)

        def log_message(self, *_):
            """Say nothing."""

    found = ThreadingHTTPServer(('127.0.0.1', 0), Handler)
    thread = threading.Thread(target=found.serve_forever)
    thread.start()
    yield f'127.0.0.1:{found.server_address[1]}', requests
    found.shutdown()
    thread.join()
    found.server_close()


@pytest.fixture
def tab(chromium):
    """Return an empty tab."""
    found = chromium.new_page()
    found.set_default_timeout(1e3 * SECONDS)
    yield found
    found.close()


def test_a_page_of_another_site_neither_frames_nor_reaches_the_page(server, site, tab):
    tab.goto(f'http://{site[0]}/')
    tab.wait_for_function('document.title.startsWith("told")')
    assert tab.title() == 'told refused'
    frame, = tab.main_frame.child_frames
    assert 'viser' not in frame.content().lower() and not frame.locator('#root').count()
    assert not server.get_clients()


def test_the_page_reaches_nobody_else(server, site, tab):
    from tp_controller.tools.view.server import address
    other, requests = site
    tab.goto(f'{address(server)}/?fixedDpr=0.5')
    tab.wait_for_selector('canvas')
    requests.clear()
    assert tab.evaluate(REACHES, other) == [] and requests == []
    for query in (f'websocket=ws://{other}', f'playbackPath=http://{other}/a.viser'):
        assert tab.goto(f'{address(server)}/?{query}').status == 403
    assert requests == []
