"""Gravity from plumb lines in view: a string's image and the camera's centre span a plane that holds the vertical.

One string tells the lean across the line of sight and nothing of the lean along it; strings at different places in the image tell both,
the second weakly: their planes meet in the vertical, at angles of some degrees. Strings are found as ridges, dark or bright, to a few
hundredths of a pixel a row (zero of the first derivative across them, Steger 1998), and straightened by the lens before a line is fitted.
"""

# scipy is only partly typed; its unknowns are no mistakes of ours.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import gaussian_filter1d

from analyze.tracking.camera_model import pixel_map

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel

SCALES_PX = (1.2, 2.0, 3.4)
"""of the ridge filter: strings of 1 to 10 px"""
LEAST_CONTRAST = 6.0
"""grey levels, of a row's ridge at its scale"""
STEEPEST = math.tan(math.radians(20.0))
"""of a string in the image, against its columns"""
SLOPES, STEP_PX = 121, 2.0
"""of the first search"""
NEAR_PX = 1.5
LEAST_ROWS = 0.4
"""part of the image's height that a string must be seen over"""
APART_PX = 12.0
"""strings nearer than this are one, seen again or from its other side"""
MOST_LINES = 6
CURVED = 0.35
"""px of sagitta: a line that bends more through the lens is no string, or the lens is another one"""
FLOOR_PX = 0.02
"""px, 1 sigma at either end of a string: lens and pixels, which no number of rows averages out"""
OFF_PLUMB = math.radians(5.0)
"""a straight line farther off W's vertical is no plumb line"""
UNLIKELY = 3.0
"""times what was known before: a lean beyond it is doubted"""
DETERMINED = 0.5
"""a lean whose sd is above this part of the prior's is not determined"""


@dataclass(frozen=True)
class PlumbLine:
    """One string in one image."""

    bottom: Array
    """(2,) ideal px, lowest point seen"""
    top: Array
    """(2,) ideal px"""
    end_sd: float
    """px, 1 sigma of either end across the line"""
    rows: int
    dark: bool
    scatter: float
    """px rms of its rows"""


@dataclass(frozen=True)
class PlumbedTable:
    """How far the vertical leans towards W's x and y: the table rises that way by as much."""

    lean: Array
    """(2,) rad"""
    covariance: Array
    """(2, 2) rad^2, with what was known before"""
    prior_sd: float
    """rad"""
    scatter: float
    """of the lines about the answer, in units of their sd; at least 1 is taken"""
    residual: Array
    """(lines,) rad, each line's turn against the answer"""
    shown: Array
    """(2,) rad, the lean as the lines alone show it, by a camera that stands as it is taken to"""
    shown_prior_sd: float
    """rad, 1 sigma of it before: the prior's and the camera's turn together"""

    @property
    def unlikely(self) -> bool:
        """What the lines show is not what was known before: one of the two is wrong, and the answer lies between them."""
        return bool(np.max(np.abs(self.shown)) > UNLIKELY * self.shown_prior_sd)

    @property
    def sd(self) -> Array:
        """(2,) rad."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def determined(self) -> tuple[bool, bool]:
        """Whether the lines tell clearly more than was known before."""
        x, y = (bool(sd < DETERMINED * self.prior_sd) for sd in self.sd)
        return x, y


def find_plumb_lines(image: NDArray[np.uint8], camera: CameraModel) -> list[PlumbLine]:
    """Long straight ridges that stand upright in an image (height, width), the longest first."""
    ideal = pixel_map(camera).ideal
    found: list[PlumbLine] = []
    for dark in (True, False):
        for scale in SCALES_PX:
            points = _ridge_points(image, ideal, scale, dark)
            while len(found) < 4 * MOST_LINES:
                line = _longest(points, image.shape[0], dark)
                if line is None:
                    break
                found.append(line)
                points = points[np.abs(_across(points, line)) > APART_PX / 2]
    found.sort(key=lambda line: (-line.rows, line.scatter))
    distinct: list[PlumbLine] = []
    for line in found:
        if all(_apart(line, other) > APART_PX for other in distinct):
            distinct.append(line)
    return distinct[:MOST_LINES]


def upright(lines: Sequence[PlumbLine], camera: CameraModel) -> list[PlumbLine]:
    """Those that can be plumb: within some degrees of W's vertical."""
    return [line for line in lines if abs(math.asin(float(np.clip(plane_normal(line, camera)[2], -1, 1)))) < OFF_PLUMB]


