"""Evidence of strikes: the object struck and the fitted motion of each strike, before any estimate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from analyze.errors import TrackingError
from analyze.flight.toss import TossMotion
from analyze.geometry.bodies import Body
from analyze.geometry.object_model import ObjectModel
from analyze.motion.next_line import carried_strike
from analyze.pipeline.toss_marks import TossMarks
from analyze.tracking.print_likeness import RestView
from analyze.tracking.track import TrackingReport
from analyze.types import ImageFrame, Marker, TipMotion
from schemas.object_spec import ObjectSpec
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import SessionManifest
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.strike_result import USABLE_VERDICTS


@dataclass(frozen=True)
class RecordingHead:
    """Identity of a recording (manifest, hashes, files) and its strike ids, known before images are read."""

    path: Path
    """path of the file that was opened"""
    manifest: SessionManifest
    """metadata of the recording: object, rig, cameras, gravity, hash of the plan"""
    content_id: str
    """hash of the recording's contents, independent of its path; "" if the recording has none"""
    strike_ids: tuple[str, ...] = ()
    """strike ids in the recording's order"""
    toss_ids: tuple[str, ...] = ()
    """toss ids in the recording's order"""
    shape_sha256: str = ""
    """SHA-256 of the shape file; "" for a primitive"""
    files: tuple[str, ...] = ()
    """names of the recording's files"""
    missing_files: tuple[int, ...] = ()
    """numbers of files of the series that were not found"""
    recovery_losses: tuple[str, ...] = ()
    """what `acquire recover` lost, found changed or could not verify; each a line"""
    rig_toml: str | None = None
    """text of the rig file of the session; None if the recording holds none"""
    losses: tuple[str, ...] = ()
    """what `analyze compact` took from the images of its files, and how the strikes changed; each a line"""


@dataclass(frozen=True)
class ImpactMeasurement:
    """Speed [m/s] and height over the table [m] of the striker's tip as it hit the object, as measured."""

    tip_speed: float
    """speed of the striker's tip just before contact [m/s]"""
    height: float
    """height of the striker's tip over the table [m]"""
    commanded_speed: float | None = None
    """tip speed that the striker was ordered to reach [m/s]; None if none was"""


