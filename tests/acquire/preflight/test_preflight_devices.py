"""`acquire check` against virtual devices, directly and through a daemon that holds them.

The devices use the real GigE Vision protocol and a real pseudo-terminal.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.acquire.striker.plant import Plant
from tests.acquire.tag_camera import EDGE_PX, TAG
from tests.loopback import loopback
from tests.rig_text import CALIBRATION

ADDRESS = loopback(173)
RIG = (
    """name = "virtual"
[camera]
address = "{address}"
receive_buffer_bytes = 8388608
"""
    + CALIBRATION
    + """[striker]
port = "{port}"
effective_mass_kg = 0.17
[recorder]
directory = "{folder}"
[daemon]
socket = "{folder}/run/daemon.sock"
"""
)
THIS_COMPUTERS_OWN = {"receive buffer", "disk speed", "frames", "camera clock"}
"""checks that may fail on a machine that is busy with other tests"""
THIS_KERNELS = {"CPU governor"}
"""checks that are not made in a virtual machine, and may fail on a computer that saves power"""


@contextlib.contextmanager
def _process(*arguments: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    """Run a Python process during the block, entered once it has printed a line; then terminate it."""
    given = {**os.environ, **environment}
    with subprocess.Popen(
        [sys.executable, *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=given
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        try:
            yield process
        finally:
            process.terminate()
            process.wait(20)


def _camera() -> contextlib.AbstractContextManager[subprocess.Popen[str]]:
    return _process(str(Path(__file__).parents[1] / "tag_camera.py"), ADDRESS)


def _check(rig: Path) -> tuple[dict[str, dict], set[str]]:
    """Run `acquire check --json`: all checks by name, and the names of those that did not pass."""
    before = sorted(rig.parent.iterdir())
    command = [sys.executable, "-m", "acquire", "check", str(rig), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert sorted(rig.parent.iterdir()) == before
    report = json.loads(done.stdout)
    failed = any(check["outcome"] == "fail" for check in report["checks"])
    assert (report["passed"], done.returncode) == (not failed, int(failed))
    checks = {check["name"]: check for check in report["checks"]}
    return checks, {name for name, check in checks.items() if check["outcome"] != "pass"}


@pytest.mark.usefixtures("aravis")
def test_check_of_virtual_devices(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    with Plant(tmp_path) as plant, _camera():
        rig.write_text(
            RIG.format(address=ADDRESS, port=plant.servo.port_path, folder=tmp_path), encoding="utf-8"
        )
        checks, failures = _check(rig)
    assert failures <= THIS_COMPUTERS_OWN | THIS_KERNELS, {name: checks[name] for name in failures}
    assert f"tag {TAG} is" in checks["marker"]["found"]
    assert checks["marker"]["measured"]["value"] == pytest.approx(EDGE_PX, abs=1.0)
    assert checks["servo"]["found"].startswith("XM430-W210")
    assert checks["camera clock"]["measured"]["value"] < 1e-3


@pytest.mark.slow
@pytest.mark.usefixtures("aravis")
def test_check_uses_the_daemon_which_notifies_its_service_manager(tmp_path: Path) -> None:
    rig = tmp_path / "rig.toml"
    notify = tmp_path / "notify"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager, Plant(tmp_path) as plant, _camera():
        rig.write_text(
            RIG.format(address=ADDRESS, port=plant.servo.port_path, folder=tmp_path), encoding="utf-8"
        )
        manager.bind(str(notify))
        manager.settimeout(5.0)
        environment = {"NOTIFY_SOCKET": str(notify), "WATCHDOG_USEC": "20000000"}
        with _process("-m", "acquire", "run", str(rig), **environment) as daemon:
            assert manager.recv(1000).startswith(b"READY=1\n")
            checks, failures = _check(rig)
            assert manager.recv(1000) == b"WATCHDOG=1"
        words = [manager.recv(1000)]
        while not words[-1].startswith(b"STOPPING=1"):
            words.append(manager.recv(1000))
        assert set(words[:-1]) <= {b"WATCHDOG=1"}
        assert daemon.returncode == 0
    not_made = THIS_KERNELS | {"frame times"}  # it sets two exposures: not while a daemon holds the camera
    assert failures <= THIS_COMPUTERS_OWN | not_made, {name: checks[name] for name in failures}
    assert f"pid {daemon.pid}" in checks["daemon"]["found"]
    assert checks["marker"]["measured"]["value"] == pytest.approx(EDGE_PX, abs=1.0)
    assert checks["servo"]["found"] == "held by the daemon, disarmed"
    assert checks["servo supply"]["measured"]["value"] == pytest.approx(12.0)
    assert checks["servo temperature"]["measured"]["value"] == 31
    assert checks["servo health"]["found"] == "no hardware error"
