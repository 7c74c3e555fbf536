"""Test video of one second for the checks, recorded by their own capture process or by the daemon.

Either way the frames pass through the same stages as in a session: Aravis, the recorder, a file, `analyze
watch`. The recording is read once and deleted.
"""

from __future__ import annotations

import contextlib
import tempfile
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from acquire.capture.link import CaptureProcess
from acquire.config import RecorderConfig
from acquire.daemon.client import DaemonClient
from acquire.daemon.watcher import Watcher
from acquire.errors import RecorderError
from acquire.recorder.recover.rewrite import mapped, read_layout
from schemas import topics
from schemas.document import canonical_json, sha256_text
from schemas.mcap.walk import walk_chunks, walk_messages
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import ManifestCamera, SessionManifest, TimeSource
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from schemas.watch_lines import WatchEvent

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
    from acquire.config import RigConfig

CLIP_S = 1.0
"""duration of the test video"""
WATCH_TIMEOUT_S = 12.0
"""time for `analyze watch` to start and to reach the end of the video"""
_POLL_S = 0.1
_MOTION_NS = 1_000_000_000
_END_MARGIN_NS = 200_000_000
"""margin at the end of the video; `analyze watch` evaluates an image every 83 ms"""

OBJECT_TOML = """name = "object on the table"
mass_kg = 0.05
mass_sd_kg = 0.01

[shape.box]
size_m = [0.1, 0.1, 0.1]

[[marker]]
id = 0
size_m = 0.03
"""


class _WatchEnd:
    """Condition that ends the wait for `analyze watch` to report on the test video.

    The wait ends at the first report on the end of the video that states rest, or that is at least a second
    later than the first report. If `analyze watch` starts late it begins with the present, and it needs two
    images to distinguish rest from motion.

    Args:
        until_ns: log time [ns] that counts as the end of the video.
    """

    def __init__(self, until_ns: int) -> None:
        self._until_ns = until_ns
        self._first_ns: int | None = None

    def is_done(self, event: WatchEvent) -> bool:
        """True if no report of `analyze watch` after `event`, the newest one, is needed."""
        if self._first_ns is None:
            self._first_ns = event.time_ns
        return event.time_ns >= self._until_ns and (
            event.at_rest or event.time_ns >= self._first_ns + _MOTION_NS
        )


@dataclass(frozen=True)
class VideoContent:
    """Content of a test video's recording: the last image and the quality of the frame times."""

    image: NDArray[np.uint8]
    """(height, width) last image"""
    clock_samples: int
    """number of readings of the camera's clock; 0 if it cannot be latched"""
    mapping_sd_ns: int
    """standard deviation of the frame times on the host's clock; 0 if unknown"""


@dataclass(frozen=True)
class CheckVideo:
    """Test video: duration, frame counts, content and the last report of `analyze watch`."""

    seconds: float
    """time from the first frame to the last"""
    frames: int
    """number of frames recorded"""
    lost: int
    """frames lost between camera and disk"""
    content: VideoContent
    event: WatchEvent | None
    """last event of `analyze watch`; None if there was none"""


class VideoSource(Protocol):
    """Camera that can record a test video, directly or through the daemon."""

    def open(self) -> str:
        """Start the camera with the rig's settings and return a description of it.

        Raises:
            AcquireError: camera, settings or capture process failed.
        """
        ...

    def record(self, folder: Path) -> CheckVideo:
        """Record a test video in `folder`, read it and delete it.

        Raises:
            AcquireError: the video could not be recorded or read.
        """
        ...

    def close(self) -> None:
        """Release the camera; safe at any time, also before `open` and more than once."""
        ...


