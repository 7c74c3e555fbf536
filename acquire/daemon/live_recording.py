"""The recording that the daemon has open: one file, or more where the capture process died on the way.

A capture process that dies, or hangs and is ended, takes its file with it. The daemon starts another, the recording goes on in the next
numbered file with the same id and anchor, what the dead one left is rebuilt beside it, and what lies between is said: in the log of the
next file, to every subscriber and on standard error. What was in the making then (an open window) is answered with RecordingBroken.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from foxglove_schemas_protobuf.Log_pb2 import Log

from acquire.camera.base import CameraInfo
from acquire.capture.link import CaptureProcess
from acquire.clock.clock import Clock
from acquire.config import RigConfig
from acquire.daemon.manifest import CameraAtHand, calibration_message, session_files, session_manifest
from acquire.daemon.salvage import Salvage
from acquire.daemon.watcher import Watcher
from acquire.errors import AcquireError, CaptureGone, DaemonBusy, RecorderError, RecordingBroken, SessionError
from acquire.recorder.file_series import part_path
from acquire.recorder.writer import PART_SUFFIX
from schemas import topics
from schemas.session_manifest import SessionManifest
from schemas.watch_lines import WatchEvent

T = TypeVar("T")

GO_ON_S = 30.0
"""how long a client waits for a capture process that is started again; a camera gives control back 3 s after a client's sudden death"""
FIRST_FRAME_S = 10.0
WATCHER_LIVES = 3
"""an `analyze watch` that died this often in one recording is not started again"""


@dataclass
class _Open:
    """A recording that is open."""

    path: Path
    manifest: SessionManifest
    attachments: list[tuple[str, str, bytes]]
    owner: object
    part: int = 1
    began_ns: int = 0
    """log time at which the present file began"""
    window_part: int | None = None
    """file in which the open window was opened"""
    broken: str = ""
    """why nothing is recorded now"""
    waiting: list[tuple[topics.Topic, int, bytes]] = field(default_factory=list)
    """small messages for the next file"""
    salvages: list[Salvage] = field(default_factory=list)
    watcher: Watcher | None = None
    watcher_lives: int = WATCHER_LIVES
    expected: str = ""


