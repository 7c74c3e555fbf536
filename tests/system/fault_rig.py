"""A rig for fault tests, and rows for the table of faults.

The camera is a process, the servo with its arm is in this process, and the daemon has its child processes.
"""

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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError, StrikerLost
from schemas import topics
from schemas.document import canonical_json
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.proto import percuss_pb2 as pb
from schemas.strike_plan import StrikePlan
from tests.acquire.session.test_machine import planned
from tests.acquire.striker.plant import EFFECTIVE_MASS, Plant
from tests.carton import CARTON
from tests.loopback import loopback
from tests.places import PATTERN_CAMERA
from tests.rig_text import CALIBRATION

SLOW_M_S, FAST_M_S = 0.15, 0.3
"""tip speeds of strikes to break and of strikes to come through"""
TABLE_VARIABLE = "PERCUSS_FAULT_TABLE"
"""environment variable that names the file to which rows are added, as JSON lines"""
RATE_HZ = 120.0
ADDRESS, OTHER_ADDRESS = loopback(121), loopback(122)


def add_row(fault: str, lost: str, again: str) -> None:
    """Add a row of docs/reference/faults.md if PERCUSS_FAULT_TABLE names a file."""
    if path := os.environ.get(TABLE_VARIABLE):
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps({"fault": fault, "lost": lost, "again": again}) + "\n")


def wait_until(condition: Callable[[], Any], timeout_s: float, pause_s: float = 0.002) -> float:
    """Wait until `condition()` is true and return the time that took [s]; fail after `timeout_s`."""
    start = time.monotonic()
    while not condition():
        assert time.monotonic() - start < timeout_s, f"not within {timeout_s} s"
        time.sleep(pause_s)
    return time.monotonic() - start


def alive(pid: int) -> bool:
    """True if the process runs; False for a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def child(pid: int, word: str) -> int:
    """Id of the child process of `pid` whose command line contains `word`; 0 if there is none."""
    for children in Path(f"/proc/{pid}/task").glob("*/children"):  # each thread has its own
        with contextlib.suppress(OSError):
            for text in children.read_text(encoding="utf-8").split():
                if word.encode() in Path(f"/proc/{text}/cmdline").read_bytes():
                    return int(text)
    return 0


def messages(path: Path, topic: topics.Topic) -> list[tuple[int, Any]]:
    """Pairs of log time [ns] and message of one topic, from a complete file; checksums are verified."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [
            (m.log_time, topic.message.FromString(m.data))
            for _, _, m in reader.iter_messages(topics=[topic.name])
        ]


@dataclass(frozen=True)
class Frames:
    """Frame counts and times of a recording."""

    arrived: int
    lost: int
    longest_gap_s: float
    first_ns: int
    last_ns: int
    """log time of the last frame [ns]"""

    @classmethod
    def of(cls, path: Path) -> Frames:
        found = messages(path, topics.frame_meta("main"))
        times = np.array([time for time, _ in found])
        lost = sum(meta.frames_lost_before for _, meta in found[1:])
        return cls(len(found), lost, float(np.diff(times).max()) * 1e-9, int(times[0]), int(times[-1]))

    @property
    def unaccounted(self) -> float:
        """Number of frames missing between first and last frame that are not counted as lost; 0 if exact."""
        return (self.last_ns - self.first_ns) * 1e-9 * RATE_HZ - (self.arrived - 1) - self.lost


class Camera:
    """Process of the pattern camera."""

    def __init__(self, address: str = ADDRESS, packet_loss: float = 0.0) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(PATTERN_CAMERA), address, str(packet_loss)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._counts: dict[str, int] | None = None
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def finish(self) -> dict[str, int]:
        """End the camera and return its packet counts. Safe to call twice."""
        if self._counts is None:
            self.process.send_signal(signal.SIGCONT)
            output, _ = self.process.communicate(timeout=60)
            self._counts = json.loads(output) if output else {}
        return self._counts


class Daemon:
    """`acquire run` as a process."""

    def __init__(self, rig_file: Path, before: tuple[str, ...] = (), **environment: str) -> None:
        self.rig_file = rig_file
        self.socket = rig_file.with_suffix("") / "d.sock"
        self.started = time.monotonic()
        with rig_file.with_suffix(".err").open("ab") as errors:
            self.process = subprocess.Popen(
                [*before, sys.executable, "-m", "acquire", "run", str(rig_file)],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env=os.environ | environment,
                start_new_session=True,
            )
        assert self.process.stdout is not None
        self.ready = self.process.stdout.readline()
        self.ready_s = time.monotonic() - self.started

    @property
    def pid(self) -> int:
        return self.process.pid

    @property
    def complaints(self) -> str:
        return self.rig_file.with_suffix(".err").read_text(encoding="utf-8")

    @property
    def capture(self) -> int:
        return child(self.pid, "acquire.capture")

    @property
    def watcher(self) -> int:
        return child(self.pid, "watch")

    def client(self) -> DaemonClient:
        return DaemonClient(self.socket)

    def end(self) -> None:
        for number in (signal.SIGTERM, signal.SIGKILL):
            if self.process.poll() is None:
                self.process.send_signal(number)
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self.process.wait(20)
        if self.process.stdout is not None:
            self.process.stdout.close()


