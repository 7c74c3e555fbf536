"""Check of the planned outline by the images of a tip: what moves with the print, and what stays.

A part of the image at rest belongs to the body if later images show it where the tracked motion takes it,
and to the surroundings if they show it where it was. Even parts show nothing, nor does what the body covers
later.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.tracking.camera_model import project_ideal, world_to_camera
from analyze.tracking.print_template import BORDER_M, blurred

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.tracking.print_follower import PrintFollower
    from analyze.types import Array, CameraModel, IntArray

_STEP_PX = 3
"""distance of the points that are compared [px]"""
_BLUR_PX = 2.0
"""1 sigma of the blur before the comparison [px]"""
_WINDOW = 5
"""points along each side of the patches over which differences are averaged"""
_AROUND_M = 0.05
"""distance from the planned outline up to which the image is compared [m]"""
_MARGIN_M, _MARGIN_PX = 2 * BORDER_M, 4
"""distance from the planned outline within which nothing counts: the hand's error and the blur [m, px]"""
_LEAST_CHANGE = 6.0
"""least difference of grey values that distinguishes body from surroundings"""
_LEAST_FRAMES = 3
"""images that must show a part beyond the outline where nothing was before"""
_CLEARER, _CLEARLY_STILL = 2.0, 4.0
"""ratio of the differences by moving and by staying from which a part is not of the surroundings, and not of
the body, whose shades stay with the light"""


@dataclass(frozen=True)
class OutlineMisfit:
    """Parts of the image at rest that contradict the planned outline, over the outline's area."""

    beyond: float
    """area beyond it that moves with the body"""
    missing: float
    """area within it that stays"""

    @property
    def worst(self) -> float:
        """The larger of both."""
        return max(self.beyond, self.missing)


def outline_misfit(
    follower: PrintFollower,
    camera: CameraModel,
    placed: tuple[Array, IntArray],
    rest: NDArray[np.float32],
    moving: Sequence[tuple[NDArray[np.float32], Array]],
) -> OutlineMisfit:
    """Compare what moves with the print with the planned outline.

    Args:
        follower: tracker of the strike.
        camera: camera as seen from the object's planned pose.
        placed: vertices (v, 3) at rest in W [m] and triangles (t, 3) of the shape.
        rest: (h, w) mean image at rest, free of lens distortion.
        moving: images (h, w) of the tip, free of lens distortion, with their unknowns (6,).
    """
    inside = filled_outline(camera, placed)
    across, down = (np.flatnonzero(inside.any(axis=axis)) for axis in (0, 1))
    around = int(_AROUND_M * _px_per_m(camera, placed[0]))
    columns, rows = np.meshgrid(
        *(
            np.arange(max(low - around, 0), min(high + around, size), _STEP_PX)
            for (low, *_, high), size in ((across, camera.width), (down, camera.height))
        )
    )
    margin = margin_px(camera, placed[0])
    within = cv2.distanceTransform(inside.astype(np.uint8), cv2.DIST_L2, 5)[rows, columns] > margin
    surroundings = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, 5)
    beyond = surroundings[rows, columns] > margin
    soft_rest = blurred(rest, _BLUR_PX)
    grey_rest = soft_rest[rows, columns]
    # Sums over the images: difference from the rest where the motion takes a part, and where it was.
    moved, stayed = np.zeros(rows.shape), np.zeros(rows.shape)
    # The same over images in which the motion takes it where nothing of the planned shape was at rest.
    arrivals, moved_out, changed_out = (np.zeros(rows.shape) for _ in range(3))
    points = follower.on_main_face(np.column_stack([columns.ravel(), rows.ravel()]).astype(np.float64))
    for image, x in moving:
        soft = blurred(image, _BLUR_PX)
        at = follower.moved(x, points).astype(np.float32).reshape(*rows.shape, 2)
        grey, grey_before, apart = (
            cv2.remap(each, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderValue=-1)
            for each in (soft, soft_rest, surroundings)
        )
        seen = grey >= 0
        lit = seen & within & (grey_rest > 1)
        gain = max(float(np.median(grey[lit] / grey_rest[lit])), 0.1) if lit.any() else 1.0
        by_stay = np.abs(soft[rows, columns] - grey_rest)
        by_move = np.where(seen, np.abs(grey / gain - grey_rest), by_stay)
        stayed += by_stay
        moved += by_move
        arrives = np.where(seen & (apart > margin), 1.0, 0.0)
        arrivals += arrives
        moved_out += arrives * by_move
        changed_out += arrives * np.minimum(by_stay, np.abs(grey - grey_before))
    window, times = (_WINDOW, _WINDOW), np.maximum(arrivals, 1)
    moved, stayed = (cv2.blur(each / len(moving), window) for each in (moved, stayed))
    moved_out, changed_out = (cv2.blur(each / times, window) for each in (moved_out, changed_out))
    # An even background looks alike wherever it is: a body shows where it leaves and where it arrives.
    body = (arrivals >= _LEAST_FRAMES) & (changed_out > np.maximum(_LEAST_CHANGE, _CLEARER * moved_out))
    still = moved > np.maximum(_LEAST_CHANGE, _CLEARLY_STILL * stayed)
    area = max(int(inside.sum()), 1) / _STEP_PX**2
    return OutlineMisfit(float((body & beyond).sum()) / area, float((still & within).sum()) / area)


def filled_outline(camera: CameraModel, placed: tuple[Array, IntArray]) -> NDArray[np.bool_]:
    """True (h, w) where the camera sees an object, by vertices (v, 3) in W [m] and triangles (t, 3)."""
    R, t = world_to_camera(camera)
    corners = project_ideal(camera, placed[0] @ R.T + t)
    inside = np.zeros((camera.height, camera.width), dtype=np.uint8)
    for triangle in np.rint(16 * corners).astype(np.int32)[placed[1]]:
        cv2.fillConvexPoly(inside, triangle, 1, shift=4)
    return inside.astype(np.bool_)


def margin_px(camera: CameraModel, points: Array) -> float:
    """Distance from an object's outline within which nothing counts [px], by points (v, 3) on it [m]."""
    return _MARGIN_M * _px_per_m(camera, points) + _MARGIN_PX


def _px_per_m(camera: CameraModel, points: Array) -> float:
    """Pixels per metre at the middle of points (v, 3) in W [m]."""
    distance = float(np.linalg.norm(points.mean(axis=0) - camera.T_world_camera[:3, 3]))
    return float(camera.K[0, 0]) / distance
