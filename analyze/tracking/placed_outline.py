"""Check of an object's placement before its strike: its outline against the surroundings known by then.

Every earlier placement shows the surroundings where the object was not. A band beyond the planned outline
must look as they do, a band within it must not. Shadows darken the table and the wall: only print, edges and
brighter parts count as change, and beyond the outline only at the object's upper half. The striker's arm
stands elsewhere each time: on its side only what covers most of the band counts.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.tracking.camera_model import project_ideal, world_to_camera
from analyze.tracking.print_outline import filled_outline, margin_px
from analyze.tracking.print_template import blurred

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel, IntArray

_BLUR_PX = 1.0
"""1 sigma of the blur before the comparison [px]"""
_WINDOW = 9
"""pixels along each side of the patches that are compared"""
_BAND_PX = 6
"""width of the bands beyond and within the outline [px]"""
_STRUCTURE = 3.0
"""standard deviation in a patch from which on it has structure [grey]"""
_BRIGHTER = 12.0
"""increase from which on a patch without structure has changed [grey]: a shadow does not brighten"""
_SAME = 3.0
"""difference up to which a patch without structure is the same [grey]"""
_ALIKE, _UNLIKE = 0.8, 0.5
"""correlation from which on patches show the same, and below which they show something else"""
_CHANGED, _CHANGED_AWAY, _UNCHANGED = 0.35, 0.12, 0.18
"""share of the band beyond that has changed, of its part away from the striker, and of the band within that
has not, that tell of another outline"""
_KEPT = 6
"""number of the newest placements whose surroundings are kept"""
_SAME_PLACE = 0.1
"""share of the covered area by which placements differ that hide the same: the newest two of them are kept"""
_LEAST_KNOWN = 0.3
"""share of a band whose surroundings must be known"""
_OTHER_SCENE = 0.3
"""share of the surroundings that has changed from which on camera or light are other ones"""


class Surroundings:
    """What a camera sees without the object, as far as earlier placements show it."""

    def __init__(self) -> None:
        """Begin without any knowledge."""
        self._kept: deque[tuple[NDArray[np.float32], NDArray[np.bool_]]] = deque(maxlen=_KEPT)
        """images and where they show the surroundings"""

    def add(self, image: NDArray[np.float32], camera: CameraModel, placed: tuple[Array, IntArray]) -> None:
        """Take over what an image shows beside the object.

        Args:
            image: (h, w) image free of lens distortion.
            camera: camera with its pose in W.
            placed: vertices (v, 3) of the object in W [m] and triangles (t, 3).
        """
        beside = ~_dilated(filled_outline(camera, placed), margin_px(camera, placed[0]))
        alike = [
            number
            for number, (_, other) in enumerate(self._kept)
            if np.sum(other != beside) < _SAME_PLACE * np.sum(~beside)
        ]
        if len(alike) > 1:
            del self._kept[alike[0]]
        self._kept.append((image, beside))

    def contradict(
        self, image: NDArray[np.float32], camera: CameraModel, placed: tuple[Array, IntArray]
    ) -> bool:
        """True if an image shows another outline than the planned one, as far as the surroundings are known.

        Args:
            image: (h, w) image free of lens distortion.
            camera: camera with its pose in W.
            placed: vertices (v, 3) of the object in W, as planned [m], and triangles (t, 3).
        """
        if not self._kept:
            return False
        inside, margin = filled_outline(camera, placed), margin_px(camera, placed[0])
        near = _dilated(inside, margin)
        upper, away = _parts(camera, placed[0])
        beyond = _dilated(inside, margin + _BAND_PX) & ~near & upper
        within = _dilated(~inside, margin + _BAND_PX) & ~_dilated(~inside, margin)
        known = np.any([beside for _, beside in self._kept], axis=0)
        changed, same = known.copy(), np.zeros_like(known)
        for surroundings, beside in self._kept:
            changed_here, same_here = _compared(image, surroundings)
            changed &= changed_here | ~beside
            same |= same_here & beside
        outer = known & ~near
        if not outer.any() or changed[outer].mean() > _OTHER_SCENE:
            return False
        return (
            _share(changed, beyond, known) > _CHANGED
            or _share(changed, beyond & away, known) > _CHANGED_AWAY
            or _share(same, within, known) > _UNCHANGED
        )


def _share(found: NDArray[np.bool_], band: NDArray[np.bool_], known: NDArray[np.bool_]) -> float:
    """Share of a band's known part in which something was found; 0 if too little of it is known."""
    here = band & known
    return float(found[here].mean()) if here.sum() > _LEAST_KNOWN * band.sum() else 0.0


def _compared(
    image: NDArray[np.float32], surroundings: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Where (h, w) an image shows something else than another one, and where the same."""
    now, before = (blurred(each, _BLUR_PX) for each in (image, surroundings))
    mean_now, mean_before, product, square_now, square_before = (
        cv2.blur(each, (_WINDOW, _WINDOW)) for each in (now, before, now * before, now * now, before * before)
    )
    sd_now = np.sqrt(np.maximum(square_now - mean_now**2, 0.0))
    sd_before = np.sqrt(np.maximum(square_before - mean_before**2, 0.0))
    alike = (product - mean_now * mean_before) / np.maximum(sd_now * sd_before, 1.0)
    structure = np.maximum(sd_now, sd_before) > _STRUCTURE
    changed = np.where(structure, alike < _UNLIKE, mean_now - mean_before > _BRIGHTER)
    same = np.where(structure, alike > _ALIKE, np.abs(mean_now - mean_before) < _SAME)
    return changed, same


def _dilated(mask: NDArray[np.bool_], pixels: float) -> NDArray[np.bool_]:
    """Mask (h, w) grown by a distance."""
    return cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, 5) <= pixels


def _parts(camera: CameraModel, points: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """True (h, w) above the middle of an object's height, and on the side away from the striker.

    Args:
        camera: camera with its pose in W.
        points: (v, 3) points on the object in W [m]; the striker comes from -x.
    """
    R, t = world_to_camera(camera)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    places = middle + np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
    (u, v), (u_on, v_on) = project_ideal(camera, places @ R.T + t)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    along = (columns - u) * (u_on - u) + (rows - v) * (v_on - v)
    down = (rows - v) * (u_on - u) - (columns - u) * (v_on - v)
    return down * np.sign(u_on - u) < 0.0, along > 0.0
