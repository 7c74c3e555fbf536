"""Missing devices, sockets in use, invalid orders: one line each, exit code 1, nothing left behind."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import serial
from click.testing import CliRunner

from acquire.cli import main as acquire
from acquire.clock.clock import SystemClock
from acquire.daemon.client import DaemonClient, wait_for_socket
from acquire.striker.base import StrikerState
from acquire.virtual.gige_camera import VirtualGigeCamera
from tests.acquire.striker.plant import Plant
from tests.acquire.virtual.pattern_source import PatternSource
from tests.carton import CARTON
from tests.loopback import loopback
from tests.rig_text import CALIBRATION
from tests.system.complaints import complaint, names_in, one_line, spec_and_plan, write

pytestmark = pytest.mark.usefixtures("nothing_left")

ADDRESS, EMPTY_ADDRESS = loopback(62), loopback(63)


@dataclass(frozen=True)
class Rig:
    folder: Path

    def file(
        self, name: str, address: str = ADDRESS, striker: str = 'kind = "manual"', socket_name: str = "d"
    ) -> Path:
        return write(
            self.folder / f"{name}.toml",
            f"""[camera]
address = "{address}"
{CALIBRATION}[striker]
{striker}
[recorder]
disk_reserve_bytes = 0
[daemon]
socket = "{self.socket(socket_name)}"
""",
        )

    def socket(self, name: str) -> Path:
        return self.folder / name / "daemon.sock"


@pytest.fixture(scope="module")
def rig() -> Iterator[Rig]:
    """A folder with a short name, for sockets, and a camera that sends a test pattern."""
    folder = Path(tempfile.mkdtemp(prefix="pc-"))
    clock = SystemClock()
    served = VirtualGigeCamera(ADDRESS, "BAD-INPUT", PatternSource(clock, 1), clock)
    try:
        yield Rig(folder)
    finally:
        served.close()
        shutil.rmtree(folder)


def daemon_complaint(rig_file: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "acquire", "run", str(rig_file)],
        capture_output=True,
        text=True,
        timeout=90,
        check=False,
    )
    assert done.returncode == 1
    assert done.stdout == ""
    return one_line(done.stderr)


def test_no_camera_at_the_address(rig: Rig) -> None:
    line = daemon_complaint(rig.file("camera", EMPTY_ADDRESS))
    assert f"no camera answers at {EMPTY_ADDRESS}" in line
    assert "check power, cable and address" in line
    assert not rig.socket("d").exists()


@pytest.fixture
def signals() -> Iterator[None]:
    """Restore the signal handlers that a daemon in this process sets."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ("trouble", "says"),
    [
        ("missing", "no such serial port; check the cable, and `port` in the rig file"),
        ("no terminal", "is not a serial port; check the cable, and `port` in the rig file"),
        (
            "silent",
            (
                "no servo with id 1 answers at 1000000 bit/s; check its power, and `id` and `baud_rate` "
                "in the rig file"
            ),
        ),
        (
            "other baud rate",
            (
                "no servo with id 1 answers at 57600 bit/s; check its power, and `id` and `baud_rate` "
                "in the rig file"
            ),
        ),
        ("held", "the port is in use by another program; `fuser"),
    ],
)
@pytest.mark.usefixtures("signals")
def test_no_servo_on_the_port(rig: Rig, tmp_path: Path, trouble: str, says: str) -> None:
    with contextlib.ExitStack() as cleanup:
        plant = cleanup.enter_context(Plant(tmp_path))
        controller, terminal = os.openpty()
        cleanup.callback(os.close, controller)
        cleanup.callback(os.close, terminal)
        ports = {"missing": "/dev/ttyNONE", "no terminal": "/dev/null", "silent": os.ttyname(terminal)}
        port = ports.get(trouble, str(plant.servo.port_path))
        if trouble == "held":
            cleanup.enter_context(serial.Serial(port, 1_000_000, exclusive=True))
        baud = 57_600 if trouble == "other baud rate" else 1_000_000
        line = complaint(acquire, "run", rig.file("servo", striker=f'port = "{port}"\nbaud_rate = {baud}'))
    assert f"{port}: {says}" in line
    assert not rig.socket("d").exists()


@pytest.mark.usefixtures("signals")
def test_a_socket_path_that_cannot_be_used(rig: Rig) -> None:
    precious = rig.socket("file")
    precious.parent.mkdir(mode=0o700)
    write(precious, "precious")
    assert "is not a socket, and is left as it is" in complaint(
        acquire, "run", rig.file("a", socket_name="file")
    )
    assert precious.read_text() == "precious"
    (rig.folder / "open").mkdir()
    (rig.folder / "open").chmod(0o755)
    assert "must belong to you alone: set its mode (chmod 700)" in complaint(
        acquire, "run", rig.file("b", socket_name="open")
    )
    write(rig.folder / "plain", "")
    assert "set [daemon] socket elsewhere" in complaint(acquire, "run", rig.file("c", socket_name="plain"))
    assert "may have 100 bytes" in complaint(acquire, "run", rig.file("e", socket_name="long" * 40))


