"""One toss: its free flight found in the images' tracks, fitted, and judged."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.flight.flight_model import COM, SHAPE
from analyze.flight.free_stretch import free_stretch, grown_flight
from analyze.flight.views import tag_set, toss_views
from analyze.geometry.second_moments import unit_inertia, with_size
from analyze.motion.body_motion import BodyMotion
from schemas.strike_result import FollowedBy
from schemas.toss_result import TossVerdict
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.flight.flight_model import ThrownBody, TossStart
    from analyze.flight.toss_fit import FlightPrior, TossFit
    from analyze.flight.views import TagSet, TossViews
    from analyze.types import Array, CameraModel, Marker, MarkerTrack

MIN_FLIGHT_S = 0.3
"""least time in free flight and in view [s]"""
MIN_TURNS_PER_S = 1.5
"""least spin [turns/s]"""
MIN_AXIS_ANGLE_RAD = np.radians(5.0)
"""least angle between the spin and a principal axis of inertia [rad]"""
MIN_SEEN_SHARE = 0.6
"""least share of the flight's frames in which a tag was found"""
MAX_VARIANCE = 6.0
"""largest variance of the corners about the fitted flight, over their own, of one rigid body"""
_COARSENESS = {FollowedBy.TAGS: (1.0,), FollowedBy.PRINT: (2.0, 6.0)}
"""errors of a body's place by one view, over those by a tag, with which a flight is looked for, in order"""
_UNSEEN = {
    FollowedBy.TAGS: "no marker whose place is known was seen",
    FollowedBy.PRINT: "the print that the strikes showed was not found: toss it so that these sides face the"
    " camera, or glue tags on",
}
"""reasons why a toss shows nothing"""
_MISPLACED = {
    FollowedBy.TAGS: "a marker is not where the object file says",
    FollowedBy.PRINT: "a strike was put down otherwise than on its card",
}
"""reasons of a misfit besides contents that move"""
_DISTINCT = 0.03
"""least difference of two principal moments, as a fraction of the largest, for an axis of its own"""


@dataclass(frozen=True)
class FittedFlight:
    """Views of a free flight, and the fit to it alone, from which a fit of several begins."""

    views: TossViews
    """views of the flight's frames"""
    tags: TagSet
    """tags, or views of the object's print, by which it was followed, at their stated places"""
    start: TossStart
    """motion at the first frame"""
    shared: Array
    """unknowns of the body and its tags, as in `flight_model`"""
    residual_px: float
    """rms difference between corners and fitted flight [px]"""
    path: BodyMotion
    """poses of the object frame O in W at the frames' times"""

    def tags_at(self, markers: Sequence[Marker]) -> TagSet:
        """Tags at the present places of an object's markers; without any, the views of its print."""
        return tag_set(markers) if markers else self.tags


@dataclass(frozen=True)
class TossMotion:
    """Free flight in one toss, with its verdict."""

    toss_id: str
    """id of the toss in the recording"""
    plan_toss_id: str
    """id of the planned toss"""
    verdict: TossVerdict
    """outcome"""
    reason: str
    """explanation of the verdict, one sentence with the figures behind it"""
    flight: FittedFlight | None = None
    """the free flight; None if there is none"""
    turns_per_s: float | None = None
    """mean spin [turns/s]"""
    axis_angle: float | None = None
    """angle between the mean spin and the nearest principal axis of inertia [rad]; None if two principal
    moments are too alike"""
    followed_by: FollowedBy = FollowedBy.TAGS
    """what the object was followed by"""

    @property
    def flight_s(self) -> float | None:
        """Time in free flight and in view [s]; None without a flight."""
        return None if self.flight is None else float(self.flight.views.seconds[-1])


