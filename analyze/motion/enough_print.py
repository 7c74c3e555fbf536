"""Check of a face's print before its strike: whether it shows the tip well enough."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import TrackingError
from analyze.tracking.print_follower import PrintFollower
from analyze.tracking.print_template import print_template

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.motion.tip_angle import Placement
    from analyze.tracking.print_template import IdealImages
    from analyze.types import Array, CameraModel, IntArray

MAX_THETA_SD = math.radians(0.1)
"""largest standard deviation of theta in one frame at rest [rad]: above it the print is too poor"""


def print_follower(
    rest: Sequence[NDArray[np.float32]],
    camera: CameraModel,
    images: IdealImages,
    shape: tuple[Array, IntArray],
    placement: Placement,
    interval_s: float = 0.0,
) -> PrintFollower:
    """Tracker of the print that images at rest show.

    Args:
        rest: at least two images (h, w) at rest, free of lens distortion.
        camera: camera as seen from the object's planned pose.
        images: removal of the camera's distortion.
        shape: vertices (v, 3) in O [m] and triangles (t, 3) of the object.
        placement: planned pose of the object and pivot.
        interval_s: time from frame to frame [s], for a rolling shutter.

    Raises:
        TrackingError: no face is in view.
    """
    template = print_template(rest, camera, *shape, (placement.R_world_object, placement.p_world_object))
    if template.faces == 0:
        raise TrackingError(
            "no face of the object is in view where the plan puts it: check its placement and the camera"
        )
    pivot = placement.R_world_object @ placement.p_object_pivot + placement.p_world_object
    return PrintFollower(template, camera, images, pivot, placement.radius, interval_s)


def refuse_poor_print(follower: PrintFollower) -> None:
    """Refuse a print that determines theta to less than `MAX_THETA_SD` in one image.

    Raises:
        TrackingError: the print is too poor.
    """
    theta_sd = follower.theta_sd()
    if theta_sd > MAX_THETA_SD:
        found = "blank" if math.isinf(theta_sd) else f"good to {math.degrees(theta_sd):.2f} deg only"
        raise TrackingError(
            f"the face in view has too little print ({found}, {math.degrees(MAX_THETA_SD):.1f} deg are needed"
            " in a frame): stick on any sticker with print, or a tag"
        )
