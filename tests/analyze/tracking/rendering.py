"""Small renderer of tags with known corners, independent of the virtual rig's: exact area coverage.

Therefore no direction of an edge is favoured. The area of a surface within {x < X, y < Y} is the line
integral of min(x, X) dy along the part of its border with y < Y (Green); a pixel's share is the second
difference of that over its four corners, exact to rounding. Borders between cells carry the difference of the
greys. The lens blurs before the pixels add up: areas are taken on a grid four times finer, blurred there, and
then averaged over each pixel. It models perspective, lens distortion (each cell's border in two straight
pieces, 0.001 px), blur and noise; no exposure time, no shading. Integer coordinates are pixel centres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from schemas.session_manifest import LensModel
from schemas.tags import family_and_id

RIM_CELLS = 1.6
"""width of the white margin round a tag, in cells of its pattern"""
PIECES = 2
FINE = 4
"""sub-pixels per pixel along each axis; with 1, the blurred edge would be a staircase, 2 grey levels off"""
UPRIGHT_PX = 1e-6
"""width [px] below which a piece counts as upright: 1 / slope would lose its digits"""


@dataclass(frozen=True)
class Look:
    """Greys, blur [px] and noise [grey levels, 1 sigma] of an image."""

    noise: float = 4.0
    blur: float = 0.7
    white: float = 205
    black: float = 30
    background: float = 120


def bits(name: int | str) -> np.ndarray:
    family, tag_id = family_and_id(name)
    code = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, family.opencv))
    return cv2.aruco.generateImageMarker(code, tag_id, code.markerSize + 2) > 127


def project(camera, points_camera):
    if camera.model is LensModel.FISHEYE:
        # Kannala and Brandt 2006: the ray's angle to the axis, bent, is the distance from the middle in focal
        # lengths.
        X, Y, Z = np.asarray(points_camera, float).reshape(-1, 3).T
        angle = np.arctan2(np.hypot(X, Y), Z)
        bent = angle + sum(k * angle ** (3 + 2 * i) for i, k in enumerate(camera.distortion))
        return (
            np.stack([bent * np.cos(np.arctan2(Y, X)), bent * np.sin(np.arctan2(Y, X))], 1)
            @ camera.K[:2, :2].T
            + camera.K[:2, 2]
        )
    raw, _ = cv2.projectPoints(
        np.asarray(points_camera, float).reshape(-1, 1, 3),
        np.zeros(3),
        np.zeros(3),
        camera.K,
        camera.distortion,
    )
    return raw.reshape(-1, 2)


def corners_of(size):
    h = size / 2
    return np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])


@cache
def borders(marker_id, look):
    """Pieces of border between cells of different grey: start (n, 2), end (n, 2), and step (n,) in grey.

    Points are in units of the tag's size, x right and y up. The step is the grey inside minus outside, for
    pieces that run anticlockwise around the inside.
    """
    code = bits(marker_id)[::-1]
    half = len(code) / 2
    lines = np.array([-half - RIM_CELLS, *(np.arange(len(code) + 1) - half), half + RIM_CELLS]) / len(code)
    grey = np.pad(np.where(code, look.white, look.black), 1, constant_values=look.white)
    grey = np.pad(grey, 1, constant_values=look.background)
    start, end, weight = [], [], []
    for i, line in enumerate(lines):
        for j in range(len(lines) - 1):
            a, b = lines[j], lines[j + 1]
            # upright border, upwards: inside on its left; level border, rightwards: inside above it
            start += [(line, a), (a, line)]
            end += [(line, b), (b, line)]
            weight += [grey[j + 1, i] - grey[j + 1, i + 1], grey[i + 1, j + 1] - grey[i, j + 1]]
    start, end, weight = np.array(start), np.array(end), np.array(weight)
    kept = weight != 0
    steps = np.linspace(0, 1, PIECES + 1)[:, None, None]
    points = start[kept] + steps * (end - start)[kept]
    return points[:-1].reshape(-1, 2), points[1:].reshape(-1, 2), np.tile(weight[kept], PIECES)


def add_border(image, start, end, weight, beyond=None):
    """Add weight times the signed area between a directed line and the left border to every pixel.

    The area is positive if the line runs down. If `beyond` (height, width + 1) is given, whole pixels to the
    line's left are counted there, in the line's column, to be summed once for many lines.
    """
    (x0, y0), (x1, y1) = (
        (start.tolist(), end.tolist()) if start[1] < end[1] else (end.tolist(), start.tolist())
    )
    signed = weight if start[1] < end[1] else -weight
    height, width = image.shape
    top, bottom = max(round(y0), 0), min(round(y1) + 1, height)
    left, right = min(max(math.floor(min(x0, x1)), 0), width), min(max(math.ceil(max(x0, x1)) + 1, 0), width)
    if top >= bottom or y0 == y1:
        return
    y = np.minimum(np.maximum(np.arange(top - 0.5, bottom + 0.5), y0), y1)
    rows = signed * (y[1:] - y[:-1])
    if beyond is None:
        image[top:bottom, :left] += rows[:, None]
    else:
        beyond[top:bottom, left] += rows
    if left == right:
        return
    X = np.arange(left - 0.5, right + 0.5)
    # integral of min(x, X) over y = integral of x - integral of max(x - X, 0); the first does not depend on X
    if abs(x1 - x0) < UPRIGHT_PX:
        over = np.maximum(0.5 * (x0 + x1) - X, 0.0) * (y - y0)[:, None]
    else:
        slope = (x1 - x0) / (y1 - y0)
        a, b = np.maximum((x0 + slope * (y - y0))[:, None] - X, 0.0), np.maximum(x0 - X, 0.0)
        over = (a - b) * (a + b) / (2 * slope)
    below = over[1:] - over[:-1]
    image[top:bottom, left:right] -= signed * (below[:, 1:] - below[:, :-1])


def paint(camera, tags, look, project=project):
    """Image (height, width) of tags without noise.

    `tags` is a list of (id, size [m], R_camera_marker, p_camera_marker [m]); none may hide another.
    """
    image = np.full((camera.height, camera.width), float(look.background))
    for marker_id, size, R, p in tags:
        start, end, weight = borders(marker_id, look)
        ends = project(camera, np.concatenate([start, end]) * size @ R[:, :2].T + p)
        margin = int(np.ceil(4 * look.blur)) + 1
        low = np.maximum(np.floor(ends.min(0)).astype(int) - margin, 0)
        high = np.minimum(np.ceil(ends.max(0)).astype(int) + margin + 1, [camera.width, camera.height])
        width, height = high - low
        if min(width, height) < 1:
            continue
        x, y = project(camera, corners_of(size)[::-1] @ R.T + p).T
        turn = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
        ends = FINE * (ends - low + 0.5) - 0.5
        fine, beyond = np.zeros((FINE * height, FINE * width)), np.zeros((FINE * height, FINE * width + 1))
        for a, b, w in zip(ends[: len(start)], ends[len(start) :], turn * weight, strict=True):
            add_border(fine, a, b, w, beyond)
        fine += np.cumsum(beyond[:, :0:-1], axis=1)[:, ::-1]
        # In single precision: 1e-5 grey levels off, in half the time.
        fine = cv2.GaussianBlur(fine.astype(np.float32), (0, 0), FINE * look.blur)
        mean = cv2.resize(fine, (int(width), int(height)), interpolation=cv2.INTER_AREA)
        image[low[1] : high[1], low[0] : high[0]] += mean
    return image


def render(camera, tags, rng, project=project, **look):
    """Image (height, width), uint8, of tags as a camera records it; `look` has the fields of `Look`.

    `tags` is as for `paint`.
    """
    look = Look(**look)
    image = paint(camera, tags, look, project)
    return np.clip(np.rint(image + rng.normal(0, look.noise, image.shape)), 0, 255).astype(np.uint8)