class FaultRig:
    """Camera, servo and daemon of a test; all of them end with it."""

    def __init__(self, cleanup: contextlib.ExitStack, folder: Path) -> None:
        self._cleanup = cleanup
        self._background: list[threading.Thread] = []
        self.folder = folder
        self.plant = cleanup.enter_context(Plant(folder, gap=0.0))
        self.recording = folder / "r.mcap"

    def camera(self, address: str = ADDRESS, packet_loss: float = 0.0) -> Camera:
        camera = Camera(address, packet_loss)
        self._cleanup.callback(camera.finish)
        return camera

    def rig_file(
        self, name: str = "d", address: str = ADDRESS, striker: str | None = None, recorder: str = ""
    ) -> Path:
        port = (
            striker
            or f'port = "{self.plant.servo.port_path}"\n'
            f"effective_mass_kg = {EFFECTIVE_MASS}\neffective_mass_sd_kg = 0.01"
        )
        path = self.folder / f"{name}.toml"
        path.write_text(
            f"""[camera]
address = "{address}"
frame_rate_hz = {RATE_HZ}
{CALIBRATION}[striker]
{port}
[recorder]
disk_reserve_bytes = 0
{recorder}
[daemon]
socket = "{path.with_suffix("") / "d.sock"}"
""",
            encoding="utf-8",
        )
        return path

    def daemon(
        self, rig_file: Path | None = None, before: tuple[str, ...] = (), **environment: str
    ) -> Daemon:
        """Start a daemon; `before` is a command that starts it, for example in a namespace."""
        daemon = Daemon(rig_file or self.rig_file(), before, **environment)
        self._cleanup.callback(daemon.end)
        return daemon

    def client(self, daemon: Daemon) -> DaemonClient:
        return self._cleanup.enter_context(contextlib.closing(daemon.client()))

    def recording_daemon(self) -> tuple[Camera, Daemon, DaemonClient]:
        """Start camera and daemon; returns both, and a client whose recording is open."""
        camera, daemon = self.camera(), self.daemon()
        client = self.client(daemon)
        self.open_recording(client)
        return camera, daemon, client

    def open_recording(self, client: DaemonClient, path: Path | None = None) -> int:
        """Open a recording; returns its wall anchor [ns]."""
        return int(
            client.call("recording.open", **recording_request(path or self.recording))["wall_anchor_ns"]
        )

    def cocked(self, client: DaemonClient) -> None:
        """Place the object and cock the arm.

        Repeated if a busy computer made the virtual servo miss its answers.
        """
        self.plant.restore(gap=0.0)
        for patience in (2, 1, 0):
            try:
                for verb in ("home", "arm", "cock"):
                    client.call(f"striker.{verb}")
                return
            except StrikerLost:
                if not patience:
                    raise

    def strike_in_background(self, client: DaemonClient, tip_speed_m_s: float) -> None:
        self.in_background(client, "striker.strike", strike_id="s1.1", tip_speed_m_s=tip_speed_m_s)

    def in_background(self, client: DaemonClient, method: str, **params: Any) -> None:
        """Call a method in a thread, and ignore its result."""

        def call() -> None:
            with contextlib.suppress(AcquireError):
                client.call(method, **params)

        thread = threading.Thread(target=call, name=method)
        thread.start()
        self._background.append(thread)
        self._cleanup.callback(thread.join)

    def wait_for_background(self) -> None:
        """Wait until every call in the background is answered, so that its client can be used again."""
        while self._background:
            self._background.pop().join()

    def still_after_s(self, since_ns: int, rad_s: float = 0.1) -> float:
        """Time from `since_ns` until the arm last moved faster than `rad_s` [s]; 0 if it never did."""
        moving = [t for t, _, omega in self.plant.history if t > since_ns and abs(omega) > rad_s]
        return (max(moving) - since_ns) * 1e-9 if moving else 0.0

    @property
    def torque(self) -> bool:
        return bool(self.plant.servo.registers["Torque Enable"])


def recording_request(path: Path) -> dict[str, Any]:
    """Parameters of the daemon's request recording.open for a carton with one planned strike."""
    spec = parse_object_spec(CARTON, "object")
    plan = StrikePlan(object_name="carton", object_sha256=object_sha256(spec, None), strikes=[planned("s1")])
    return {"path": str(path), "object_toml": CARTON, "plan_json": canonical_json(plan)}


@contextlib.contextmanager
def fault_rig() -> Iterator[FaultRig]:
    """Yield a rig in a folder with a short name, because the path of a socket is limited."""
    with tempfile.TemporaryDirectory(prefix="pf-") as name, contextlib.ExitStack() as cleanup:
        yield FaultRig(cleanup, Path(name))


def contact_event(path: Path) -> pb.StrikerEvent | None:
    """First contact event of the striker in a recording; None if there is none."""
    found = [
        event for _, event in messages(path, topics.STRIKER_EVENT) if event.kind == pb.StrikerEvent.CONTACT
    ]
    return found[0] if found else None


def mid_swing(rig: FaultRig) -> bool:
    return rig.plant.omega > 1.0 and -0.5 < rig.plant.angle < -0.2


def milliseconds(seconds: float) -> str:
    return f"{1e3 * seconds:.0f} ms"


def works_again(rig: FaultRig, daemon: Daemon) -> None:
    """Check that a recording with a strike succeeds, from its beginning to its end."""
    path = rig.folder / f"again-{time.monotonic_ns()}.mcap"
    with daemon.client() as client:
        rig.open_recording(client, path)
        rig.cocked(client)
        client.call("window.open")
        assert client.call("striker.strike", strike_id="s1.1", tip_speed_m_s=FAST_M_S)["contacts"] == 1
        assert client.call("window.close")["frames"] > 10
        client.call("recording.close")
    assert contact_event(path) is not None


def wait_for_frames(client: DaemonClient, count: int = 20, timeout_s: float = 20.0) -> float:
    """Wait until the camera is connected and sent `count` more frames; returns the time [s]."""
    start = client.call("status")["frames"]
    return wait_until(
        lambda: (s := client.call("status"))["connected"] and s["frames"] >= start + count, timeout_s, 0.02
    )
