"""Observer of a growing recording: markers in view, placement, rest, and verdicts on strikes."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Protocol

import numpy as np

from analyze.errors import AnalyzeError
from analyze.geometry.station import turned_camera
from analyze.motion.contact_time import contact_time
from analyze.motion.print_motion import analyse_images
from analyze.motion.scene import RESTED_NS, at_rest, check_placement, read_scene
from analyze.motion.strike import verdict_of
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.sections import MeshSections
from analyze.tracking.camera_model import pixel_map
from analyze.tracking.marker import families_of
from analyze.verbs.watch.curve import strike_curve
from analyze.verbs.watch.print_placement import PrintPlacement
from analyze.verbs.watch.wanted_place import WantedPlace
from schemas.strike_result import USABLE_VERDICTS, Verdict
from schemas.tags import name_order
from schemas.watch_lines import JudgeRequest, SeenMarker, StrikeVerdict, WatchEvent

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from typing import Any

    from analyze.motion.scene import Scene
    from analyze.tracking.print_likeness import RestView
    from analyze.types import CameraModel, ImageFrame, Marker
    from schemas.strike_plan import PlannedStrike, StrikePlan

LOOK_INTERVAL_NS = 83_000_000
"""shortest interval between two images that are decoded [ns]: at most twelve a second"""
KEPT_NS = 12_000_000_000
"""time for which images are kept for a verdict [ns]"""
REST_BEFORE_NS, TIP_AFTER_NS = 600_000_000, 1_800_000_000
"""part of a strike's window [ns] that a verdict uses, before and after the contact.

The slowest tip over the balance takes about 1 s.
"""
REST_IMAGES = 8
"""largest number of images at rest by which an untagged object's placement is checked"""
MOVED_PX = 3.0
"""distance [px] of a corner from its position at rest above which the marker counts as moving.

Hands near the object move it less.
"""


class StoredImage(Protocol):
    """Protocol of an image message as stored in the file, not decoded."""

    @property
    def log_time_ns(self) -> int:
        """Time of the middle of the exposure [ns since 1970]."""
        ...


def unreadable(request: JudgeRequest, reason: str) -> StrikeVerdict:
    """Verdict UNREADABLE, with the reason, on the strike that a request names."""
    return StrikeVerdict(strike_id=request.strike_id, code=Verdict.UNREADABLE, reason=reason)