@pytest.mark.parametrize("verb", [("status",), ("stop",), ("stop", "--daemon")])
def test_no_daemon(rig: Rig, verb: tuple[str, ...]) -> None:
    assert "no daemon listens at" in complaint(
        acquire, *verb, "--rig", rig.file("nobody", socket_name="nobody")
    )
    assert "no such rig file: check the path" in complaint(acquire, *verb, "--rig", rig.folder / "gone.toml")


def test_a_rig_file_that_the_daemon_refuses(tmp_path: Path, rig: Rig) -> None:
    bad = write(tmp_path / "rig.toml", rig.file("x").read_text().replace("kind =", "kindd ="))
    assert "rig.toml: unknown key 'striker.kindd'" in complaint(acquire, "run", bad)
    assert "no such rig file" in complaint(acquire, "run", tmp_path / "gone.toml")


@pytest.fixture(scope="module")
def daemon(rig: Rig) -> Iterator[Path]:
    """Rig file of a running daemon, with a striker moved by hand."""
    path = rig.file("running", socket_name="running")
    process = subprocess.Popen([sys.executable, "-m", "acquire", "run", str(path)], stdout=subprocess.PIPE)
    try:
        wait_for_socket(rig.socket("running"), lambda: process.poll() is None, 90.0)
        assert process.stdout is not None
        assert b"ready" in process.stdout.readline()
        yield path
    finally:
        process.terminate()
        process.communicate(timeout=60)


def session_files(folder: Path) -> tuple[Path, Path]:
    toml, plan = spec_and_plan()
    return write(folder / "object.toml", toml), write(folder / "plan.json", plan.model_dump_json())


@pytest.mark.usefixtures("signals")
def test_a_second_daemon_on_the_socket(daemon: Path) -> None:
    assert "a daemon already listens at" in complaint(acquire, "run", daemon)
    assert CliRunner().invoke(acquire, ["status", "--rig", str(daemon)]).exit_code == 0


def test_a_session_whose_recording_has_no_place(daemon: Path, tmp_path: Path) -> None:
    given = session_files(tmp_path)
    taken = write(tmp_path / "taken.mcap", "mine")
    for output, says in (
        (taken, "taken.mcap: exists already"),
        (tmp_path / "gone" / "r.mcap", f"there is no folder {tmp_path / 'gone'}: create it first"),
        (Path("/proc/r.mcap"), "/proc/r.mcap"),
        (tmp_path, "is a folder: name a file in it"),
    ):
        assert says in complaint(acquire, "session", *given, "-o", output, "--rig", daemon)
    assert taken.read_text() == "mine"
    assert names_in(tmp_path) == {"object.toml", "plan.json", "taken.mcap"}


def test_a_session_with_a_plan_of_another_object(daemon: Path, tmp_path: Path) -> None:
    thing, plan = session_files(tmp_path)
    thing.write_text(CARTON.replace("0.044", "0.045"))
    line = complaint(acquire, "session", thing, plan, "-o", tmp_path / "r.mcap", "--rig", daemon)
    assert re.search(
        r"plan.json: this plan is for another object .*run `analyze plan .*object.toml -o .*plan.json` again",
        line,
    )
    write(plan, plan.read_text().replace('"schema_version":"1.0"', '"schema_version":"2.0"'))
    line = complaint(acquire, "session", thing, plan, "-o", tmp_path / "r.mcap", "--rig", daemon)
    assert (
        "plan.json: has schema version 2.0, this program reads 1.x: create it again with `analyze plan`"
        in line
    )
    assert "not valid JSON" in complaint(
        acquire, "session", thing, thing, "-o", tmp_path / "r.mcap", "--rig", daemon
    )
    assert "gone.json: no such file" in complaint(
        acquire, "session", thing, tmp_path / "gone.json", "-o", tmp_path / "r.mcap"
    )
    assert names_in(tmp_path) == {"object.toml", "plan.json"}


def test_a_session_that_ends_before_its_first_strike_leaves_no_file(
    daemon: Path, tmp_path: Path, rig: Rig
) -> None:
    given = session_files(tmp_path)
    command = [
        sys.executable,
        "-m",
        "acquire",
        "session",
        *map(str, given),
        "-o",
        str(tmp_path / "r.mcap"),
        "--rig",
        str(daemon),
    ]
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    with DaemonClient(rig.socket("running")) as client:
        end = time.monotonic() + 15
        # The arm is homed once the recording is open and the session knows of it.
        while client.call("status")["striker"] != StrikerState.HOMED.value and time.monotonic() < end:
            time.sleep(0.05)
        assert client.call("status")["recording"] is not None
        process.send_signal(signal.SIGINT)
        # Before its input is closed, which would end the session with the exit code of a person who leaves.
        process.wait(60)
        output, errors = process.communicate(timeout=60)
        assert process.returncode == 130
        assert output == ""
        assert errors.splitlines()[-1] == "acquire: interrupted"
        assert "Traceback" not in errors
        assert client.call("status")["recording"] is None
    assert names_in(tmp_path) == {"object.toml", "plan.json"}
