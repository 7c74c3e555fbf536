"""A session driven through the console alone, from a cold rig to the recording, by a virtual operator.

The virtual operator moves the object; every order and answer goes over HTTP, as from the page.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import acquire
from acquire.config import read_rig
from acquire.console.web.client import ConsoleClient
from acquire.console.web.orders import StartSession
from acquire.console.web.snapshot import Snapshot
from acquire.daemon.client import DaemonClient
from acquire.errors import DaemonNotRunning
from analyze.api import load
from tests.loopback import loopback
from tests.rig_text import CALIBRATION

SESSION_S = 200.0
"""time after which a session of three strikes counts as hung [s]: it takes 30 s on two idle cores"""


class Bench:
    """Virtual rig and console, as programs of their own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.rig_file = folder / "rig.toml"
        self.recordings = folder / "recordings"
        self.programs: list[subprocess.Popen[str]] = []
        self.addresses: dict[int, str] = {}
        """address that each console printed for one browser, by its process"""

    def start(self, *arguments: object) -> subprocess.Popen[str]:
        program = subprocess.Popen(
            [sys.executable, "-m", "acquire", *map(str, arguments)],
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"TMPDIR": str(self.folder.parent)},
        )
        self.programs.append(program)
        return program

    def plan(self, strikes: int) -> None:
        """Plan the object's strikes; an earlier plan is replaced."""
        command = ["plan", self.folder / "carton.toml", "--rig", self.rig_file, "--strikes", strikes,
                   "--no-cards", "-o", self.folder / "plan.json"]  # fmt: skip
        subprocess.run([sys.executable, "-m", "analyze", *map(str, command)], check=True, capture_output=True)

    def start_console(self) -> subprocess.Popen[str]:
        program = self.start(
            "console", self.rig_file, "--objects", self.folder, "--recordings", self.recordings,
            "--port", 0, "--no-browser",
        )  # fmt: skip
        assert program.stdout is not None
        self.addresses[program.pid] = program.stdout.readline().split()[-1]
        assert "?token=" in self.addresses[program.pid]
        return program

    def client(self) -> ConsoleClient:
        return acquire.connect_console(read_rig(self.rig_file).daemon.socket_path())

    def close(self) -> None:
        with contextlib.suppress(DaemonNotRunning), DaemonClient(self.socket) as daemon:
            daemon.call("shutdown")
        for program in reversed(self.programs):
            if program.poll() is None:
                program.send_signal(signal.SIGINT)
            program.wait(60)
            assert program.stdout is not None
            program.stdout.close()

    @property
    def socket(self) -> Path:
        return read_rig(self.rig_file).daemon.socket_path()


@pytest.fixture
def bench() -> Iterator[Bench]:
    base = Path(tempfile.mkdtemp(prefix="pc-"))
    bench = Bench(base / "rig")
    try:
        virtual = bench.start("virtual", "--seed", 5, "--dir", bench.folder, "--address", loopback(151))
        assert virtual.stdout is not None
        assert any(line.startswith("  analyze report") for line in iter(virtual.stdout.readline, ""))
        # Its later lines must not fill the pipe.
        threading.Thread(target=virtual.stdout.read, daemon=True).start()
        bench.plan(strikes=3)
        yield bench
    finally:
        bench.close()
        shutil.rmtree(base)


def wait(client: ConsoleClient, done: Callable[[Snapshot], bool], timeout_s: float = 60.0) -> Snapshot:
    end_s = time.monotonic() + timeout_s
    while not done(state := client.state()):
        assert time.monotonic() < end_s, state
        time.sleep(0.1)
    return state


def begin(client: ConsoleClient, name: str) -> None:
    """Take over, start the daemon, and start a session with a note on the check that was not run."""
    client.take_over()
    state = wait(client, lambda state: bool(state.choices.plans))
    if not state.daemon.running:
        client.start_daemon()
    object_id, plan_id = state.choices.objects[0].id, state.choices.plans[0].id
    order = {"object_id": object_id, "plan_id": plan_id, "name": name, "override": "a test"}
    client.start_session(StartSession(**order))


def answer_until(client: ConsoleClient, done: Callable[[Snapshot], bool]) -> Snapshot:
    """Answer each prompt once the object is placed, until the state is as wanted."""
    end_s = time.monotonic() + SESSION_S
    answered = -1
    while True:
        state = client.state()
        if done(state):
            return state
        assert time.monotonic() < end_s, state
        if state.prompt is not None and state.prompt.id != answered and state.prompt.hands_off:
            answered = state.prompt.id
            client.answer(answered)
        time.sleep(0.1)


def is_over(state: Snapshot) -> bool:
    return state.session is not None and state.session.state in {"finished", "aborted"}


