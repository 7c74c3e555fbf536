"""Images of a ChArUco board with known corners, independent of the estimator.

Lens formulas of their own, exact area coverage, blur before the pixels add up. The board's own frame: x
right, y up the page, z out of its face; origin at the lower left corner of the squares [m]. Upper left square
black, tags in the white ones row by row (OpenCV's pattern since 4.6). Models perspective, lens, blur, noise,
a white rim round the board and the grey around it; no shading, no depth of field, no bent paper unless `bend`
is given. Integer coordinates are pixel centres.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise

import cv2
import numpy as np

from schemas.session_manifest import LensModel
from tests.analyze.tracking.rendering import FINE, Look, add_border

UNITS = 20
"""raster units per square: a tag of 0.7 squares with 5 x 5 bits and its border has cells of two units, and a
white rim of 3 units"""
RIM = 16
"""width of the white paper round the squares [raster units]"""


@dataclass(frozen=True)
class TrueLens:
    """True lens of the simulated camera."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    k: tuple[float, ...]
    """distortion coefficients k1, k2, p1, p2, k3; of a fisheye k1, k2, k3, k4"""
    model: LensModel = LensModel.PINHOLE

    def project(self, points):
        """Pixels (..., 2) of points (..., 3) [m] in the camera frame C."""
        X, Y, Z = np.moveaxis(np.asarray(points, float), -1, 0)
        if self.model is LensModel.FISHEYE:
            radius = np.hypot(X, Y)
            angle = np.arctan2(radius, Z)
            bent = angle + sum(k * angle ** (3 + 2 * i) for i, k in enumerate(self.k))
            scale = bent / np.maximum(radius, 1e-12)
            return np.stack([self.fx * scale * X + self.cx, self.fy * scale * Y + self.cy], -1)
        k1, k2, p1, p2, k3 = self.k
        x, y = X / Z, Y / Z
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        return np.stack([self.fx * u + self.cx, self.fy * v + self.cy], -1)


@dataclass(frozen=True)
class TrueBoard:
    """A printed board: numbers of squares, edge of a square [m], tag family and bend."""

    columns: int = 7
    rows: int = 9
    square: float = 0.022
    family: int = cv2.aruco.DICT_5X5_100
    bend: float = 0.0
    """distance [m] of its middle from the plane of its left and right edges"""
    lines: tuple = field(init=False, compare=False)

    def __post_init__(self):
        object.__setattr__(self, "lines", _borders(self.columns, self.rows, self.square, self.family))

    @property
    def size(self):
        return np.array([self.columns, self.rows]) * self.square

    def corners(self):
        """Inner corners ((columns - 1) (rows - 1), 3) [m] in the board's frame, row by row from the top left.

        The order is OpenCV's.
        """
        x, y = np.meshgrid(np.arange(1, self.columns), self.rows - np.arange(1, self.rows))
        return self.surface(np.stack([x.ravel(), y.ravel()], 1) * self.square)

    def surface(self, points):
        """Points (n, 3) [m] of the bent paper at places `points` (n, 2) [m] of the flat one."""
        x = points[:, 0] / self.size[0]
        return np.column_stack([points, 4 * self.bend * x * (1 - x)])


