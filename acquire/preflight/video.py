"""Test video of one second for the checks, recorded by a capture process of its own or by the daemon.

Either way the frames pass through the same stages as in a session: Aravis, the recorder, a file, `analyze
watch` (program that reports markers and motion in the newest image). The recording is read once and deleted.
"""

from __future__ import annotations

import contextlib
import tempfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from acquire.capture.link import CaptureProcess
from acquire.daemon.client import DaemonClient
from acquire.daemon.manifest import OpenCamera, session_files, session_manifest
from acquire.daemon.watcher import Watcher
from acquire.errors import RecorderError
from acquire.recorder.frame_recorder import WindowReport
from schemas.document import canonical_json
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.rig import RecorderConfig
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from schemas.watch_lines import WatchEvent

if TYPE_CHECKING:
    from acquire.clock.clock import Clock
    from schemas.rig import RigConfig
from acquire.preflight.read_video import VideoContent, read_video

CLIP_S = 1.0
"""duration of the test video [s]"""
WATCH_TIMEOUT_S = 12.0
"""time for `analyze watch` to start and to reach the end of the video [s]"""
_POLL_S = 0.1
_MOTION_NS = 1_000_000_000
_END_MARGIN_NS = 200_000_000
"""part at the end of the video [ns] that no report of `analyze watch` need reach; it evaluates an image every
83 ms"""

OBJECT_TOML = """name = "object on the table"
mass_kg = 0.05
mass_sd_kg = 0.01

[shape.box]
size_m = [0.1, 0.1, 0.1]

[[marker]]
id = 0
size_m = 0.03
"""


@dataclass(frozen=True)
class CheckVideo:
    """Test video: duration [s], frames recorded and lost, content, and last event of `analyze watch`.

    The content is the last image and the quality of the frame times. The event is None if there was none.
    """

    seconds: float
    """time from the first frame to the last [s]"""
    frames: int
    """number of frames recorded"""
    lost: int
    """frames lost between camera and disk"""
    content: VideoContent
    event: WatchEvent | None
    """last event of `analyze watch`; None if there was none"""


class VideoSource(ABC):
    """Camera that can record a test video, directly or through the daemon.

    Args:
        rig: configuration of camera and recorder.
        clock: host clock, which also pauses the calling thread.
    """

    def __init__(self, rig: RigConfig, clock: Clock) -> None:
        self._rig = rig
        self._clock = clock

    @abstractmethod
    def open(self) -> str:
        """Start the camera with the rig's settings, unless a daemon holds it, and return a description of it.

        Returns:
            One line of text: make, model, serial number and address of the camera, and "held by the daemon"
            if the daemon holds it.

        Raises:
            AcquireError: camera, settings or capture process failed, or the daemon does not answer.
        """

    @abstractmethod
    def record(self, folder: Path) -> CheckVideo:
        """Record a test video of CLIP_S (1 s) in `folder`, read it and delete it.

        `open` must have been called.

        Returns:
            Duration, frame counts, last image, quality of the frame times, and the last report of `analyze
            watch` (markers seen, whether anything moves).

        Raises:
            AcquireError: the video could not be recorded or read.
        """

    @abstractmethod
    def close(self) -> None:
        """Release the camera unless a daemon holds it; safe at any time, also before `open` and twice."""

    def _record_window(
        self, open_window: Callable[[], object], close_window: Callable[[], WindowReport]
    ) -> WindowReport:
        """Record a window (time span whose frames are kept) of CLIP_S in an open recording.

        The buffer of frames from before a window is filled first: frames missing from it would count as lost.

        Args:
            open_window: opens the window.
            close_window: closes the window and returns the report on it.

        Returns:
            The report: times of the first and last frame, and numbers of frames recorded and lost.
        """
        self._clock.sleep(self._rig.recorder.pre_trigger_s + 0.3)
        open_window()
        self._clock.sleep(CLIP_S)
        return close_window()

    def _watch(self, until_ns: int, state: Callable[[], tuple[bool, WatchEvent | None]]) -> WatchEvent | None:
        """Wait until `analyze watch` has reported on the end of a video, and return its newest report.

        The wait ends at the first report on the end of the video that states rest, or that is at least a
        second later than the first report; also when `analyze watch` ends, and after WATCH_TIMEOUT_S. If
        `analyze watch` starts late it begins with the present, and it needs two images to distinguish rest
        from motion.

        Args:
            until_ns: log time [ns] of the end of the video.
            state: returns whether `analyze watch` runs, and its newest report.

        Returns:
            The newest report (markers seen, whether anything moves); None if there was none.
        """
        end_ns = self._clock.monotonic_ns() + round(WATCH_TIMEOUT_S * 1e9)
        until_ns -= _END_MARGIN_NS
        first_ns: int | None = None
        while True:
            alive, event = state()
            if event is not None:
                first_ns = event.time_ns if first_ns is None else first_ns
                settled = event.at_rest or event.time_ns >= first_ns + _MOTION_NS
                alive = alive and not (event.time_ns >= until_ns and settled)
            if not alive or self._clock.monotonic_ns() > end_ns:
                return event
            self._clock.sleep(_POLL_S)

    def _video(self, report: WindowReport, event: WatchEvent | None, written: Path) -> CheckVideo:
        """Test video: duration [s], frame counts, content of its file, and report of `analyze watch`.

        Args:
            report: times and frame counts of its recording window.
            event: newest report of `analyze watch` on it; None if there was none.
            written: path of its finished recording, which is read.
        """
        content = read_video(written, self._rig.camera.name)
        seconds = (report.end_ns - report.start_ns) * 1e-9
        return CheckVideo(seconds, report.frames, report.lost, content, event)


