"""The live page: a real browser shows the simulated rig and starts it; nobody else can."""

import http.client
import re
import signal
import socket
import subprocess
import sys

from browser import browser, CHROMIUM
from forcecal_ros.cli.main import main
from forcecal_ros.core.calibration import Calibration, Estimate
from forcecal_ros.io.calibration_file import dump
from forcecal_ros.nodes.live import LiveView
from live import PATIENCE
import numpy as np
import pytest
from std_msgs.msg import String

COMMAND = [sys.executable, '-c',
           'import sys; from forcecal_ros.entry import forcecal; sys.exit(forcecal())', 'live']


def text(page, name):
    return page.run(f'document.getElementById("{name}").textContent')


def children(pid):
    """Return the processes that a process has started."""
    found = subprocess.run(['ps', '-o', 'pid=', '--ppid', str(pid)], capture_output=True,
                           text=True, check=False).stdout
    return [int(word) for word in found.split()]


def post(port, path, **headers):
    connection = http.client.HTTPConnection('127.0.0.1', port, timeout=10.0)
    connection.request('POST', path, headers=headers)
    return connection.getresponse().status


@pytest.mark.skipif(not CHROMIUM, reason='wants Chromium or Chrome, which is not installed')
def test_a_browser_shows_the_rig_and_starts_it_and_ctrl_c_ends_all(ros_domain, tmp_path):
    with subprocess.Popen([*COMMAND, '--sim', '--port', '0'], stdout=subprocess.PIPE,
                          text=True) as process, browser(tmp_path / 'browser') as page:
        try:
            said = process.stdout.readline()
            address, port = re.search(r'(http://127\.0\.0\.1:(\d+)/)', said).groups()
            page.open(address)
            page.until('document.getElementById("wrench.2").textContent > 100', PATIENCE)
            page.until('document.getElementById("phase").textContent === "idle"', PATIENCE)
            page.until('document.querySelectorAll("#nodes tr").length === 4', PATIENCE)
            for topic in ('wrench', 'phase', 'diagnostics'):
                page.until(f'/, [0-9.]+ s ago$/.test(document.querySelector('
                           f'"[data-age={topic}]").textContent)', PATIENCE)
            # the nominal tool hangs still: its weight along z, and a bias
            assert 134.0 < float(text(page, 'wrench.2')) < 137.0
            assert text(page, 'contact.0') == '-' and 'waiting for a cal' in text(page, 'said')
            assert post(int(port), '/calibrate') == 403
            assert post(int(port), '/calibrate', **{'X-Token': 'guessed'}) == 403
            token = page.run('document.scripts[0].textContent.match(/X-Token.: "([^"]+)"/)[1]')
            assert post(int(port), '/calibrate', **{
                'X-Token': token, 'Host': 'evil.example'}) == 403
            assert post(int(port), '/etc', **{'X-Token': token}) == 404
            assert text(page, 'phase') == 'idle'
            page.run('document.querySelector("[data-ask=calibrate]").click()')
            # a busy machine has it answer `wait and start again`, which is done
            page.until("""["move", "settle", "measure"].includes(
                document.getElementById("phase").textContent) || (answer => {
                    if (answer.textContent.includes("start again")) {
                        answer.textContent = "";
                        document.querySelector("[data-ask=calibrate]").click();
                    } })(document.getElementById("answer"))""", PATIENCE)
            started = children(process.pid)
            assert len(started) == 4
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(20.0) == 0
        assert not [pid for pid in started if _lives(pid)]
        page.until('document.getElementById("phase").textContent === "disconnected"')
        assert page.run('[...document.querySelectorAll("button")].every(one => one.disabled)')


@pytest.mark.parametrize('simulated', [True, False])
def test_a_calibration_is_shown_by_its_mass_and_how_to_keep_it(simulated):
    view = LiveView.__new__(LiveView)
    view.simulated = simulated
    view._on_calibration(String(data='of another version'))
    assert not hasattr(view, '_result')
    view._on_calibration(String(data=dump(Calibration(
        mass=Estimate(13.0, 0.0005, 'kg'), com=Estimate(np.zeros(3), 1e-4, 'm'),
        wrench_bias=Estimate(np.zeros(6), 0.01, 'N, N m')))))
    assert view._result == 'Calibrated: mass 13.0000 ± 0.0010 kg' + (
        '' if simulated else '; keep it with forcecal save')


def _lives(pid):
    return subprocess.run(['ps', '-p', str(pid)], capture_output=True, check=False).returncode == 0


def test_a_port_that_is_taken_is_one_line(capsys):
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert main(['live', '--port', str(port)]) == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 1 and f'port {port} ' in said and '--port' in said