@cache
def _borders(columns, rows, square, family):
    """Borders at which the grey of a board changes: start and end (n, 2) [m], and greys (n, 2).

    The greys are those inside and outside: 0 black, 1 white, NaN beyond the paper.
    """
    paper = np.ones((rows * UNITS, columns * UNITS))
    tags = cv2.aruco.getPredefinedDictionary(family)
    tag = 0
    for row in range(rows):
        for column in range(columns):
            area = paper[row * UNITS : (row + 1) * UNITS, column * UNITS : (column + 1) * UNITS]
            if (row + column) % 2 == 0:
                area[:] = 0
            else:
                code = cv2.aruco.generateImageMarker(tags, tag, tags.markerSize + 2) > 127
                side = 2 * len(code)
                inset = (UNITS - side) // 2
                area[inset : inset + side, inset : inset + side] = code.repeat(2, 0).repeat(2, 1)
                tag += 1
    rim = np.pad(paper, RIM, constant_values=1.0)[::-1]
    grey = np.pad(rim, 1, constant_values=np.nan)
    start, end, step = [], [], []
    # Upright borders run up, with their inside on the left; level ones run left, with their inside below.
    for outside, inside, place in (
        (grey[1:-1, 1:], grey[1:-1, :-1], lambda line, a, b: ((line, a), (line, b))),
        (grey[1:, 1:-1].T, grey[:-1, 1:-1].T, lambda line, a, b: ((b, line), (a, line))),
    ):
        for line in range(inside.shape[1]):
            for a, b in _runs(inside[:, line], outside[:, line]):
                ends = place(line, a, b)
                start.append(ends[0])
                end.append(ends[1])
                step.append((inside[a, line], outside[a, line]))
    scale = square / UNITS
    return (np.array(start) - RIM) * scale, (np.array(end) - RIM) * scale, np.array(step)


def _runs(inside, outside):
    """Yield stretches [first, end) along which the greys on either side differ and do not change.

    A stretch has two units at most.
    """
    differ = (inside != outside) & ~(np.isnan(inside) & np.isnan(outside))
    changes = [True, *(~(_alike(inside) & _alike(outside))).tolist(), True]
    first = 0
    for i in range(1, len(inside) + 1):
        if changes[i] or i - first == 2:
            if differ[first]:
                yield first, i
            first = i


def _alike(grey):
    """True (n - 1,) where a grey of `grey` (n,) equals the one before it."""
    return (grey[1:] == grey[:-1]) | (np.isnan(grey[1:]) & np.isnan(grey[:-1]))


def picture(lens, board, R, p, look=None, pieces=1):
    """Grey values (height, width) of a board without noise; R (3, 3) and p (3,) map its frame to C."""
    look = look or Look()
    start, end, step = board.lines
    greys = np.where(np.isnan(step), look.background, look.black + (look.white - look.black) * step)
    along = np.linspace(0, 1, pieces + 1)[:, None, None]
    points = start + along * (end - start)
    pixels = lens.project(board.surface(points.reshape(-1, 2)) @ R.T + p).reshape(pieces + 1, -1, 2)
    # A face seen from the front turns its border clockwise in an image whose y points down.
    weight = -(greys[:, 0] - greys[:, 1])
    fine = np.zeros((FINE * lens.height, FINE * lens.width + 1))
    ends = FINE * (pixels + 0.5) - 0.5
    height, width = fine.shape
    beyond = np.zeros((height, width + 1))
    for a, b in pairwise(ends):
        seen = (np.maximum(a, b).min(1) > -2) & (np.minimum(a, b)[:, 1] < height + 2)
        for s, e, w in zip(a[seen], b[seen], weight[seen], strict=True):
            add_border(fine, s, e, w, beyond)
    fine += np.cumsum(beyond[:, ::-1], axis=1)[:, ::-1][:, 1:]
    fine = cv2.GaussianBlur((fine[:, :-1] + look.background).astype(np.float32), (0, 0), FINE * look.blur)
    return fine.reshape(lens.height, FINE, lens.width, FINE).mean((1, 3))


def photograph(lens, board, R, p, rng, look=None, pieces=1):
    """Image (height, width), uint8, of a board as the camera records it, with noise."""
    look = look or Look()
    image = picture(lens, board, R, p, look, pieces)
    return np.clip(np.rint(image + rng.normal(0, look.noise, image.shape)), 0, 255).astype(np.uint8)


def facing(board, middle, tilt=0.0, towards=0.0, spin=0.0):
    """Rotation R (3, 3) and translation p (3,) [m] of a board whose middle is at `middle` (3,) in C.

    It is tilted about the direction `towards` in the image, and spun in its own plane [rad].
    """
    lean = cv2.Rodrigues(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))[0]
    turn = cv2.Rodrigues(np.array([0.0, 0.0, spin]))[0]
    R = lean @ turn @ np.diag([1.0, -1.0, -1.0])
    return R, np.asarray(middle) - R @ np.array([*(board.size / 2), 0.0])
