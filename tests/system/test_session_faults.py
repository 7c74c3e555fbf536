"""Whole sessions on the virtual rig whose camera and watcher die on the way. Rows of docs/faults.md."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from acquire.api import DaemonClient
from acquire.demo import rig_toml
from acquire.session_runner import SessionInput, SessionReport, SessionRunner
from acquire.virtual.objects import load_object
from acquire.virtual.operator import VirtualOperator
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.station import calibration_sheet
from schemas import topics
from tests.system.fault_rig import Daemon, Frames, add_row, messages

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]
ADDRESS = "127.0.0.123"
OBJECT, SEED = "carton", 3


def _started(module: str, *arguments: str) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-m", module, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert json.loads(process.stdout.readline())["ready"]
    return process


def _ended(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=60)


@dataclass
class SessionRig:
    """The whole virtual rig, its parts at hand."""

    folder: Path
    cleanup: contextlib.ExitStack
    said: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        thing = load_object(OBJECT, SEED)
        (self.folder / "object.toml").write_text(thing.spec_toml)
        self.common = ["--object", OBJECT, "--seed", str(SEED), "--dir", str(self.folder)]
        self.cleanup.callback(_ended, _started("acquire.virtual.world_process", *self.common))
        rig = self.folder / "d.toml"
        sheet = calibration_sheet(SEED)
        rig.write_text(rig_toml(sheet, ADDRESS, str(self.folder / "ttyDXL"), self.folder / "d" / "d.sock"))
        self.camera = self.start_camera()
        plan = [str(self.folder / "object.toml"), "-o", str(self.folder / "plan.json"), "--rig", str(rig), "--strikes", "3"]
        subprocess.run([sys.executable, "-m", "analyze", "plan", *plan], check=True, stdout=subprocess.DEVNULL)
        self.daemon = Daemon(rig)
        self.cleanup.callback(self.daemon.end)
        assert self.daemon.ready, self.daemon.complaints

    def start_camera(self) -> subprocess.Popen[str]:
        camera = _started("acquire.virtual.camera_process", *self.common, "--address", ADDRESS)
        self.cleanup.callback(_ended, camera)
        return camera

    def session(self, progress) -> SessionReport:
        world = self.cleanup.enter_context(contextlib.closing(OperatorLink(self.folder / "world.sock")))
        client = self.cleanup.enter_context(contextlib.closing(DaemonClient(self.daemon.socket)))
        with contextlib.closing(VirtualOperator(self.daemon.socket, world, SEED)):
            given = SessionInput(self.folder / "object.toml", self.folder / "plan.json")
            return SessionRunner(client, given, self.folder / "r.mcap", progress).run()


@pytest.fixture
def rig() -> Iterator[SessionRig]:
    with tempfile.TemporaryDirectory(prefix="ps-") as name, contextlib.ExitStack() as cleanup:
        yield SessionRig(Path(name), cleanup)


def test_a_session_outlives_camera_and_watcher(rig: SessionRig) -> None:
    """The watcher is killed during the first strike, the camera during the second; the third strike is as if nothing had been."""
    done: list[str] = []
    threads: list[threading.Thread] = []
    ids: list[str] = []

    def kill_camera() -> None:
        time.sleep(0.2)
        rig.camera.kill()
        rig.camera.wait()
        time.sleep(1.0)
        rig.start_camera()
        done.append("camera")

    def progress(text: str, _done: int, _total: int) -> None:
        rig.said.append(text)
        strike_id, _, rest = text.partition(" ")
        plan_id = strike_id.partition(".")[0]
        if plan_id not in ids:
            ids.append(plan_id)
        if not rest.startswith("striking"):
            return
        if len(ids) == 1 and "watcher" not in done:
            os.kill(rig.daemon.watcher, signal.SIGKILL)
            done.append("watcher")
        elif len(ids) == 2 and not threads:
            threads.append(threading.Thread(target=kill_camera))
            threads[0].start()

    start = time.monotonic()
    report = rig.session(progress)
    took_s = time.monotonic() - start
    for thread in threads:
        thread.join()
    assert done == ["watcher", "camera"], rig.said
    assert not report.aborted
    frames = Frames.of(report.path)
    assert frames.lost > 60
    assert abs(frames.unaccounted) < 2.0
    strikes = [record for _, record in messages(report.path, topics.SESSION_STRIKE)]
    good = {record.plan_strike_id for record in strikes if record.verdict_code == "good"}
    planned = {record.plan_strike_id for record in strikes}
    assert len(planned) >= 3
    assert len(good) >= 2, [(record.strike_id, record.verdict_code, record.verdict_text) for record in strikes]
    add_row(
        "`analyze watch` killed in a session's first strike, the camera in its second (back after 1 s)",
        f"{frames.lost} frames, stated; {len(strikes) - len(good)} of {len(strikes)} attempts without a good verdict, "
        f"{len(good)} of {len(planned)} planned strikes good",
        f"the session ends by itself after {took_s:.0f} s",
    )