class OwnCapture(VideoSource):
    """Source of test videos with a capture process of its own, started as the daemon would start it."""

    def __init__(self, rig: RigConfig, clock: Clock) -> None:
        # The disk's reserve is checked separately. After the window, `analyze watch` sees only the previews.
        given = rig.recorder
        recorder = RecorderConfig(
            directory=given.directory, pre_trigger_s=given.pre_trigger_s, preview_hz=4.0, disk_reserve_bytes=0
        )
        super().__init__(rig.model_copy(update={"recorder": recorder}), clock)
        self._capture = CaptureProcess(self._rig)

    def open(self) -> str:
        """Start capture process and camera; return a description of the camera.

        Returns:
            One line of text: "MAKE MODEL (SERIAL NUMBER) at ADDRESS".

        Raises:
            AcquireError: camera, settings or capture process failed.
        """
        self._info = self._capture.start()
        return f"{self._info.vendor} {self._info.model} ({self._info.serial}) at {self._info.address}"

    def record(self, folder: Path) -> CheckVideo:
        """Record a test video of CLIP_S (1 s) in `folder`, read it and delete it.

        In any case the capture process ends before the temporary folder with the video is deleted.

        Returns:
            Duration, frame counts, last image, quality of the frame times, and the last report of `analyze
            watch` (markers seen, whether anything moves).

        Raises:
            AcquireError: the video could not be recorded or read.
        """
        capture = self._capture
        with _temporary(folder) as path, contextlib.closing(self):
            # The camera's clock is latched every half second, and the mapping needs a few latches.
            self._clock.sleep(1.0)
            files = session_files({"object_toml": OBJECT_TOML, "plan_json": placeholder_plan()}, "")
            anchor_ns = self._clock.wall_ns() - self._clock.monotonic_ns()
            manifest = session_manifest(
                self._rig, OpenCamera(self._info, clock_latched=False), files, anchor_ns
            )
            capture.open_recording(path, manifest, list(files.attachments))
            report = self._record_window(capture.open_window, capture.close_window)
            watcher = Watcher(Path(f"{path}.part"), lambda _: None)
            with contextlib.closing(watcher):
                event = self._watch(report.end_ns, lambda: (watcher.alive, watcher.latest))
            return self._video(report, event, capture.close_recording().path)

    def close(self) -> None:
        """End the capture process, which releases the camera; safe at any time."""
        self._capture.stop()