class OwnCapture:
    """Test video through a capture process of its own, started as the daemon would start it."""

    def __init__(self, rig: RigConfig, clock: Clock) -> None:
        # The disk's reserve is checked separately. After the window, `analyze watch` sees only the previews.
        given = rig.recorder
        recorder = RecorderConfig(
            directory=given.directory, pre_trigger_s=given.pre_trigger_s, preview_hz=4.0, disk_reserve_bytes=0
        )
        self._rig = rig.model_copy(update={"recorder": recorder})
        self._clock = clock
        self._capture = CaptureProcess(self._rig)

    def open(self) -> str:
        """Start the capture process and the camera; return the camera's make, model, serial and address.

        Raises:
            AcquireError: camera, settings or capture process failed.
        """
        info = self._capture.start()
        return f"{info.vendor} {info.model} ({info.serial}) at {info.address}"

    def record(self, folder: Path) -> CheckVideo:
        """Record a test video in `folder`, read it and delete it.

        In any case the capture process ends before the temporary folder is deleted.

        Raises:
            AcquireError: the video could not be recorded or read.
        """
        with _temporary(folder) as path, contextlib.closing(self):
            # The camera's clock is latched every half second, and the mapping needs a few latches.
            self._clock.sleep(1.0)
            plan = placeholder_plan()
            attachments = [
                ("object.toml", "application/toml", OBJECT_TOML.encode()),
                ("plan.json", "application/json", plan.encode()),
            ]
            self._capture.open_recording(path, self._manifest(plan), attachments)
            self._clock.sleep(fill_s(self._rig))
            self._capture.open_window()
            self._clock.sleep(CLIP_S)
            report = self._capture.close_window()
            event = self._watch(Path(f"{path}.part"), report.end_ns - _END_MARGIN_NS)
            written = self._capture.close_recording().path
            content = read_video(written, self._rig.camera.name)
        return CheckVideo(
            (report.end_ns - report.start_ns) * 1e-9, report.frames, report.lost, content, event
        )

    def close(self) -> None:
        """End the capture process, which releases the camera; safe at any time."""
        self._capture.stop()

    def _watch(self, part: Path, until_ns: int) -> WatchEvent | None:
        finished, end = threading.Event(), _WatchEnd(until_ns)
        watcher = Watcher(part, lambda event: finished.set() if end.is_done(event) else None)
        try:
            end_ns = self._clock.monotonic_ns() + round(WATCH_TIMEOUT_S * 1e9)
            while not finished.wait(_POLL_S) and watcher.alive and self._clock.monotonic_ns() < end_ns:
                pass
            return watcher.latest
        finally:
            watcher.close()

    def _manifest(self, plan: str) -> SessionManifest:
        spec = parse_object_spec(OBJECT_TOML, "check")
        camera = self._rig.camera
        return SessionManifest(
            recording_id=str(uuid.uuid4()),
            created="1970-01-01T00:00:00+00:00",
            software="acquire check",
            wall_anchor_ns=self._clock.wall_ns() - self._clock.monotonic_ns(),
            time_source=TimeSource.HOST_ARRIVAL,
            time_source_sd_ns=1_000_000,
            g_m_s2=self._rig.g_m_s2,
            g_sd_m_s2=self._rig.g_sd_m_s2,
            gravity_tilt_sd_rad=self._rig.gravity_tilt_sd_rad,
            cameras=[
                ManifestCamera(
                    name=camera.name,
                    frame_rate_hz=camera.frame_rate_hz,
                    exposure_us=camera.exposure_us,
                    calibration=camera.calibration,
                )
            ],
            object=spec,
            object_sha256=object_sha256(spec, None),
            plan_sha256=sha256_text(plan),
        )


