"""Comparison of an object's print in two strikes: whether both show what the plan puts before the camera."""

# cv2 is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING

import cv2
import numpy as np

from analyze.tracking.camera_model import project_ideal, world_to_camera
from analyze.tracking.print_template import blurred, smooth_faces, visible_triangles

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel, IntArray

_POINTS = 6000
"""number of points of the surface that are compared, spread evenly"""
_SPREAD = np.array([0.7548776662, 0.5698402910])
"""steps of an even sequence in the unit square (Roberts 2018)"""
_BLUR_PX = 2.5
"""1 sigma of the blur before the comparison [px]"""
_STEEPEST = 0.6
"""least cosine between a face's normal and the line of sight: print on a round wall that two strikes see
aslant from two sides differs by its blur alone"""
_SHIFT_M, _STEPS = 5e-3, 4
"""largest shift of one print against the other that is tried, and steps to it on each side"""
_LEAST_POINTS = 150
"""points that both strikes must show of a face"""
_LEAST_CONTRAST = 2.0
"""least standard deviation of a face's grey values in both strikes [grey]"""
_AROUND_PX = 20
"""pixels around the object in its view at rest"""
MIN_LIKENESS = 0.5
"""correlation of a face's print in two strikes below which they show different print"""


@dataclass(frozen=True)
class RestView:
    """Object at rest before a strike: mean image around it, and how it was seen."""

    image: NDArray[np.uint8]
    """(h, w) mean image around the object, free of lens distortion"""
    origin: tuple[int, int]
    """column and row of its first pixel in the whole image"""
    camera: CameraModel
    """camera as seen from the object as it was put down"""
    R_world_object: Array
    """(3, 3) planned rotation"""
    p_world_object: Array
    """(3,) planned place [m]"""


@dataclass(frozen=True)
class PrintDifference:
    """Two strikes that show different print on one face."""

    strikes: tuple[str, str]
    """ids of the strikes"""
    normal: Array
    """(3,) outward normal of the face in O"""
    correlation: float
    """largest correlation of the grey values, over small shifts"""


def rest_view(
    rest: Sequence[NDArray[np.float32]], camera: CameraModel, vertices: Array, pose: tuple[Array, Array]
) -> RestView:
    """Mean image of the object at rest, cut out around it.

    Args:
        rest: (h, w) images at rest, free of lens distortion.
        camera: camera as seen from the object as it was put down.
        vertices: (v, 3) vertices of the shape in O [m].
        pose: planned rotation (3, 3) and place (3,) [m] of the object in W.
    """
    R, p = pose
    R_camera, t = world_to_camera(camera)
    pixels = project_ideal(camera, (vertices @ R.T + p) @ R_camera.T + t)
    size = np.array([camera.width, camera.height])
    low = np.clip(np.floor(pixels.min(axis=0) - _AROUND_PX), 0, size - 1).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0) + _AROUND_PX), low + 1, size).astype(int)
    mean = np.mean([image[low[1] : high[1], low[0] : high[0]] for image in rest], axis=0)
    return RestView(np.rint(mean).astype(np.uint8), (int(low[0]), int(low[1])), camera, R, p)


