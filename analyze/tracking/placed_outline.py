"""Check of an object's placement before its strike: its outline against the surroundings known by then.

Every earlier placement shows the surroundings where the object was not. A band beyond the planned outline
must look as they do, a band within it must not. Shadows darken the table and the wall: only print, edges and
brighter parts count as change, and beyond the outline only at the object's upper half.
"""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

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
_CHANGED, _UNCHANGED = 0.12, 0.18
"""share of the band beyond that has changed, and of that within that has not, that tell of another"""
_LEAST_KNOWN = 0.3
"""share of a band whose surroundings must be known"""
_OTHER_SCENE = 0.3
"""share of the surroundings that has changed from which on camera or light are other ones"""


class Surroundings:
    """What a camera sees without the object, as far as earlier placements show it."""

    def __init__(self) -> None:
        """Begin without any knowledge."""
        self._image: NDArray[np.float32] | None = None
        self._known = np.zeros((0, 0), dtype=bool)

    def add(self, image: NDArray[np.float32], camera: CameraModel, placed: tuple[Array, IntArray]) -> None:
        """Take over what an image shows beside the object.

        Args:
            image: (h, w) image free of lens distortion.
            camera: camera with its pose in W.
            placed: vertices (v, 3) of the object in W [m] and triangles (t, 3).
        """
        beside = ~_dilated(filled_outline(camera, placed), margin_px(camera, placed[0]))
        if self._image is None:
            self._image, self._known = image.copy(), beside
            return
        self._image[beside] = image[beside]
        self._known |= beside

    def contradict(
        self, image: NDArray[np.float32], camera: CameraModel, placed: tuple[Array, IntArray]
    ) -> bool:
        """True if an image shows another outline than the planned one, as far as the surroundings are known.

        Args:
            image: (h, w) image free of lens distortion.
            camera: camera with its pose in W.
            placed: vertices (v, 3) of the object in W, as planned [m], and triangles (t, 3).
        """
        if self._image is None:
            return False
        changed, same = _compared(image, self._image)
        inside, margin = filled_outline(camera, placed), margin_px(camera, placed[0])
        near = _dilated(inside, margin)
        beyond = _dilated(inside, margin + _BAND_PX) & ~near & _upper_half(camera, placed[0])
        core = _dilated(~inside, margin)
        within = _dilated(~inside, margin + _BAND_PX) & ~core
        outer = self._known & ~near
        if not outer.any() or changed[outer].mean() > _OTHER_SCENE:
            return False
        return self._share(changed, beyond) > _CHANGED or self._share(same, within) > _UNCHANGED

    def _share(self, found: NDArray[np.bool_], band: NDArray[np.bool_]) -> float:
        """Share of a band's known part in which something was found; 0 if too little of it is known."""
        known = band & self._known
        enough = known.sum() > _LEAST_KNOWN * band.sum()
        return float(found[known].mean()) if enough else 0.0


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


def _upper_half(camera: CameraModel, points: Array) -> NDArray[np.bool_]:
    """True (h, w) above the middle of an object's height, by points (v, 3) on it [m]."""
    R, t = world_to_camera(camera)
    low, high = points[:, 2].min(), points[:, 2].max()
    middle = np.array([points[:, 0].mean(), points[:, 1].mean(), 0.5 * (low + high)])
    side = middle + np.array([0.01, 0.0, 0.0])
    (u, v), (u_side, v_side) = project_ideal(camera, np.array([middle, side]) @ R.T + t)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    line = v + (columns - u) * (v_side - v) / (u_side - u if u_side != u else 1.0)
    return np.asarray(rows < line, dtype=np.bool_)