class DaemonCapture(VideoSource):
    """Source of test videos that the running daemon records, like a session without a strike."""

    def __init__(self, rig: RigConfig, client: DaemonClient, clock: Clock) -> None:
        super().__init__(rig, clock)
        self._client = client

    def open(self) -> str:
        """Return a description of the daemon's camera; nothing is started.

        Returns:
            One line of text: "MAKE MODEL (SERIAL NUMBER) at ADDRESS, held by the daemon".

        Raises:
            AcquireError: the daemon does not answer.
        """
        camera = self._client.call("status")["camera"]
        name = f"{camera['vendor']} {camera['model']} ({camera['serial']})"
        return f"{name} at {self._rig.camera.address}, held by the daemon"

    def record(self, folder: Path) -> CheckVideo:
        """Record a test video of CLIP_S (1 s) in `folder` through the daemon, read it and delete it.

        Returns:
            Duration, frame counts, last image, quality of the frame times, and the last report of `analyze
            watch` (markers seen, whether anything moves).

        Raises:
            AcquireError: the video could not be recorded or read.
        """
        call = self._client.call
        with _temporary(folder) as path:
            call(
                "recording.open",
                path=str(path.absolute()),
                object_toml=OBJECT_TOML,
                plan_json=placeholder_plan(),
            )
            try:
                report = self._record_window(
                    lambda: call("window.open"), lambda: WindowReport(**call("window.close"))
                )
                event = self._watch(report.end_ns, self._watch_state)
            finally:
                written = call("recording.close")["path"]
            return self._video(report, event, Path(written))

    def close(self) -> None:
        """Do nothing; the daemon keeps the camera."""

    def _watch_state(self) -> tuple[bool, WatchEvent | None]:
        answer = self._client.call("watch.latest")
        return answer["alive"], WatchEvent.model_validate(answer["event"]) if answer["event"] else None


@contextmanager
def _temporary(folder: Path) -> Iterator[Path]:
    """Context that yields a path for the test video, in a temporary folder that is deleted at the end.

    Args:
        folder: existing folder in which the temporary one is created.

    Raises:
        RecorderError: no folder can be created there.
    """
    try:
        place = tempfile.TemporaryDirectory(prefix=".check-", dir=folder)
    except OSError as error:
        raise RecorderError(f"{folder}: cannot record here: {error.strerror}") from None
    with place as name:
        yield Path(name) / "video.mcap"


def placeholder_plan() -> str:
    """Strike plan (JSON text) with one strike that is never carried out; every recording needs a plan."""
    unit = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    strike = PlannedStrike(
        id="none",
        plane_id="none",
        axis_id="none",
        R_world_object=unit,
        p_world_object=[0.0, 0.0, 0.05],
        pivot=Pivot(point=[0.05, 0.0, -0.05], direction=[0.0, 1.0, 0.0], radius_m=0.0, sd_m=0.001),
        impact=Impact(point=[-0.05, 0.0, 0.0], direction=[1.0, 0.0, 0.0]),
        impact_height_m=0.05,
        impulse_n_s=Range(min=0.0, target=0.0, max=0.0),
        tip_speed_m_s=Range(min=0.0, target=0.0, max=0.0),
        energy_ratio=1.0,
        phi_predicted_rad=0.0,
        phi_predicted_sd_rad=0.0,
        i_edge_predicted_kg_m2=1e-4,
        visible_markers=[0],
        camera_pose=[[*row, 0.0] for row in unit] + [[0.0, 0.0, 0.0, 1.0]],
        friction_needed=0.0,
    )
    spec = parse_object_spec(OBJECT_TOML, "check")
    digest = object_sha256(spec, None)
    return canonical_json(StrikePlan(object_name=spec.name, object_sha256=digest, strikes=[strike]))