class PrintedSurface:
    """Points of an object's surface at which the print of strikes is compared.

    Args:
        vertices: (v, 3) vertices in O [m].
        triangles: (t, 3) indices, counter-clockwise from outside.
    """

    def __init__(self, vertices: Array, triangles: IntArray) -> None:
        """Spread the points over the surface."""
        corner = vertices[triangles]
        across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        area = np.linalg.norm(across, axis=1)
        share = (np.arange(_POINTS) + 0.5) / _POINTS
        self._triangle = np.searchsorted(np.cumsum(area) / area.sum(), share)
        u, v = (np.arange(_POINTS) * _SPREAD[:, None]) % 1.0
        u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
        own = corner[self._triangle]
        self._points = own[:, 0] + u[:, None] * (own[:, 1] - own[:, 0]) + v[:, None] * (own[:, 2] - own[:, 0])
        self._normals = (across / np.maximum(area, 1e-15)[:, None])[self._triangle]
        self._vertices, self._triangles = vertices, triangles
        self._faces = smooth_faces(vertices, triangles)
        self._face = self._faces[self._triangle]

    def differences(self, views: Mapping[str, RestView]) -> tuple[PrintDifference, ...]:
        """Pairs of strikes that show different print where the plan puts one face before the camera.

        Args:
            views: the object at rest by strike id.
        """
        return self._differing(views, combinations(views, 2))

    def differences_from(self, name: str, views: Mapping[str, RestView]) -> tuple[PrintDifference, ...]:
        """Pairs of one strike with others that show different print on a face which both should show.

        Args:
            name: id of the strike.
            views: the object at rest by strike id, that of the strike included.
        """
        return self._differing(views, ((name, other) for other in views if other != name))

    def _differing(
        self, views: Mapping[str, RestView], pairs: Iterable[tuple[str, str]]
    ) -> tuple[PrintDifference, ...]:
        """Pairs of strikes, of those given, that show different print."""
        seen = {name: self._seen(view) for name, view in views.items()}
        found = (
            self._difference((one, other), (views[one], views[other]), (seen[one], seen[other]))
            for one, other in pairs
        )
        return tuple(each for each in found if each is not None)

    def _difference(
        self, names: tuple[str, str], views: tuple[RestView, RestView], pixels: tuple[Array, Array]
    ) -> PrintDifference | None:
        """Face on which the print of two strikes differs most; None if it does on none that both show."""
        common = np.isfinite(pixels[0][:, 0]) & np.isfinite(pixels[1][:, 0])
        step = _SHIFT_M / _STEPS * _px_per_m(views[1])
        shifts = step * np.stack(np.meshgrid(*[np.arange(-_STEPS, _STEPS + 1)] * 2), -1).reshape(-1, 2)
        found: list[PrintDifference] = []
        for face in np.unique(self._face[common]):
            here = np.flatnonzero(common & (self._face == face))
            if len(here) < _LEAST_POINTS:
                continue
            grey = _grey(views[0], pixels[0][None, here])
            shifted = _grey(views[1], pixels[1][here] + shifts[:, None])
            if min(grey.std(), shifted[len(shifts) // 2].std()) < _LEAST_CONTRAST:
                continue
            alike = float(np.max(_normalised(shifted) @ _normalised(grey)[0]))
            if alike < MIN_LIKENESS:
                found.append(PrintDifference(names, self._normals[here].mean(axis=0), alike))
        return min(found, key=lambda each: each.correlation, default=None)

    def _seen(self, view: RestView) -> Array:
        """Pixels (n, 2) of the points in a view, NaN where they are not seen."""
        camera = view.camera
        placed = self._vertices @ view.R_world_object.T + view.p_world_object
        drawn, _ = visible_triangles(camera, placed, self._triangles)
        points = self._points @ view.R_world_object.T + view.p_world_object
        R, t = world_to_camera(camera)
        pixels = project_ideal(camera, points @ R.T + t)
        sight = camera.T_world_camera[:3, 3] - points
        facing = np.sum(self._normals @ view.R_world_object.T * sight, axis=1)
        at = np.rint(pixels).astype(np.int64)
        inside = np.all((at >= 0) & (at < [camera.width, camera.height]), axis=1)
        inside &= facing > _STEEPEST * np.linalg.norm(sight, axis=1)
        shown = np.zeros(len(points), dtype=bool)
        hit = drawn[at[inside, 1], at[inside, 0]]
        shown[inside] = (hit >= 0) & (self._faces[hit] == self._face[inside])
        return np.where(shown[:, None], pixels, np.nan)


def _grey(view: RestView, pixels: Array) -> Array:
    """Grey values (k, n) of a view at pixels (k, n, 2) of the whole image."""
    at = (pixels - view.origin).astype(np.float32)
    soft = blurred(view.image.astype(np.float32), _BLUR_PX)
    found = cv2.remap(soft, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return found.astype(np.float64)


def _normalised(rows: Array) -> Array:
    """Rows (k, n) with mean 0 and norm 1."""
    rows = rows - rows.mean(axis=1, keepdims=True)
    return rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-9)


def _px_per_m(view: RestView) -> float:
    """Pixels per metre at the object's place."""
    away = view.p_world_object - view.camera.T_world_camera[:3, 3]
    return float(view.camera.K[0, 0] / np.linalg.norm(away))
