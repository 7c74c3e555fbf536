"""A demo that cannot begin, is interrupted or is killed; wrong usage: one line, nothing left behind."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.cli import main as acquire
from analyze.cli import main as analyze
from tests.loopback import loopback
from tests.system.complaints import complaint, names_in, write
from tests.system.fault_rig import child

pytestmark = pytest.mark.usefixtures("nothing_left")

TAKEN_ADDRESS = loopback(64)


def test_a_demo_that_cannot_begin(tmp_path: Path) -> None:
    taken = write(tmp_path / "taken.mcap", "mine")
    assert "exists already: choose another name, or give --force" in complaint(acquire, "demo", "-o", taken)
    assert "10.0.0.1: the virtual camera needs a loopback address" in complaint(
        acquire, "demo", "-o", tmp_path / "r.mcap", "--address", "10.0.0.1"
    )
    assert "needs a loopback address" in complaint(
        acquire, "demo", "-o", tmp_path / "r.mcap", "--address", "camera"
    )
    assert "is a folder" in complaint(acquire, "demo", "--force", "-o", tmp_path)
    for force in ([], ["--force"]):  # as `analyze` does: a misspelt folder is not made
        line = complaint(acquire, "demo", "-o", tmp_path / "gone" / "r.mcap", *force)
        assert f"there is no folder {tmp_path / 'gone'}: create it first" in line
    assert names_in(tmp_path) == {"taken.mcap"}
    assert taken.read_text() == "mine"


@pytest.fixture
def short_folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="pc-"))
    yield folder
    shutil.rmtree(folder)


def start_demo(folder: Path, *more: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "acquire", "demo", "-o", str(folder / "r.mcap"), *more]
    environment = os.environ | {"TMPDIR": str(folder)}
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        start_new_session=True,
    )


def processes_of(folder: Path) -> list[str]:
    found: list[str] = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                command = (entry / "cmdline").read_bytes().replace(b"\0", b" ").decode(errors="replace")
            except OSError:
                continue
            if str(folder) in command:
                found.append(command)
    return found


def wait_until_gone(folder: Path, patience_s: float = 40.0) -> list[str]:
    """Wait until no process of the demo in `folder` runs; return those that still run after `patience_s`.

    The wait is long because a child process that is importing modules ends only afterwards.
    """
    end = time.monotonic() + patience_s
    while (left := processes_of(folder)) and time.monotonic() < end:
        time.sleep(0.05)
    return left


@pytest.mark.slow
def test_a_camera_address_in_use_ends_the_demo_and_keeps_the_older_recording(short_folder: Path) -> None:
    older = write(short_folder / "r.mcap", "older")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as holder:
        holder.bind((TAKEN_ADDRESS, 3956))
        process = start_demo(short_folder, "--force", "--address", TAKEN_ADDRESS)
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    assert output == ""
    (line,) = [line for line in errors.splitlines() if not line.startswith("starting: ")]
    assert f"UDP port 3956 of {TAKEN_ADDRESS} is in use" in line
    assert "stop it, or give another address (--address" in line
    assert older.read_text() == "older"
    assert names_in(short_folder) == {"r.mcap"}
    assert processes_of(short_folder) == []


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupted_demo_takes_everything_down(short_folder: Path, number: signal.Signals) -> None:
    process = start_demo(short_folder, "--address", loopback(65))
    assert process.stderr is not None
    while "starting: camera" not in process.stderr.readline():
        assert process.poll() is None
    os.killpg(process.pid, number)
    output, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert output == ""
    assert errors.splitlines()[-1] == "acquire: interrupted"
    assert "Traceback" not in errors
    assert wait_until_gone(short_folder) == []
    assert names_in(short_folder) == set()


@pytest.mark.slow
def test_a_killed_demo_leaves_no_process(short_folder: Path) -> None:
    process = start_demo(short_folder, "--address", loopback(66))
    assert process.stderr is not None
    while "starting: plan" not in process.stderr.readline():
        assert process.poll() is None
    process.kill()
    process.communicate(timeout=60)
    assert wait_until_gone(short_folder) == []
    assert not (short_folder / "r.mcap").exists()


DIES_S = 20.0
"""longest time from the end of one of a demo's processes to the end of the demo, on a busy machine [s]; the
recording is finished meanwhile. It waited for ever before, without its world"""


@pytest.mark.parametrize(
    ("module", "name", "moment"),
    [
        ("acquire.virtual.world_process", "world", "starting: camera"),
        *(
            pytest.param(module, name, "s1.1: ", marks=pytest.mark.slow)
            for module, name in (
                ("acquire.virtual.world_process", "world"),
                ("acquire.virtual.camera_process", "camera"),
                ("acquire\0run", "daemon"),
            )
        ),
    ],
)
def test_a_demo_ends_with_any_of_its_processes(
    short_folder: Path, module: str, name: str, moment: str
) -> None:
    demo = start_demo(short_folder, "--strikes", "3", "--address", loopback(67))
    assert demo.stderr is not None
    while moment not in demo.stderr.readline():
        assert demo.poll() is None
    os.kill(child(demo.pid, module), signal.SIGKILL)
    killed = time.monotonic()
    _, errors = demo.communicate(timeout=60)
    assert time.monotonic() - killed < DIES_S
    assert demo.returncode == 1
    assert (
        errors.splitlines()[-1] == f"acquire: the {name} ended unexpectedly: killed by SIGKILL: start again"
    )
    assert "Traceback" not in errors
    assert wait_until_gone(short_folder) == []
    kept = {"r.mcap"} if moment == "s1.1: " else set()
    assert names_in(short_folder) == kept


@pytest.mark.slow
def test_a_demo_whose_servo_is_unplugged_for_good_ends_in_the_stated_time(short_folder: Path) -> None:
    demo = start_demo(short_folder, "--strikes", "3", "--address", loopback(68))
    assert demo.stderr is not None
    while "s1.1: " not in demo.stderr.readline():
        assert demo.poll() is None
    (path,) = short_folder.glob("percuss-demo-*/world.sock")
    with socket.socket(socket.AF_UNIX) as world:
        world.connect(str(path))
        world.sendall(b'{"method": "servo", "what": "unplug"}\n')
        assert world.recv(100) == b'{"ok": true}\n'
    unplugged = time.monotonic()
    _, errors = demo.communicate(timeout=100)
    assert "waiting for the striker (at most 20 s): " in errors
    assert time.monotonic() - unplugged < 20.0 + DIES_S
    assert demo.returncode == 1
    assert wait_until_gone(short_folder) == []
    assert names_in(short_folder) == {"r.mcap"}


@pytest.mark.slow
def test_a_demo_whose_world_hangs_ends(short_folder: Path) -> None:
    """Without an answer of the virtual operator the session waited for ever."""
    demo = start_demo(short_folder, "--strikes", "3", "--address", loopback(69))
    assert demo.stderr is not None
    while "s1.1: " not in demo.stderr.readline():
        assert demo.poll() is None
    os.kill(child(demo.pid, "acquire.virtual.world_process"), signal.SIGSTOP)
    stopped = time.monotonic()
    _, errors = demo.communicate(timeout=100)
    assert time.monotonic() - stopped < 20.0 + 2 * DIES_S
    assert demo.returncode in {1, 3}, errors
    assert "Traceback" not in errors
    assert wait_until_gone(short_folder) == []


def test_wrong_usage_is_one_line_and_code_2() -> None:
    for command, arguments, line in (
        (
            acquire,
            ["demo", "--object", "teapot", "-o", "x.mcap"],
            r"acquire: .*'teapot' is not one of carton, .*, nor .* \(see acquire demo --help\)",
        ),
        (acquire, ["demo"], r"acquire: Missing option '-o' / '--output' \(see acquire demo --help\)"),
        (
            acquire,
            ["demo", "-o", "x.mcap", "--strikes", "2"],
            r"acquire: --strikes 2: ask for 3, .*--tosses 3\) \(see acquire demo --help\)",
        ),
        (acquire, ["--loud"], r"acquire: No such option.*--loud.* \(see acquire --help\)"),
        (
            acquire,
            ["strike", "--speed", "1", "--plan", "p"],
            r"acquire: give either --speed, or --plan with --strike.* \(see acquire strike --help\)",
        ),
        (analyze, ["estimate"], r"analyze: Missing argument 'FILE\.\.\.' \(see analyze estimate --help\)"),
        (
            analyze,
            ["plan", "x.toml", "--strikes", "0"],
            r"analyze: --strikes 0 plans nothing: .* \(see analyze plan --help\)",
        ),
        (
            analyze,
            ["plan", "x.toml", "--methd", "ours"],
            r"analyze: No such option.*--methd.*--method.* \(see analyze plan --help\)",
        ),
        (analyze, ["divine", "x.mcap"], r"analyze: No such command.*divine.* \(see analyze --help\)"),
    ):
        result = CliRunner().invoke(command, arguments)
        assert result.exit_code == 2
        assert result.stdout == ""
        assert re.fullmatch(line + "\n", result.stderr)


def test_without_a_verb_the_verbs_are_listed() -> None:
    result = CliRunner().invoke(analyze, [])
    assert result.exit_code == 2
    assert "Plan strikes" in result.stderr
    assert CliRunner().invoke(analyze, ["plan", "--help"]).exit_code == 0