def analyse_toss(
    ids: tuple[str, str],
    tracks: Sequence[MarkerTrack],
    camera: CameraModel,
    tags: TagSet,
    body: ThrownBody,
    prior: FlightPrior,
    followed_by: FollowedBy = FollowedBy.TAGS,
) -> TossMotion:
    """Find the free flight in the tracks of a toss, fit it and judge it.

    Args:
        ids: id of the toss in the recording, and of the planned toss.
        tracks: tracks of the object's markers, or views of its print, in the window of the toss.
        camera: camera that took the frames.
        tags: those of the object's markers whose place on it is known, or the views.
        body: hull, mass and size of the body.
        prior: body as known before.
        followed_by: kind of the tracks: tags or print.
    """
    views = toss_views(tracks, camera, tags)
    if not len(views):
        return TossMotion(*ids, TossVerdict.MARKER_LOST, _UNSEEN[followed_by], followed_by=followed_by)
    flown = None
    for coarseness in _COARSENESS[followed_by]:
        stretch = free_stretch(views, tags, camera, prior, coarseness)
        flown = None if stretch is None else grown_flight(body, prior, camera, tags, views, stretch)
        if flown is not None:
            break
    if flown is None:
        total = counted(max(track.frames_total for track in tracks), "frame")
        seen = f"it was found in {len(views)} of {total}"
        text = f"nowhere does the object move as in free fall ({seen}): throw it so that it flies in view"
        return TossMotion(*ids, TossVerdict.NOT_FREE, text, followed_by=followed_by)
    return replace(_judged(ids, *flown, _MISPLACED[followed_by]), followed_by=followed_by)


def _judged(ids: tuple[str, str], views: TossViews, fit: TossFit, misplaced: str) -> TossMotion:
    """Verdict of a flight by its length, spin, views and residuals; `misplaced` is a reason of a misfit."""
    path = fit.model.paths(fit.x)[0]
    spin = path.spin.mean(axis=0)
    turns = float(np.linalg.norm(path.spin, axis=1).mean()) / (2 * np.pi)
    angle = _axis_angle(spin, unit_inertia(with_size(fit.x[SHAPE], fit.model.body.log_size))[0])
    duration = 1e-9 * float(views.time_ns[-1] - views.time_ns[0])
    spacing = float(np.median(np.diff(views.time_ns))) * 1e-9
    seen = len(views) * spacing / max(duration + spacing, spacing)
    verdict, text = TossVerdict.GOOD, f"{duration:.2f} s in the air, {turns:.1f} turns a second"
    if duration < MIN_FLIGHT_S:
        verdict = TossVerdict.SHORT
        text = f"{duration:.2f} s of free flight in view, {MIN_FLIGHT_S} are needed: throw higher, in view"
    elif turns < MIN_TURNS_PER_S:
        verdict = TossVerdict.SLOW
        text = f"{turns:.1f} turns a second, {MIN_TURNS_PER_S} are needed: spin it faster"
    elif seen < MIN_SEEN_SHARE:
        verdict = TossVerdict.MARKER_LOST
        text = (
            f"the object was found in {100 * seen:.0f} % of the frames, {100 * MIN_SEEN_SHARE:.0f} are needed"
        )
    elif fit.noise > MAX_VARIANCE:
        verdict = TossVerdict.MISFIT
        text = (
            f"corners are {np.sqrt(fit.noise):.1f} times their error off the flight of one rigid body:"
            f" something moves inside, or {misplaced}"
        )
    elif angle is not None and angle < MIN_AXIS_ANGLE_RAD:
        verdict = TossVerdict.PRINCIPAL_AXIS
        text = (
            f"spins {np.degrees(angle):.0f} degrees off a principal axis,"
            f" {np.degrees(MIN_AXIS_ANGLE_RAD):.0f} are needed: spin it about an oblique axis"
        )
    flight = FittedFlight(
        views,
        fit.model.tags,
        fit.starts()[0],
        fit.x[: fit.model.shared],
        float(np.sqrt(np.mean(fit.residual**2))),
        BodyMotion(views.seconds, path.place - path.R_world_object @ fit.x[COM], path.R_world_object),
    )
    return TossMotion(*ids, verdict, text, flight, turns, angle)


def _axis_angle(spin: Array, inertia: Array) -> float | None:
    """Angle [rad] between the spin (3,) and the nearest principal axis of a tensor (3, 3) that is distinct.

    None if no principal axis is distinct, as of a cube's.
    """
    moments, axes = np.linalg.eigh(inertia)
    apart = np.abs(moments[:, None] - moments) + np.diag(np.full(3, np.inf))
    distinct = apart.min(axis=1) > _DISTINCT * moments.max()
    if not distinct.any():
        return None
    cosines = np.abs(spin @ axes[:, distinct]) / np.linalg.norm(spin)
    return float(np.arccos(min(1.0, float(cosines.max()))))