@pytest.mark.timeout(300)
def test_a_session_from_a_cold_rig_to_the_recording(bench: Bench) -> None:
    bench.start_console()
    with bench.client() as client:
        client.take_over()
        assert not client.state().daemon.running
        client.start_daemon()
        assert client.state().daemon.running
        client.check()
        checked = wait(client, lambda state: state.check.passed is not None).check
        assert {line.name for line in checked.lines if line.outcome == "fail"} <= {"frames", "disk speed"}
        assert client.state().camera is not None
        begin(client, "s1")
        placed = wait(client, lambda state: state.prompt is not None and state.prompt.offset_mm is not None)
        assert placed.prompt is not None
        assert placed.prompt.outline_px
        assert placed.prompt.in_place
        image = client.preview()
        assert image.startswith(b"\xff\xd8\xff")
        client.pause()
        client.answer(placed.prompt.id)
        paused = wait(client, lambda state: state.session is not None and state.session.state == "paused")
        assert paused.session is not None
        assert paused.session.paused == "paused by the operator"
        assert paused.striker is not None
        assert paused.striker.state in {"homed", "disarmed"}
        client.resume()
        state = answer_until(client, is_over)
        assert state.session is not None
        assert state.session.state == "finished", state.session
        assert state.session.done == 3
        good = [strike for strike in state.session.strikes if strike.used]
        assert good
        curve = client.curve(good[0].id)
        assert max(curve.theta_deg) > 5
        end_s = time.monotonic() + 60.0
        while not (entry := client.archive()[0]).complete:
            assert time.monotonic() < end_s
            time.sleep(0.2)
        assert (entry.file, entry.complete, entry.strikes) == ("s1.mcap", True, len(state.session.strikes))
    recording = load(bench.recordings / "s1.mcap")
    assert {strike.id for strike in state.session.strikes} == set(recording.strike_ids)


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_killed_console_pauses_the_session_and_a_new_one_goes_on(bench: Bench) -> None:
    console = bench.start_console()
    with bench.client() as client:
        begin(client, "s2")
        placed = wait(client, lambda state: state.prompt is not None and state.prompt.hands_off)
    assert placed.prompt is not None
    console.kill()
    with DaemonClient(bench.socket) as daemon:
        end_s = time.monotonic() + 10
        while not daemon.call("hold.status")["held"]:
            assert time.monotonic() < end_s
            time.sleep(0.05)
        daemon.call("prompt.answer", prompt_id=placed.prompt.id, ok=True)
        time.sleep(3.0)
        status: dict[str, Any] = daemon.call("status")
        assert status["striker"] in {"homed", "disarmed"}
        assert daemon.call("session.status")["session"]["state"] == "paused"
    bench.start_console()
    with bench.client() as client:
        client.take_over()
        late = wait(client, lambda state: state.session is not None)
        assert late.session is not None
        assert late.session.state == "paused"
        client.resume()
        state = answer_until(client, is_over)
        assert state.session is not None
        assert state.session.state == "finished"


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_an_operator_who_is_lost_pauses_the_session(bench: Bench) -> None:
    bench.start_console()
    with bench.client() as watcher:
        with bench.client() as operator:
            begin(operator, "s3")
            placed = wait(operator, lambda state: state.prompt is not None and state.prompt.hands_off)
            assert placed.prompt is not None
            operator.answer(placed.prompt.id)
        lost = wait(watcher, lambda state: state.session is not None and bool(state.session.paused), 10.0)
        assert not lost.operator_present
        assert lost.session is not None
        assert lost.session.paused == "the operator's browser was lost"
        watcher.take_over()
        watcher.abort()
        state = wait(watcher, is_over)
        assert state.session is not None
        assert state.session.state == "aborted"


def test_the_console_ends_with_ctrl_c_and_leaves_no_file(tmp_path: Path) -> None:
    socket = Path(tempfile.mkdtemp(prefix="pc-")) / "d" / "daemon.sock"
    rig = tmp_path / "rig.toml"
    text = f'[camera]\naddress = "{loopback(152)}"\n{CALIBRATION}[daemon]\nsocket = "{socket}"\n'
    rig.write_text(text, encoding="utf-8")

    bench = Bench(tmp_path)
    bench.rig_file = rig
    console = bench.start_console()
    with bench.client() as client:
        assert not client.state().daemon.running
    assert json.loads((socket.parent / "daemon.sock.console.json").read_text())["pid"] == console.pid
    console.send_signal(signal.SIGINT)
    assert console.wait(20) == 0
    assert list(socket.parent.iterdir()) == []
    bench.close()
    shutil.rmtree(socket.parent.parent)
