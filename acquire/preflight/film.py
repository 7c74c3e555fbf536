"""A second of film for the checks: through a capture process and a watcher of our own, or through the daemon that already runs.

Either way the frames go the way of a session's: Aravis, the recorder, a file, `analyze watch`. The recording is read once and removed.
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
from acquire.daemon.api import DaemonClient
from acquire.daemon.watcher import Watcher
from acquire.errors import RecorderError
from acquire.recorder.recover.rewrite import mapped, read_layout
from schemas import topics
from schemas.document import canonical_json, sha256_text
from schemas.mcap import records as container
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import ManifestCamera, SessionManifest, TimeSource
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from schemas.watch_lines import WatchEvent

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.clock.clock import Clock
    from acquire.config import RigConfig

FILM_S = 1.0
WATCH_S = 12.0
"""how long `analyze watch` may take to start and to see the end of the film"""
_POLL_S = 0.1
_LOOK_NS = 1_000_000_000
_EDGE_NS = 200_000_000
"""an image is looked at every 83 ms"""

OBJECT_TOML = """name = "whatever stands there"
mass_kg = 0.05
mass_sd_kg = 0.01

[shape.box]
size_m = [0.1, 0.1, 0.1]

[[marker]]
id = 0
size_m = 0.03
"""


class _Look:
    """When `analyze watch` has said enough: at the film's end, that nothing moves; or for a second, that something does.

    A watcher that comes up late begins with the present, and tells rest from motion only with the second image it looks at.
    """

    def __init__(self, until_ns: int) -> None:
        self._until_ns = until_ns
        self._first_ns: int | None = None

    def is_done(self, event: WatchEvent) -> bool:
        """Whether this event, the newest, is the last that is needed."""
        if self._first_ns is None:
            self._first_ns = event.time_ns
        return event.time_ns >= self._until_ns and (event.at_rest or event.time_ns >= self._first_ns + _LOOK_NS)


@dataclass(frozen=True)
class FilmContent:
    """What the recording of a film holds."""

    image: NDArray[np.uint8]
    """(height, width), the last one"""
    clock_samples: int
    """readings of the camera's own clock; 0: it cannot be latched"""
    mapping_sd_ns: int
    """1 sigma of the frames' times on the host's clock; 0 = not known"""


@dataclass(frozen=True)
class Film:
    """What a second of film showed."""

    seconds: float
    """from its first frame to its last"""
    frames: int
    lost: int
    """on the way from the camera, or before the disk"""
    content: FilmContent
    event: WatchEvent | None
    """what `analyze watch` said of it; None: nothing"""


class Filming(Protocol):
    """A camera that can be filmed with."""

    def open(self) -> str:
        """Start the camera with the rig's settings; who it is.

        Raises:
            AcquireError: what the camera, its settings, or the capture process say.
        """
        ...

    def shoot(self, folder: Path) -> Film:
        """A second of film by way of a recording in `folder`, which is removed.

        Raises:
            AcquireError: it could not be recorded or read.
        """
        ...

    def close(self) -> None:
        """Release the camera. Always safe."""
        ...


class OwnCapture:
    """Films through a capture process of its own, as the daemon would."""

    def __init__(self, rig: RigConfig, clock: Clock) -> None:
        # The reserve has a line of its own, and previews are what the watcher goes on looking at.
        given = rig.recorder
        recorder = RecorderConfig(directory=given.directory, pre_trigger_s=given.pre_trigger_s, preview_hz=4.0, disk_reserve_bytes=0)
        self._rig = rig.model_copy(update={"recorder": recorder})
        self._clock = clock
        self._capture = CaptureProcess(self._rig)

    def open(self) -> str:
        """See Filming."""
        info = self._capture.start()
        return f"{info.vendor} {info.model} ({info.serial}) at {info.address}"

    def shoot(self, folder: Path) -> Film:
        """See Filming. The capture ends before the folder goes, however this ends."""
        with _temporary(folder) as path, contextlib.closing(self):
            # One latch comes every half second, and the mapping needs a few.
            self._clock.sleep(1.0)
            plan = placeholder_plan()
            attachments = [("object.toml", "application/toml", OBJECT_TOML.encode()), ("plan.json", "application/json", plan.encode())]
            self._capture.open_recording(path, self._manifest(plan), attachments)
            self._clock.sleep(fill_s(self._rig))
            self._capture.open_window()
            self._clock.sleep(FILM_S)
            report = self._capture.close_window()
            event = self._watch(Path(f"{path}.part"), report.end_ns - _EDGE_NS)
            written = self._capture.close_recording().path
            content = read_film(written, self._rig.camera.name)
        return Film((report.end_ns - report.start_ns) * 1e-9, report.frames, report.lost, content, event)

    def close(self) -> None:
        """See Filming."""
        self._capture.stop()

    def _watch(self, part: Path, until_ns: int) -> WatchEvent | None:
        seen, look = threading.Event(), _Look(until_ns)
        watcher = Watcher(part, lambda event: seen.set() if look.is_done(event) else None)
        try:
            end_ns = self._clock.monotonic_ns() + round(WATCH_S * 1e9)
            while not seen.wait(_POLL_S) and watcher.alive and self._clock.monotonic_ns() < end_ns:
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
                    name=camera.name, frame_rate_hz=camera.frame_rate_hz, exposure_us=camera.exposure_us, calibration=camera.calibration
                )
            ],
            object=spec,
            object_sha256=object_sha256(spec, None),
            plan_sha256=sha256_text(plan),
        )