class StrikeSource(Protocol):
    """Recording from which strikes are read, complete or still being written.

    A strike is a filmed hit that tips the object.
    """

    @property
    def path(self) -> Path:
        """Path of the recording, for messages."""
        ...

    @property
    def manifest(self) -> SessionManifest:
        """Manifest (metadata: object, rig, cameras, gravity) of the recording's first file."""
        ...

    @property
    def plan(self) -> StrikePlan:
        """Strike plan that was carried out: rest pose, pivot edge and energy of each planned strike."""
        ...

    @property
    def object_spec(self) -> ObjectSpec:
        """Contents of the object file (mass, shape, markers) as recorded."""
        ...

    @property
    def shape_bytes(self) -> bytes | None:
        """Contents of the object's shape file (mesh or point cloud); None for a box or cylinder."""
        ...

    def frame_meta(self, *, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[pb.FrameMeta]:
        """Yield the metadata record (FrameMeta) of each frame that arrived from the first camera, by time.

        Args:
            start_ns: first log time [ns] to include; None for the recording's start.
            end_ns: last log time [ns] to include; None for the recording's end.
        """
        ...

    def images(self, *, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[ImageFrame]:
        """Yield the first camera's images in order of time, as grey values (height, width) uint8.

        Each comes with its log time [ns] and its number in the recording.

        Args:
            start_ns: first log time [ns] to include; None for the recording's start.
            end_ns: last log time [ns] to include; None for the recording's end.
        """
        ...


@dataclass(frozen=True)
class StruckObject:
    """Object file, shape and plan with which the strikes of a recording are analysed."""

    spec: ObjectSpec
    """object file with the markers' masses included"""
    model: ObjectModel
    """exterior shape, in the object frame O"""
    plan: StrikePlan
    """strike plan with edges corrected to the object file in use"""
    sha256: str
    """hash of the object file in use and its shape"""
    bodies: tuple[Body, ...]
    """closed bodies of the shape's mesh, largest first; empty unless the object's labels name bodies"""
    overridden: bool
    """True if an object file given afterwards replaces the recording's"""


@dataclass(frozen=True)
class StrikeReading:
    """One strike as read from a recording: fitted motion, marker tracking and frames lost.

    A strike is a filmed hit that tips the object.
    """

    record: pb.StrikeRecord
    """the recording's entry of the strike: ids, times, impact"""
    motion: TipMotion
    """motion and fits; with verdict UNREADABLE and no fit if no marker could be tracked, or if the motion is
    a tip only at another frame rate than a video file states"""
    report: TrackingReport | None
    """markers as tracked; None if none could be"""
    problem: TrackingError | None
    """reason why no marker could be tracked; None otherwise"""
    frames_lost: int
    """frames lost within the strike's window"""


def usable_rest_views(readings: Iterable[StrikeReading]) -> dict[str, RestView]:
    """Untagged object at rest by strike id, before each strike that can be used."""
    return {
        reading.record.strike_id: reading.report.rest_view
        for reading in readings
        if reading.motion.verdict in USABLE_VERDICTS
        and reading.report is not None
        and reading.report.rest_view is not None
    }


TossReader = Callable[["StrikeSource", "StruckObject", TossMarks, pb.TossRecord], TossMotion]
"""function that reads one toss: recording, object, marks to follow, and the recording's entry of it"""
StrikeReader = Callable[[StrikeSource, StruckObject, list[Marker], pb.StrikeRecord], StrikeReading]
"""function that reads one strike: recording, object, markers to track, and the recording's entry of it"""


@dataclass(frozen=True)
class Evidence:
    """Motions of all strikes (filmed tips) of one object, with object and plan, before any estimate.

    A motion has a fit if an estimator could fit it. The strikes come from one recording, or from several that
    merge.py merged.
    """

    recordings: tuple[RecordingHead, ...]
    """recordings by start time; at least one"""
    spec: ObjectSpec
    """object file with the markers' masses included"""
    model: ObjectModel
    """exterior shape, in the object frame O"""
    plan: StrikePlan
    """strike plan; for several recordings all their planned strikes, renamed"""
    object_sha256: str
    """hash of the object file in use and its shape"""
    motions: tuple[TipMotion, ...]
    """motions in the order of the recordings"""
    tracking: Mapping[str, TrackingReport] = field(default_factory=dict[str, TrackingReport])
    """marker tracking by strike id, of the strikes with a tracked marker"""
    object_path_used: bool = False
    """True if an object file given afterwards replaces the recording's"""
    frames_lost: Mapping[str, int] = field(default_factory=dict[str, int])
    """frames lost within each strike's window, by strike id"""
    impacts: Mapping[str, ImpactMeasurement] = field(default_factory=dict[str, ImpactMeasurement])
    """impacts by strike id, where the striker measured its speed and height"""
    software: str = "percuss"
    """name and version of the program that read the recordings"""
    recorded_in: Mapping[str, int] = field(default_factory=dict[str, int])
    """index into `recordings` by id of strike or toss; empty for one recording"""
    bodies: tuple[Body, ...] = ()
    """closed bodies of the shape's mesh, largest first; empty unless the object's labels name bodies"""
    choices: Mapping[str, str] = field(default_factory=dict[str, str])
    """reasons for choosing a strike by strike id, where a session that stops itself chose it"""
    camera_poses: Mapping[str, tuple[float, ...]] = field(default_factory=dict[str, tuple[float, ...]])
    """T_world_camera by strike id, 16 numbers row by row, of strikes whose record states a pose of its own"""
    tosses: tuple[TossMotion, ...] = ()
    """tosses in the order of the recordings, with their free flights"""

    @property
    def manifest(self) -> SessionManifest:
        """Manifest (metadata: object, rig, cameras, gravity) of the first recording."""
        return self.recordings[0].manifest

    def recording_of(self, strike_id: str) -> RecordingHead:
        """Head (identity and contents) of the recording that holds the strike with id `strike_id`.

        It is the first recording's if no recording is known for this id.
        """
        return self.recordings[self.recorded_in.get(strike_id, 0)]

    def planned(self, motion: TipMotion) -> PlannedStrike:
        """Planned strike (rest pose, pivot edge, direction on the table) that led to a recorded motion.

        If the object balanced over another line of its shape than the planned edge, and the strike counts for
        that line, the line stands in place of the edge, under a name of its own.

        Raises:
            StopIteration: the plan holds no strike with the id that the motion names.
        """
        planned = next(strike for strike in self.plan.strikes if strike.id == motion.plan_strike_id)
        return planned if motion.carried_by is None else carried_strike(planned, motion.carried_by)