class LiveRecording:
    """At most one recording at a time. Methods may be called from any thread; `write` and `log` never wait.

    Args:
        config, rig_toml: the rig, and the file that describes it.
        capture: the process that records.
        clock: of the host.
        on_watch: hears what `analyze watch` sees.
        complain: tells people that something went wrong; calls `log` itself.

    Raises (where it says nothing else):
        SessionError: no recording is open.
        RecorderError: it could not go on.
    """

    def __init__(
        self,
        config: RigConfig,
        rig_toml: str,
        capture: CaptureProcess,
        clock: Clock,
        on_watch: Callable[[WatchEvent], None],
        complain: Callable[[str], None],
    ) -> None:
        self._config = config
        self._rig_toml = rig_toml
        self._capture = capture
        self._clock = clock
        self._on_watch = on_watch
        self._complain = complain
        self._open: _Open | None = None
        self._ended_by = ""
        """why the last recording ended, where nobody asked for its end"""
        self._changed = threading.Condition(threading.RLock())

    # --- from beginning to end ------------------------------------------------------------------------------------

    def open(self, owner: object, params: dict[str, Any], camera: CameraInfo) -> SessionManifest:
        """Begin; `params` are those of the request `recording.open`.

        Raises:
            DaemonBusy: one is open.
            AcquireError: object, plan or path cannot be used.
        """
        latched = self._patiently(self._capture.status).clock_latched
        with self._changed:
            if self._open is not None:
                raise DaemonBusy("a recording is open already: end that session first, or see `acquire status`")
            files = session_files(params, self._rig_toml)
            anchor = self._clock.wall_ns() - self._clock.monotonic_ns()
            manifest = session_manifest(self._config, CameraAtHand(camera, latched), files, anchor)
            opened = _Open(Path(params["path"]), manifest, list(files.attachments), owner)
            self._begin(opened)
            self._open, self._ended_by = opened, ""
            return manifest

    @property
    def owner(self) -> object | None:
        """Who opened it; None where none is open."""
        opened = self._open
        return opened.owner if opened is not None else None

    @property
    def anchor_ns(self) -> int | None:
        """Log time minus host monotonic time; None where none is open."""
        opened = self._open
        return opened.manifest.wall_anchor_ns if opened is not None else None

    def close(self) -> dict[str, Any]:
        """End it. What is answered counts every file of it."""
        if (opened := self._open) is not None:
            for salvage in list(opened.salvages):
                salvage.result()  # what it finds out is for this recording's log
        with self._changed:
            opened = self._open
            if opened is None:
                raise self._none()
            self._forget(opened)
            path, frames, lost, content_id = None, 0, 0, ""
            if not opened.broken:
                try:
                    report = self._capture.close_recording()
                    path, frames, lost, content_id = report.path, report.frames, report.lost, report.content_id
                except CaptureGone:
                    opened.broken = f"the capture process {self._capture.end}"
            if opened.broken:
                before, opened.part = opened.part, _newest_part(opened.path) + 1
                self._salvage_parts(opened, before, lambda: None)
            self._changed.notify_all()
        earlier = [salvage.result() for salvage in opened.salvages]
        files = [*(file for each in earlier for file in each.files), *([path] if path is not None else [])]
        return {
            "path": str(files[-1] if files and not earlier else opened.path),
            "files": [str(file) for file in files],
            "frames": frames + sum(each.frames for each in earlier),
            "lost": lost + sum(each.lost for each in earlier),
            "content_id": content_id,
        }

    # --- messages and windows -------------------------------------------------------------------------------------

    def write(self, topic: topics.Topic, message: Any, host_time_ns: int | None = None) -> None:
        """Record a small message, if a recording is open; while it is broken off, the next file takes it."""
        opened = self._open
        if opened is None:
            return
        host_time_ns = self._clock.monotonic_ns() if host_time_ns is None else host_time_ns
        entry = (topic, opened.manifest.wall_anchor_ns + host_time_ns, message.SerializeToString())
        if opened.broken:
            with self._changed:
                if opened.broken:
                    opened.waiting.append(entry)
                    return
        self._capture.write(topic.name, *entry[1:])

    def log(self, text: str, level: Any = Log.Level.INFO) -> None:
        """Record a line of text."""
        now = self._clock.monotonic_ns()
        message = Log(level=level, message=text, name="acquire")
        message.timestamp.FromNanoseconds((self.anchor_ns or 0) + now)
        self.write(topics.LOG, message, now)

    def present(self) -> None:
        """Wait until the recording is, or goes on."""
        self._present()

    def write_strike(self, message: Any) -> None:
        """Record a strike; it is in the process that writes when this returns.

        Raises:
            RecordingBroken: its images lie in a file that broke off, or it came to nothing with the process.
        """
        opened = self._present()
        self._refuse_earlier(opened, message.window_start_ns)
        self.write(topics.SESSION_STRIKE, message)
        try:
            self._capture.status()
        except CaptureGone as error:
            raise RecordingBroken(str(error)) from None

    def require_space(self) -> None:
        """Raise RecorderError where the disk has no room for a window; nothing is asked where no recording is open."""
        if self._open is not None:
            self._asked(self._capture.require_space)

    def open_window(self) -> int:
        """From now on, and from the pre-trigger time before, every image is kept. Its start as a log time."""
        start_ns = self._asked(self._capture.open_window)
        opened = self._present()
        opened.window_part = opened.part
        return start_ns

    def close_window(self, end_ns: int = 0) -> dict[str, Any]:
        """What the window holds.

        Args:
            end_ns: log time at which it may end where that has passed; 0 for now. Late images that nobody needs are not waited for.

        Raises:
            RecordingBroken: it was opened in a file that broke off.
        """
        opened = self._present()
        part, opened.window_part = opened.window_part, None
        if part is not None and part != opened.part:
            raise RecordingBroken(f"the window was cut off: {part_path(opened.path, part).name} ends in it")
        try:
            return asdict(self._capture.close_window(end_ns))
        except CaptureGone as error:
            raise RecordingBroken(f"the window was cut off: {error}") from None

    # --- the capture process died ---------------------------------------------------------------------------------

    def broke_off(self, why: str) -> None:
        """The capture process died; `why` it did."""
        with self._changed:
            opened = self._open
            if opened is None or opened.broken:
                return
            opened.broken = why
            self._drop_watcher(opened)
        self._complain(f"the recording broke off: the capture process {why}")

    def go_on(self) -> None:
        """The capture process is there again: begin the next file."""
        with self._changed:
            opened = self._open
            if opened is None or not opened.broken:
                return
            before, broken = opened.part, opened.broken
            opened.part = _newest_part(opened.path) + 1
            try:
                self._begin(opened)
            except AcquireError as error:
                opened.part = before
                self._ended_by = f"the recording ended: the capture process {broken}, and it could not go on: {error}"
                self._forget(opened)
                said = self._ended_by
            else:
                opened.broken = ""
                file = part_path(opened.path, opened.part)
                said = f"the recording goes on in {file.name}"
                self._salvage_parts(opened, before, lambda: self._first_frame_ns(file))
            self._changed.notify_all()
        self._complain(said)

    def _salvage_parts(self, opened: _Open, first: int, next_frame_ns: Callable[[], int | None]) -> None:
        """Of the files that the dead process wrote, from number `first` to the one before the present."""
        camera = self._config.camera
        files = [part_path(opened.path, number) for number in range(first, opened.part)]
        opened.salvages.append(Salvage(files, camera.name, camera.frame_rate_hz, next_frame_ns, lambda found: self._complain(found.text)))

    def _first_frame_ns(self, file: Path) -> int | None:
        end = time.monotonic() + FIRST_FRAME_S
        while time.monotonic() < end:
            with contextlib.suppress(AcquireError):
                status = self._capture.status()
                if status.recording is None or status.recording.absolute() != file.absolute():
                    return None
                if status.first_frame_ns is not None:
                    return status.first_frame_ns
            time.sleep(0.1)
        return None

    # --- watch ----------------------------------------------------------------------------------------------------

    @property
    def watcher(self) -> Watcher | None:
        """The child that looks at it; None where there is none."""
        opened = self._open
        return opened.watcher if opened is not None else None

    def expect(self, plan_strike_id: str) -> None:
        """Compare placements with this planned strike from now on."""
        opened = self._present()
        opened.expected = plan_strike_id
        if (watcher := opened.watcher) is not None:
            watcher.expect(plan_strike_id)

    def revive_watcher(self) -> None:
        """Start an `analyze watch` that died again, within reason. Returns at once where something else goes on."""
        if not self._changed.acquire(blocking=False):
            return
        try:
            opened = self._open
            if opened is None or (watcher := opened.watcher) is None or watcher.alive or opened.watcher_lives == 0:
                return
            opened.watcher_lives -= 1
            watcher.close()
            if opened.watcher_lives == 0:
                said = "analyze watch keeps ending: the recording goes on without verdicts"
            else:
                self._watch(opened)
                said = "analyze watch ended and was started again"
        finally:
            self._changed.release()
        self._complain(said)

    # --- under the lock -------------------------------------------------------------------------------------------

    def _begin(self, opened: _Open) -> None:
        """The next file, its head, and the process that looks at it."""
        now = self._clock.monotonic_ns()
        anchor = opened.manifest.wall_anchor_ns
        self._capture.open_recording(opened.path, opened.manifest.model_copy(update={"part": opened.part}), opened.attachments)
        opened.began_ns = anchor + now
        camera = self._config.camera
        calibration = calibration_message(camera.calibration).SerializeToString()
        self._capture.write(topics.camera_calibration(camera.name).name, anchor + now, calibration)
        for topic, log_time_ns, data in opened.waiting:
            self._capture.write(topic.name, log_time_ns, data)
        opened.waiting.clear()
        self._watch(opened)

    def _watch(self, opened: _Open) -> None:
        # It follows the row of files; the one before the newest is there for sure, and holds what a strike began in.
        number = max(opened.part, _newest_part(opened.path) - 1)
        opened.watcher = Watcher(Path(f"{part_path(opened.path, number)}{PART_SUFFIX}"), self._on_watch)
        if opened.expected:
            opened.watcher.expect(opened.expected)

    def _drop_watcher(self, opened: _Open) -> None:
        watcher, opened.watcher = opened.watcher, None
        if watcher is not None:
            watcher.close()

    def _forget(self, opened: _Open) -> None:
        self._open = None
        self._drop_watcher(opened)

    # --- waiting --------------------------------------------------------------------------------------------------

    def _none(self) -> AcquireError:
        return RecorderError(self._ended_by) if self._ended_by else SessionError("no recording is open")

    def _present(self) -> _Open:
        """The recording, once it has a file."""
        with self._changed:
            opened = self._open
            if opened is None:
                raise self._none()
            self._changed.wait_for(lambda: not opened.broken or self._open is not opened, GO_ON_S)
            if self._open is not opened:
                raise self._none()
            if opened.broken:
                raise RecorderError(
                    f"the recording broke off, and does not go on: the capture process {opened.broken}: see `acquire status`"
                )
            return opened

    def _asked(self, ask: Callable[[], T]) -> T:
        """What the capture process answers about the recording, once that is or goes on."""

        def asked() -> T:
            self._present()
            return ask()

        return self._patiently(asked)

    def _patiently(self, ask: Callable[[], T]) -> T:
        """What the capture process answers; the next one, where the one that was asked died."""
        end = time.monotonic() + GO_ON_S
        while True:
            try:
                return ask()
            except CaptureGone:
                if time.monotonic() > end:
                    raise
                time.sleep(0.1)  # the daemon notices as soon

    def _refuse_earlier(self, opened: _Open, window_start_ns: int) -> None:
        if opened.part > 1 and 0 < window_start_ns < opened.began_ns and opened.salvages:
            raise RecordingBroken(f"the strike's images lie in a file that broke off, before {part_path(opened.path, opened.part).name}")


def _newest_part(path: Path) -> int:
    """Number of the newest file in the row that begins with `path`, whole or not."""
    newest = 1
    for found in path.parent.glob(f"{path.stem}-????{path.suffix}*"):
        number = found.name.removesuffix(PART_SUFFIX).removeprefix(f"{path.stem}-").removesuffix(path.suffix)
        if number.isdecimal():
            newest = max(newest, int(number))
    return newest
