"""Tosses of a recording: read from the images, estimated together, compared with the strikes' answer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import TrackingError
from analyze.estimation.joint_model import COM, SECOND
from analyze.estimation.strike_data import whitened
from analyze.flight.air_drag import hull_panels
from analyze.flight.estimate import estimate_flights
from analyze.flight.flight_model import ThrownBody
from analyze.flight.toss import TossMotion, analyse_toss
from analyze.flight.toss_fit import FlightPrior
from analyze.flight.views import tag_set
from analyze.geometry.second_moments import log_cholesky, scale_free
from analyze.tracking.camera_model import camera_from_spec
from analyze.tracking.print_flight import PrintFlight
from analyze.tracking.track import MarkerFollower
from analyze.types import FlightEstimate
from schemas.strike_result import FollowedBy
from schemas.toss_result import TossVerdict

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from analyze.estimation.joint import JointSolution
    from analyze.geometry.object_model import ObjectModel
    from analyze.pipeline.evidence import Evidence, StrikeSource, StruckObject
    from analyze.pipeline.toss_marks import TossMarks
    from analyze.types import Array, CameraModel, ImageFrame, Marker
    from schemas.object_spec import ObjectSpec
    from schemas.proto import percuss_pb2 as pb
    from schemas.session_manifest import SessionManifest

RESCAN_FRAMES = 3
"""frames of a toss between full searches for markers: one turns into view within a few"""
LINE_TIME_ERROR = 0.05
"""1 sigma of a stated delay from image row to row, as a share of it"""
MAX_DISAGREEMENT = 30.0
"""largest chi^2 of eight numbers (c and shape of the tensor) between flights and strikes: one in 5 000"""


NO_PRINT = (
    "the object has no tags, and no good strike of this recording shows enough of its print: strike it in the"
    " same session, or glue tags on"
)
"""reason why a toss without tags cannot be read"""


@dataclass(frozen=True)
class FlightAnswer:
    """What the good tosses determine together, and whether the strikes agree."""

    estimate: FlightEstimate
    """c and shape of the tensor, with covariance"""
    drag: Array
    """(2,) coefficients of the air's force and moment"""
    misplaced: dict[int | str, float]
    """distance [m] of markers from their stated places, of those that flights find elsewhere"""
    disagreement: float | None = None
    """chi^2 of the eight numbers against those by strikes alone; None where they were not compared"""
    sd_without: Array | None = None
    """(3, 3) sd of the tensor's entries by strikes alone [kg m^2]; None where not compared"""
    measured_without: NDArray[np.bool_] | None = None
    """(3, 3) True for entries that strikes alone determine; None where not compared"""

    @property
    def agrees(self) -> bool:
        """True unless flights and strikes contradict each other."""
        return self.disagreement is None or self.disagreement <= MAX_DISAGREEMENT


def read_toss(
    recording: StrikeSource,
    struck: StruckObject,
    marks: TossMarks,
    record: pb.TossRecord,
) -> TossMotion:
    """Track the object in the window of a toss, find its free flight, and judge it.

    Args:
        recording: complete recording, or one still being written.
        struck: object, shape and plan.
        marks: what the object is followed by.
        record: the recording's entry of the toss.

    Raises:
        RecordingError: the file is damaged within the window.
    """
    return toss_in_frames(
        (record.toss_id, record.plan_toss_id),
        recording.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns),
        camera_from_spec(recording.manifest.cameras[0].calibration),
        marks,
        *thrown_body(struck.spec, struck.model, recording.manifest),
    )


def toss_in_frames(
    ids: tuple[str, str],
    frames: Iterable[ImageFrame],
    camera: CameraModel,
    marks: TossMarks,
    body: ThrownBody,
    prior: FlightPrior,
) -> TossMotion:
    """Track the object in the frames of a toss, find its free flight, and judge it.

    Args:
        ids: id of the toss in the recording, and of the planned toss.
        frames: frames of the toss's window.
        camera: camera that took them.
        marks: what the object is followed by.
        body: hull, mass and size of the body.
        prior: body as known before.
    """
    markers = marks.markers
    if not markers:
        if not marks.views:
            return TossMotion(*ids, TossVerdict.UNREADABLE, NO_PRINT, followed_by=FollowedBy.PRINT)
        flight = PrintFlight(camera, marks.views)
        tracks, tags = flight.tracks(frames), tag_set(flight.markers, shared_errors=True)
        return analyse_toss(ids, tracks, camera, tags, body, prior, FollowedBy.PRINT)
    follower = MarkerFollower(camera, markers, rescan_every=RESCAN_FRAMES, rigid=True)
    try:
        for frame in frames:
            follower.add(frame)
        tracks = follower.report().tracks
    except TrackingError as error:
        return TossMotion(*ids, TossVerdict.UNREADABLE, str(error))
    return analyse_toss(ids, tracks, camera, tag_set(markers), body, prior)


