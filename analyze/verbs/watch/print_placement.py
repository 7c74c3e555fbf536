"""Placement of an object without tags before its strike: outline, print, and whether the print is enough."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import TrackingError
from analyze.geometry.station import turned_camera
from analyze.motion.enough_print import print_follower, refuse_poor_print
from analyze.motion.strike import placement_of
from analyze.tags.side_names import axis_name
from analyze.tracking.placed_outline import Surroundings
from analyze.tracking.print_likeness import PrintedSurface, rest_view
from analyze.tracking.print_template import IdealImages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.tracking.print_likeness import RestView
    from analyze.types import Array, CameraModel, ImageFrame, IntArray
    from schemas.strike_plan import PlannedStrike

_NOW = "now"
"""name of the object as it lies now, beside those of strikes"""


class PrintPlacement:
    """What the images of a session tell of an untagged object's placement.

    Args:
        camera: the camera, with its pose in the world frame W.
        shape: vertices (v, 3) in O [m] and triangles (t, 3) of the object.
    """

    def __init__(self, camera: CameraModel, shape: tuple[Array, IntArray]) -> None:
        """Begin without any strike."""
        self._camera, self._shape = camera, shape
        self._images = IdealImages(camera)
        self._surface = PrintedSurface(*shape)
        self._surroundings = Surroundings()
        self._views: dict[str, RestView] = {}

    @property
    def views(self) -> dict[str, RestView]:
        """The object at rest before each usable strike so far, by strike id."""
        return self._views

    def struck(self, strike_id: str, planned: PlannedStrike, at_rest: ImageFrame, view: RestView) -> None:
        """Take over what a usable strike showed.

        Args:
            strike_id: its id.
            planned: the strike as planned.
            at_rest: image before it.
            view: the object at rest before it.
        """
        self._views[strike_id] = view
        placed = self._placed(planned)
        self._surroundings.add(self._images.ideal(at_rest.image), view.camera, placed)

    def advice(self, planned: PlannedStrike, at_rest: Sequence[ImageFrame]) -> str:
        """Instruction to the user if the object lies otherwise than planned, or cannot be followed.

        Args:
            planned: the strike that is expected.
            at_rest: some images of the object as it lies now.

        Returns:
            One clause; empty if nothing contradicts.
        """
        camera = turned_camera(self._camera, planned.heading_rad)
        rest = [self._images.ideal(frame.image) for frame in at_rest]
        if self._surroundings.contradict(np.mean(rest, axis=0), camera, self._placed(planned)):
            return "the outline is not that on the card: put the object down as drawn there"
        placement = placement_of(planned)
        pose = placement.R_world_object, placement.p_world_object
        now = rest_view(rest, camera, self._shape[0], pose)
        for each in self._surface.differences_from(_NOW, {**self._views, _NOW: now}):
            return (
                f"the print on {axis_name(each.normal)} is not that of strike {each.strikes[1]}: put the"
                " object down as its card shows"
            )
        try:
            refuse_poor_print(print_follower(rest, camera, self._images, self._shape, placement))
        except TrackingError as error:
            return str(error)
        return ""

    def _placed(self, planned: PlannedStrike) -> tuple[Array, IntArray]:
        """Vertices (v, 3) in W as planned [m], and triangles."""
        placement = placement_of(planned)
        return self._shape[0] @ placement.R_world_object.T + placement.p_world_object, self._shape[1]