class Observer:
    """Observer of one recording's images: states what they show, and judges strikes from them.

    Images are added in the order of their times with `add`, which returns the markers in view and the check
    of the object's placement; `judge` returns the verdict on a strike from the images kept.

    Args:
        camera: the camera, with its pose in the world frame W.
        markers: markers of the object.
        plan: the planned strikes.
        decode: decodes an image message; called only for images that are evaluated.
        sections: gives a mesh object's outline in the plane of a tip, and the tip angle at which the next
            face lands on the table; None if the shape is unknown.
    """

    def __init__(
        self,
        camera: CameraModel,
        markers: list[Marker],
        plan: StrikePlan,
        decode: Callable[[Any], ImageFrame],
        sections: MeshSections | None = None,
    ) -> None:
        self._camera = camera
        self._decode = decode
        self._sections = sections
        self._markers = markers
        self._by_id = {marker.id: marker for marker in markers}
        self._families = families_of(self._by_id)
        self._strikes: dict[str, PlannedStrike] = {strike.id: strike for strike in plan.strikes}
        self._expected: PlannedStrike | None = None
        self._wanted: WantedPlace | None = None
        self._scenes: deque[Scene] = deque(maxlen=12)
        self._print_placement: PrintPlacement | None = None
        """placement of an untagged object; None until its shape is recorded"""
        self._print_advice: str | None = None
        """instruction by the print of the object as it rests now; None if not looked at yet"""
        self._seen: deque[Scene] = deque()
        """scenes of the images that are kept"""
        self._images: deque[StoredImage] = deque()
        self._last_look_ns = 0
        pixel_map(camera)

    @property
    def newest_ns(self) -> int:
        """Log time of the newest image [ns since 1970]; 0 before the first image."""
        return self._images[-1].log_time_ns if self._images else 0

    def expect(self, plan_strike_id: str) -> None:
        """Set the planned strike with which the object's placement is compared from now on.

        An id that the plan does not have ends the comparison.
        """
        self._expected = planned = self._strikes.get(plan_strike_id)
        self._wanted = self._print_advice = None
        if planned is not None:
            hull = None if self._sections is None else self._sections.hull_vertices()
            camera = turned_camera(self._camera, planned.heading_rad)
            self._wanted = WantedPlace(planned, camera, self._by_id, hull)

    def keep(self, image: StoredImage) -> None:
        """Keep an image for verdicts without evaluating it; images more than `KEPT_NS` older are dropped."""
        self._images.append(image)
        while image.log_time_ns - self._images[0].log_time_ns > KEPT_NS:
            self._images.popleft()

    def add(self, image: StoredImage) -> WatchEvent | None:
        """Keep an image and, if `LOOK_INTERVAL_NS` has passed since the last evaluated one, evaluate it.

        Returns:
            Event with the markers in view, whether they are at rest, the fraction of saturated pixels and, if
            a strike is expected, the angle [rad] of the object from its planned orientation (None if it is
            not known) with an instruction for the user; None if the image was not evaluated.
        """
        self.keep(image)
        if 0 <= image.log_time_ns - self._last_look_ns < LOOK_INTERVAL_NS:
            return None
        self._last_look_ns = image.log_time_ns
        scene = read_scene(self._decode(image), self._camera, self._families)
        self._scenes.append(scene)
        self._seen.append(scene)
        while scene.time_ns - self._seen[0].time_ns > KEPT_NS:
            self._seen.popleft()
        seen = [
            SeenMarker(id=i, corners_px=np.round(corners, 2).tolist())
            for i, corners in sorted(scene.corners.items(), key=lambda item: name_order(item[0]))
        ]
        still = at_rest(self._scenes)
        error, text = None, ""
        if self._expected is not None and self._markers:
            check = check_placement(
                scene, self._by_id, turned_camera(self._camera, self._expected.heading_rad), self._expected
            )
            error, text = check.error, check.text
        if not still:
            self._print_advice = None
        elif self._expected is not None and not self._markers:
            if self._print_advice is None:
                self._print_advice = self._print_text(self._expected)
            text = self._print_advice
        wanted = {} if self._wanted is None else self._wanted.compare(self._scenes)
        return WatchEvent(
            time_ns=image.log_time_ns,
            markers=seen,
            at_rest=still,
            saturated_fraction=scene.saturated_fraction,
            placement_error_rad=error,
            text=text,
            **wanted,
        )

    def _print_text(self, planned: PlannedStrike) -> str:
        """Instruction to the user by the images of an untagged object at rest; empty without any.

        Args:
            planned: the strike that is expected.
        """
        placement = self._placement_by_print()
        if placement is None:
            return ""
        since_ns = self.newest_ns - RESTED_NS
        rest = [image for image in list(self._images)[-REST_IMAGES:] if image.log_time_ns >= since_ns]
        return placement.advice(planned, [self._decode(image) for image in rest])

    def _placement_by_print(self) -> PrintPlacement | None:
        """What earlier strikes tell of an untagged object; None while its shape is not recorded."""
        if self._print_placement is None and self._sections is not None and not self._markers:
            shape = self._sections.surface()
            self._print_placement = None if shape is None else PrintPlacement(self._camera, shape)
        return self._print_placement

    def rest_views(self) -> dict[str, RestView]:
        """An untagged object at rest before each usable strike so far, by strike id."""
        placement = self._placement_by_print()
        return {} if placement is None else placement.views

    def judge(self, request: JudgeRequest) -> StrikeVerdict:
        """Judge a strike from the images kept.

        Args:
            request: the strike's ids, its time window, and the time of contact if the striker measured it.

        Returns:
            The verdict, with the time of contact if it could be fitted. It is UNREADABLE, with the reason, if
            the plan has no such strike or the images cannot be analysed (an AnalyzeError, which is not
            raised).
        """
        planned = self._strikes.get(request.plan_strike_id)
        if planned is None:
            known = ", ".join(self._strikes) or "none"
            return unreadable(request, f"the plan has no strike {request.plan_strike_id!r}: it has {known}")
        try:
            camera = turned_camera(self._camera, planned.heading_rad)
            known = self._sections
            task = StrikeTask(
                request.strike_id,
                planned,
                request.contact_time_ns,
                None,
                None if known is None else known.outline(planned),
                None if known is None else known.landing_angle_rad(planned),
                None,
                None if known is None else known.supports(planned),
                tuple(self._strikes.values()),
                0.0 if known is None else known.edge_sd(planned),
            )
            shape = None if known is None or self._markers else known.surface()
            motion, report = analyse_images(self._window(request), camera, self._markers, shape, task)
            view, placement = report.rest_view, self._placement_by_print()
            if placement is not None and view is not None and motion.verdict in USABLE_VERDICTS:
                placement.struck(request.strike_id, planned, next(self._window(request)), view)
        except AnalyzeError as error:
            return unreadable(request, str(error))
        contact = contact_time(motion.fit) if motion.fit else None
        timed = {"contact_time_ns": contact.time_ns, "contact_time_sd_ns": contact.sd_ns} if contact else {}
        start_ns = request.contact_time_ns or (contact.time_ns if contact else None)
        return verdict_of(motion).model_copy(update={**timed, "curve": strike_curve(motion, start_ns)})

    def _judged_span(self, request: JudgeRequest) -> tuple[int, int]:
        """Start and end [ns since 1970] of the images from which to judge a strike.

        They are `REST_BEFORE_NS` before the contact and `TIP_AFTER_NS` after it, or the ends of the request's
        window (time span recorded for the strike) where these are nearer. If the request has no time of
        contact, that of the last image before a marker moved takes its place; if no marker was seen either,
        the whole window is returned. A window without an end ends at the newest image.
        """
        start, end = request.window_start_ns, request.window_end_ns or self.newest_ns
        contact = request.contact_time_ns or self._last_rest_ns(start, end)
        if contact:
            start, end = max(start, contact - REST_BEFORE_NS), min(end, contact + TIP_AFTER_NS)
        return start, end

    def _last_rest_ns(self, start: int, end: int) -> int:
        """Time [ns] of the last evaluated image before any marker moved; 0 if no marker was seen.

        Only images from `start` to `end` [ns] count. A marker has moved if a corner is more than `MOVED_PX`
        from its first place in them. The result replaces the time of contact if no striker measured it. It
        needs no tracking of markers through all images, which is slow for a strike by hand (seconds long).
        """
        rest: dict[int | str, Any] = {}
        before = 0
        for scene in self._seen:
            if start <= scene.time_ns <= end:
                for marker, corners in scene.corners.items():
                    if np.abs(corners - rest.setdefault(marker, corners)).max() > MOVED_PX:
                        return before
                    before = scene.time_ns
        return before

    def _window(self, request: JudgeRequest) -> Iterator[ImageFrame]:
        return self.frames(*self._judged_span(request))

    def frames(self, start: int, end: int) -> Iterator[ImageFrame]:
        """Decoded images among those kept, with log times from start to end [ns since 1970]."""
        return (self._decode(image) for image in list(self._images) if start <= image.log_time_ns <= end)