def thrown_body(
    spec: ObjectSpec, model: ObjectModel, manifest: SessionManifest
) -> tuple[ThrownBody, FlightPrior]:
    """Body before its flights, from object file and shape: hull, mass, gravity, and a uniform solid's tensor.

    Args:
        spec: object file with the markers' masses included.
        model: exterior shape.
        manifest: metadata of the recording, with gravity.
    """
    numbers = log_cholesky(model.unit_inertia)
    prior = FlightPrior(
        model.centroid,
        model.extent,
        scale_free(numbers)[0],
        manifest.g_m_s2,
        max(manifest.g_sd_m_s2, 1e-3),
        _line_time_sd(manifest),
    )
    return ThrownBody(hull_panels(model.hull_vertices), spec.mass_kg, float(numbers[0])), prior


def _line_time_sd(manifest: SessionManifest) -> float:
    """1 sigma of the delay from image row to row beyond that of the calibration [s].

    Where an imported recording's camera states none, it may be a phone's that needs up to the time between
    two frames to read an image.
    """
    camera = manifest.cameras[0]
    stated = abs(camera.calibration.line_time_s)
    if manifest.rig or stated:
        return max(LINE_TIME_ERROR * stated, 1e-9)
    return 1.0 / (camera.frame_rate_hz * camera.calibration.height)


def answer_of_flights(
    evidence: Evidence, markers: list[Marker], exclude: frozenset[str]
) -> FlightAnswer | None:
    """What the good tosses determine together; None without one.

    Flights before different cameras are fitted apart; as they share the errors of the tags' places, their
    estimates are averaged without a gain in certainty (covariance intersection, Julier and Uhlmann 1997).

    Args:
        evidence: tosses of all recordings, with object and shape.
        markers: markers of the object with their places; without any, flights have views of its print.
        exclude: ids of tosses to leave out.
    """
    good = [
        toss
        for toss in evidence.tosses
        if toss.verdict is TossVerdict.GOOD and toss.flight is not None and toss.toss_id not in exclude
    ]
    if not good:
        return None
    groups: dict[int, list[TossMotion]] = {}
    for toss in good:
        groups.setdefault(evidence.recorded_in.get(toss.toss_id, 0), []).append(toss)
    fits = []
    for number, tosses in groups.items():
        manifest = evidence.recordings[number].manifest
        body, prior = thrown_body(evidence.spec, evidence.model, manifest)
        camera = camera_from_spec(manifest.cameras[0].calibration)
        (flight,) = [toss.flight for toss in tosses if toss.flight is not None][:1]
        tags = flight.tags_at(markers)
        fits.append(estimate_flights(tosses, body, prior, camera, tags))
    misplaced = {name: distance for fit in fits for name, distance in fit.misplaced.items()}
    drag = np.mean([fit.drag for fit in fits], axis=0)
    return FlightAnswer(_averaged([fit.estimate for fit in fits]), drag, misplaced)


def _averaged(estimates: Sequence[FlightEstimate]) -> FlightEstimate:
    """Covariance intersection of estimates with equal weights."""
    if len(estimates) == 1:
        return estimates[0]
    precisions = [np.linalg.inv(each.covariance) / len(estimates) for each in estimates]
    covariance = np.linalg.inv(np.sum(precisions, axis=0))
    level = np.sum([p @ each.mean for p, each in zip(precisions, estimates, strict=True)], axis=0)
    tosses = tuple(name for each in estimates for name in each.tosses)
    return FlightEstimate(covariance @ level, covariance, tosses)


def disagreement(flight: FlightEstimate, alone: JointSolution, both: JointSolution) -> float:
    """Chi^2 of tosses against strikes: growth of the strikes' misfit by the flights, plus the flights' own.

    A difference of two linearised estimates would not do: moments about edges depend on products of inertia,
    which strikes leave open, by their squares.

    Args:
        flight: estimate from flights.
        alone: joint solution of the strikes without flights, with a wide prior of the moments.
        both: that of the strikes with the flights, with the same prior and unknowns.
    """

    def misfit(x: Array) -> float:
        z = whitened(alone.model, alone.data, x)[0]
        return float(alone.weight @ np.sum(z**2, axis=1)) / alone.spread + float(
            np.sum(x[SECOND.stop :] ** 2)
        )

    # Leans of the table are in units of their sd, which each solution estimates for itself.
    x = both.x.copy()
    for level in range(len(alone.model.tilts)):
        x[alone.model.tilt_terms(level)] *= both.factors.tilt / alone.factors.tilt
    apart = np.concatenate([both.x[COM], scale_free(both.x[SECOND])[0]]) - flight.mean
    own = float(apart @ np.linalg.solve(flight.covariance, apart))
    return max(misfit(x) - misfit(alone.x) + own, 0.0)
