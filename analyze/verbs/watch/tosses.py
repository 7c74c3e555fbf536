"""Verdicts on tosses while their recording is being written."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.errors import AnalyzeError
from analyze.geometry.object_model import load_object_model
from analyze.pipeline.read_evidence import with_marker_masses
from analyze.pipeline.toss_marks import TossMarks, toss_marks
from analyze.pipeline.tosses import thrown_body, toss_in_frames
from schemas.toss_result import TossVerdict
from schemas.watch_lines import TossJudgement, TossRequest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from analyze.flight.flight_model import ThrownBody
    from analyze.flight.toss_fit import FlightPrior
    from analyze.geometry.object_model import ObjectModel
    from analyze.tracking.print_likeness import RestView
    from analyze.types import CameraModel, ImageFrame, Marker
    from schemas.session_manifest import SessionManifest


class TossJudge:
    """Judge of the tosses of one growing recording; the object's shape is loaded at the first toss.

    Args:
        manifest: description of the session, with object and gravity.
        camera: the camera, with its pose in the world frame W.
        markers: markers of the object whose place on it is known.
        shape_bytes: called for the contents of the shape file; it returns None while they are not recorded.
        rest_views: called for an untagged object at rest before each usable strike so far, by strike id.
    """

    def __init__(
        self,
        manifest: SessionManifest,
        camera: CameraModel,
        markers: list[Marker],
        shape_bytes: Callable[[], bytes | None],
        rest_views: Callable[[], Mapping[str, RestView]] = dict,
    ) -> None:
        self._manifest, self._camera, self._markers = manifest, camera, markers
        self._shape_bytes, self._rest_views = shape_bytes, rest_views
        self._shape: ObjectModel | None = None
        self._marks_of: tuple[tuple[str, ...], TossMarks] | None = None
        """ids of the strikes that have shown the print, and the marks by them"""
        self._body: tuple[ThrownBody, FlightPrior] | None = None

    def judge(self, request: TossRequest, frames: Iterable[ImageFrame]) -> TossJudgement:
        """Judge a toss from the frames of its window.

        Returns:
            The verdict; UNREADABLE, with the reason, if the images or the shape cannot be used.
        """
        ids = request.toss_id, request.plan_toss_id
        try:
            body, prior = self._thrown()
            motion = toss_in_frames(ids, frames, self._camera, self._marks(), body, prior)
        except AnalyzeError as error:
            return unreadable_toss(request, str(error))
        return TossJudgement(
            toss_id=request.toss_id,
            code=motion.verdict,
            reason=motion.reason,
            flight_s=motion.flight_s,
            turns_per_s=motion.turns_per_s,
        )

    def _marks(self) -> TossMarks:
        """Tags, or views of the print by the strikes so far."""
        views = self._rest_views()
        if self._shape is not None and (self._marks_of is None or self._marks_of[0] != tuple(views)):
            self._marks_of = tuple(views), toss_marks(self._markers, views, self._shape)
        return TossMarks(self._markers) if self._marks_of is None else self._marks_of[1]

    def _thrown(self) -> tuple[ThrownBody, FlightPrior]:
        if self._body is None:
            spec = self._manifest.object
            self._shape = load_object_model(spec, self._shape_bytes(), spec.shape.file or spec.name)
            self._body = thrown_body(with_marker_masses(spec), self._shape, self._manifest)
        return self._body


def unreadable_toss(request: TossRequest, reason: str) -> TossJudgement:
    """Verdict UNREADABLE, with the reason, on the toss that a request names."""
    return TossJudgement(toss_id=request.toss_id, code=TossVerdict.UNREADABLE, reason=reason)