class DaemonCapture:
    """Films through the daemon, as a session without a strike."""

    def __init__(self, rig: RigConfig, client: DaemonClient, clock: Clock) -> None:
        self._rig, self._client, self._clock = rig, client, clock

    def open(self) -> str:
        """See Filming."""
        camera = self._client.call("status")["camera"]
        return f"{camera['vendor']} {camera['model']} ({camera['serial']}) at {self._rig.camera.address}, held by the daemon"

    def shoot(self, folder: Path) -> Film:
        """See Filming."""
        with _temporary(folder) as path:
            call = self._client.call
            call("recording.open", path=str(path.absolute()), object_toml=OBJECT_TOML, plan_json=placeholder_plan())
            try:
                self._clock.sleep(fill_s(self._rig))
                call("window.open")
                self._clock.sleep(FILM_S)
                report = call("window.close")
                event = self._watch(report["end_ns"] - _EDGE_NS)
            finally:
                written = call("recording.close")["path"]
            content = read_film(Path(written), self._rig.camera.name)
        return Film((report["end_ns"] - report["start_ns"]) * 1e-9, report["frames"], report["lost"], content, event)

    def close(self) -> None:
        """The daemon keeps the camera."""

    def _watch(self, until_ns: int) -> WatchEvent | None:
        end_ns, look = self._clock.monotonic_ns() + round(WATCH_S * 1e9), _Look(until_ns)
        while True:
            answer = self._client.call("watch.latest")
            event = WatchEvent.model_validate(answer["event"]) if answer["event"] else None
            if (event is not None and look.is_done(event)) or not answer["alive"] or self._clock.monotonic_ns() > end_ns:
                return event
            self._clock.sleep(_POLL_S)


def fill_s(rig: RigConfig) -> float:
    """How long a recording must run before its pre-trigger holds all that a window asks for, or that would count as lost [s]."""
    return rig.recorder.pre_trigger_s + 0.3


@contextmanager
def _temporary(folder: Path) -> Iterator[Path]:
    try:
        place = tempfile.TemporaryDirectory(prefix=".check-", dir=folder)
    except OSError as error:
        raise RecorderError(f"{folder}: nothing can be recorded there: {error.strerror}") from None
    with place as name:
        yield Path(name) / "film.mcap"


def read_film(path: Path, camera: str) -> FilmContent:
    """Read a finished recording.

    Raises:
        RecorderError: it holds none.
    """
    image, clock_samples, mapping_sd_ns = b"", 0, 0
    with mapped(path) as data:
        layout = read_layout(path, data)
        names = {number: channel.topic for number, channel in layout.channels.items()}
        for opcode, _, body in container.walk(data[: layout.data_end], len(container.MAGIC)):
            if opcode != container.CHUNK:
                continue
            for kind, _, record in container.walk(container.chunk_messages(container.parse_chunk(body))):
                if kind != container.MESSAGE:
                    continue
                message = container.parse_message(record)
                name = names.get(message.channel_id)
                if name == topics.raw_image(camera).name:
                    image = message.data
                elif name == topics.frame_meta(camera).name:
                    mapping_sd_ns = pb.FrameMeta.FromString(bytes(message.data)).mapping_sd_ns
                elif name == topics.CLOCK_SAMPLE.name:
                    clock_samples += pb.ClockSample.FromString(bytes(message.data)).clock == f"camera/{camera}"
        if not image:
            raise RecorderError(f"{path}: the film holds no image: check that the camera sends frames")
        return FilmContent(_decoded(path, bytes(image)), clock_samples, mapping_sd_ns)


def _decoded(path: Path, data: bytes) -> NDArray[np.uint8]:
    """An image message of either kind. CompressedImage has its format where RawImage has no such text."""
    with contextlib.suppress(ValueError, TypeError):
        raw = RawImage.FromString(data)
        if raw.encoding == "mono8" and len(raw.data) == raw.step * raw.height:
            return np.frombuffer(raw.data, np.uint8).reshape(raw.height, raw.step)[:, : raw.width]
    with contextlib.suppress(ValueError, TypeError, cv2.error):
        png = cv2.imdecode(np.frombuffer(CompressedImage.FromString(data).data, np.uint8), cv2.IMREAD_GRAYSCALE)
        if png is not None:
            return png.astype(np.uint8)
    raise RecorderError(f"{path}: the film's image cannot be read")


def placeholder_plan() -> str:
    """A plan whose strike is never made: a recording needs one."""
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
    return canonical_json(StrikePlan(object_name=spec.name, object_sha256=object_sha256(spec, None), strikes=[strike]))