def together(lines: Sequence[PlumbLine]) -> PlumbLine:
    """One string seen in several images: the mean, as sure as its images agree (a string that swings does not)."""
    if len(lines) == 1:
        return lines[0]
    heights = np.array([np.mean([line.bottom[1] for line in lines]), np.mean([line.top[1] for line in lines])])
    slopes = np.array([(line.bottom - line.top)[0] / (line.bottom - line.top)[1] for line in lines])
    columns = np.array([line.bottom[0] + slope * (heights - line.bottom[1]) for line, slope in zip(lines, slopes, strict=True)])
    ends = np.column_stack([columns.mean(axis=0), heights])
    own = float(np.mean([line.end_sd**2 for line in lines])) - FLOOR_PX**2
    between = float(np.var(columns, axis=0, ddof=1).max())
    end_sd = math.sqrt(max(own, between) / len(lines) + FLOOR_PX**2)
    longest = max(lines, key=lambda line: line.rows)
    return replace(longest, bottom=ends[0], top=ends[1], end_sd=end_sd)


def plane_normal(line: PlumbLine, camera: CameraModel) -> Array:
    """Unit normal (3,) in W of the plane through the camera's centre and the string."""
    rays = np.column_stack([np.array([line.bottom, line.top]), np.ones(2)]) @ np.linalg.inv(camera.K).T
    normal = camera.T_world_camera[:3, :3] @ np.cross(rays[0], rays[1])
    return np.asarray(normal / np.linalg.norm(normal), dtype=np.float64)


def plumbed_table(lines: Sequence[PlumbLine], camera: CameraModel, prior_sd: float, camera_turn_sd: float) -> PlumbedTable:
    """The vertical (lean, 1) that lies in every line's plane: n_x lean_x + n_y lean_y + n_z = 0, by least squares.

    Args:
        lines: plumb lines of one camera; different images of one camera that stood still are alike.
        camera: with its place in W.
        prior_sd: rad, 1 sigma of either lean before.
        camera_turn_sd: rad, 1 sigma of T_world_camera's turn about each axis of W: all lines share it.
    """
    normals = np.array([plane_normal(line, camera) for line in lines])
    sd = np.array([_turn_sd(line) for line in lines])
    rows = normals[:, :2]
    # A camera that is turned turns the vertical it shows: the lean that the lines tell is the table's plus the camera's own.
    seen_prior = math.hypot(prior_sd, camera_turn_sd)

    def solved(sd: Array) -> tuple[Array, Array]:
        weighted = rows / sd[:, None]
        covariance: Array = np.asarray(np.linalg.inv(weighted.T @ weighted + np.eye(2) / seen_prior**2), dtype=np.float64)
        return covariance @ (weighted.T @ (-normals[:, 2] / sd)), covariance

    seen, covariance = solved(sd)
    misfit = (rows @ seen + normals[:, 2]) / sd
    freedom = len(lines) - float(np.trace(covariance @ ((rows / sd[:, None]).T @ (rows / sd[:, None]))))
    scatter = math.sqrt(max(1.0, float(misfit @ misfit) / max(freedom, 1.0)))
    seen, covariance = solved(sd * scatter)
    share = prior_sd**2 / seen_prior**2
    lean = share * seen
    total = share**2 * covariance + np.eye(2) * share * camera_turn_sd**2
    return PlumbedTable(lean, total, prior_sd, scatter, rows @ seen + normals[:, 2], seen, seen_prior)


def _turn_sd(line: PlumbLine) -> float:
    """1 sigma [rad] of the line's direction in the image."""
    return math.sqrt(2.0) * line.end_sd / float(np.linalg.norm(line.top - line.bottom))