class DaemonCapture:
    """Test video through the running daemon, recorded like a session without a strike."""

    def __init__(self, rig: RigConfig, client: DaemonClient, clock: Clock) -> None:
        self._rig, self._client, self._clock = rig, client, clock

    def open(self) -> str:
        """Return make, model, serial and address of the camera that the daemon holds; nothing is started.

        Raises:
            AcquireError: the daemon does not answer.
        """
        camera = self._client.call("status")["camera"]
        name = f"{camera['vendor']} {camera['model']} ({camera['serial']})"
        return f"{name} at {self._rig.camera.address}, held by the daemon"

    def record(self, folder: Path) -> CheckVideo:
        """Record a test video in `folder` through the daemon, read it and delete it.

        Raises:
            AcquireError: the video could not be recorded or read.
        """
        with _temporary(folder) as path:
            call = self._client.call
            call(
                "recording.open",
                path=str(path.absolute()),
                object_toml=OBJECT_TOML,
                plan_json=placeholder_plan(),
            )
            try:
                self._clock.sleep(fill_s(self._rig))
                call("window.open")
                self._clock.sleep(CLIP_S)
                report = call("window.close")
                event = self._watch(report["end_ns"] - _END_MARGIN_NS)
            finally:
                written = call("recording.close")["path"]
            content = read_video(Path(written), self._rig.camera.name)
        return CheckVideo(
            (report["end_ns"] - report["start_ns"]) * 1e-9, report["frames"], report["lost"], content, event
        )

    def close(self) -> None:
        """Do nothing; the daemon keeps the camera."""

    def _watch(self, until_ns: int) -> WatchEvent | None:
        end_ns, end = self._clock.monotonic_ns() + round(WATCH_TIMEOUT_S * 1e9), _WatchEnd(until_ns)
        while True:
            answer = self._client.call("watch.latest")
            event = WatchEvent.model_validate(answer["event"]) if answer["event"] else None
            late = self._clock.monotonic_ns() > end_ns
            if (event is not None and end.is_done(event)) or not answer["alive"] or late:
                return event
            self._clock.sleep(_POLL_S)


def fill_s(rig: RigConfig) -> float:
    """Time [s] until a recording's pre-trigger buffer is full, with a margin.

    Frames missing from the buffer would count as lost.
    """
    return rig.recorder.pre_trigger_s + 0.3


@contextmanager
def _temporary(folder: Path) -> Iterator[Path]:
    try:
        place = tempfile.TemporaryDirectory(prefix=".check-", dir=folder)
    except OSError as error:
        raise RecorderError(f"{folder}: cannot record here: {error.strerror}") from None
    with place as name:
        yield Path(name) / "video.mcap"


def read_video(path: Path, camera: str) -> VideoContent:
    """Last image, number of clock readings and mapping error of a finished recording of one camera.

    Args:
        path: the recording.
        camera: name of the camera in its topics.

    Raises:
        RecorderError: the file is not a whole recording, or holds no image or one that cannot be read.
        ContainerError: a chunk of the file is damaged.
    """
    image, clock_samples, mapping_sd_ns = b"", 0, 0
    with mapped(path) as data:
        layout = read_layout(path, data)
        names = layout.topics
        for messages in walk_chunks(data[: layout.data_end]):
            for _, message in walk_messages(messages):
                name = names.get(message.channel_id)
                if name == topics.raw_image(camera).name:
                    image = message.data
                elif name == topics.frame_meta(camera).name:
                    mapping_sd_ns = pb.FrameMeta.FromString(bytes(message.data)).mapping_sd_ns
                elif name == topics.CLOCK_SAMPLE.name:
                    clock_samples += (
                        pb.ClockSample.FromString(bytes(message.data)).clock == f"camera/{camera}"
                    )
        if not image:
            raise RecorderError(f"{path}: the test video holds no image: check that the camera sends frames")
        return VideoContent(_decode_image(path, bytes(image)), clock_samples, mapping_sd_ns)


def _decode_image(path: Path, data: bytes) -> NDArray[np.uint8]:
    """Grey image (height, width) from a serialised RawImage or CompressedImage message.

    The two are distinguished by content: CompressedImage has its format where RawImage has no such text.

    Raises:
        RecorderError: the message is neither; `path` names the recording in the message.
    """
    with contextlib.suppress(ValueError, TypeError):
        raw = RawImage.FromString(data)
        if raw.encoding == "mono8" and len(raw.data) == raw.step * raw.height:
            return np.frombuffer(raw.data, np.uint8).reshape(raw.height, raw.step)[:, : raw.width]
    with contextlib.suppress(ValueError, TypeError, cv2.error):
        png = cv2.imdecode(
            np.frombuffer(CompressedImage.FromString(data).data, np.uint8), cv2.IMREAD_GRAYSCALE
        )
        if png is not None:
            return png.astype(np.uint8)
    raise RecorderError(f"{path}: the test video's image cannot be read: run `acquire check` again")


def placeholder_plan() -> str:
    """Strike plan (JSON) with one strike that is never made; every recording needs a plan."""
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