def _ridge_points(image: NDArray[np.uint8], ideal: Array, scale: float, dark: bool) -> Array:
    """(n, 3) ideal px and row number of the ridges' middles in every row."""
    grey = image.astype(np.float64)
    first = gaussian_filter1d(grey, scale, axis=1, order=1)
    second = gaussian_filter1d(grey, scale, axis=1, order=2) * (1.0 if dark else -1.0)
    strong = second * scale**2 > LEAST_CONTRAST
    strong[:, :4] = strong[:, -4:] = False
    row, column = np.nonzero(strong)
    shift = -first[row, column] / (second[row, column] * (1.0 if dark else -1.0))
    middle = np.abs(shift) <= 0.5
    row, column, shift = row[middle], column[middle], shift[middle]
    beside = np.where(shift >= 0, 1, -1)
    here, there = ideal[row, column], ideal[row, column + beside]
    points = np.column_stack([here + np.abs(shift)[:, None] * (there - here), row])
    return np.asarray(points[np.isfinite(points).all(axis=1)], dtype=np.float64)


def _longest(points: Array, height: int, dark: bool) -> PlumbLine | None:
    """The straight line with most rows, by votes and then by least squares."""
    if len(points) < LEAST_ROWS * height:
        return None
    middle = float(np.median(points[:, 1]))
    best, most = (0.0, 0.0), 0.0
    for slope in np.linspace(-STEEPEST, STEEPEST, SLOPES).tolist():
        at = (points[:, 0] - slope * (points[:, 1] - middle)) / STEP_PX
        low = float(at.min())
        votes = np.bincount((at - low).astype(np.int64))
        pairs = votes[:-1] + votes[1:] if len(votes) > 1 else votes
        top = int(np.argmax(pairs))
        if pairs[top] > most:
            best, most = (slope, (low + top + 1.0) * STEP_PX), float(pairs[top])
    if most < LEAST_ROWS * height:
        return None
    slope, place = best
    # Votes lie within half the slopes' step at the ends.
    near = 2 * STEP_PX + STEEPEST / SLOPES * height
    kept = points
    for _ in range(12):
        off = points[:, 0] - place - slope * (points[:, 1] - middle)
        kept = points[np.abs(off) < near]
        if len(kept) < LEAST_ROWS * height:
            return None
        slope, place = (float(value) for value in np.polyfit(kept[:, 1] - middle, kept[:, 0], 1))
        spread = float(np.std(kept[:, 0] - place - slope * (kept[:, 1] - middle)))
        near = max(min(near / 1.6, NEAR_PX), 3.5 * spread) if near > NEAR_PX else max(0.3, min(NEAR_PX, 3.5 * spread))
    rows = len(np.unique(kept[:, 2]))
    if rows < LEAST_ROWS * height:
        return None
    along = kept[:, 1] - middle
    off = kept[:, 0] - place - slope * along
    half = 0.5 * float(np.ptp(along))
    bend = float(np.polyfit(along / half, off, 2)[0])
    if abs(bend) > CURVED:
        return None
    scatter = float(np.sqrt(np.mean(off**2)))
    # Neighbouring rows share what the pixels make of a line that crosses them slowly.
    alike = _correlated(off[np.argsort(kept[:, 2], kind="stable")])
    end_sd = math.hypot(2.0 * scatter * math.sqrt(alike / rows), FLOOR_PX, bend)
    ends = [np.array([place + slope * y, middle + y]) for y in (float(along.max()), float(along.min()))]
    return PlumbLine(ends[0], ends[1], end_sd, rows, dark, scatter)


def _correlated(off: Array) -> float:
    """Rows that count as one, from the scatter's own correlation."""
    centred = off - off.mean()
    power = float(centred @ centred)
    if power <= 0 or len(off) < 20:
        return 1.0
    total = 1.0
    for lag in range(1, len(off) // 4):
        share = float(centred[:-lag] @ centred[lag:]) / power
        if share < 0.05:
            break
        total += 2 * share
    return total


def _across(points: Array, line: PlumbLine) -> Array:
    along = (line.top - line.bottom) / np.linalg.norm(line.top - line.bottom)
    return (points[:, 0] - line.bottom[0]) * along[1] - (points[:, 1] - line.bottom[1]) * along[0]


def _apart(line: PlumbLine, other: PlumbLine) -> float:
    """Mean distance [px] of a line's ends from another."""
    ends = np.column_stack([np.array([line.bottom, line.top, (line.bottom + line.top) / 2]), np.zeros(3)])
    return float(np.abs(_across(ends, other)).mean())
