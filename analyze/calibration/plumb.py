"""Determines the direction of gravity from plumb lines (strings with a weight) in view of the camera.

The image of a string and the camera's centre span a plane that contains the vertical. One string determines
the lean of the vertical across the line of sight, not along it; strings at different places in the image
determine both, the second weakly, because their planes meet at angles of only some degrees. Strings
are found as ridges, dark or bright, to a few hundredths of a pixel per row (zero of the first derivative
across them, Steger 1998), and undistorted before a line is fitted.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

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
"""widths of the ridge filter [px]: for strings of 1 to 10 px"""
MIN_CONTRAST = 6.0
"""least contrast of a row's ridge at its scale [grey levels]"""
MAX_SLOPE = math.tan(math.radians(20.0))
"""largest slope of a string in the image, columns per row"""
SLOPE_COUNT, VOTE_STEP_PX = 121, 2.0
"""number of slopes, and spacing of positions [px], in the first search for a line"""
MAX_DISTANCE_PX = 1.5
"""distance from the line within which a row belongs to it [px]"""
MIN_ROWS_SHARE = 0.4
"""least share of the image's height over which a string must be seen"""
MIN_SEPARATION_PX = 12.0
"""separation [px] below which two lines are the same string, found twice or by its two sides"""
MOST_LINES = 6
"""largest number of strings"""
MAX_SAGITTA_PX = 0.35
"""largest sagitta [px] after undistortion; a line that bends more is not a string, or the lens is wrong"""
MIN_END_SD_PX = 0.02
"""least sd at either end of a string [px], caused by lens and pixels; more rows do not reduce it"""
MAX_OFF_PLUMB_RAD = math.radians(5.0)
"""largest angle of a plumb line from W's z [rad]"""
MAX_PRIOR_SIGMAS = 3.0
"""lean, in prior standard deviations, above which plumb lines contradict the prior"""
MAX_SD_SHARE = 0.5
"""largest sd of a lean that the lines determine, as a share of the prior's"""


@dataclass(frozen=True)
class PlumbLine:
    """Image of one hanging string: a line between two end points [undistorted px], with their sd [px].

    It also holds the number of image rows, the scatter about the line, and whether the string is dark.
    """

    bottom: Array
    """(2,) lowest point seen [undistorted px]"""
    top: Array
    """(2,) highest point seen [undistorted px]"""
    end_sd: float
    """standard deviation of either end across the line [px]"""
    rows: int
    """number of rows in which it was found"""
    dark: bool
    """True if the string is darker than the background"""
    scatter: float
    """rms distance of the rows' points from the line [px]"""


@dataclass(frozen=True)
class TableLean:
    """Table tilt from plumb lines: lean [rad] of the vertical from the table's normal.

    In the world frame W (z normal to the table) the vertical is (lean_x, lean_y, 1): a positive lean means
    that the table is higher towards that axis.
    """

    lean: Array
    """(2,) lean towards W's x and y [rad]"""
    covariance: Array
    """(2, 2) covariance of the lean, prior included [rad^2]"""
    prior_sd: float
    """prior standard deviation of either lean [rad]"""
    scatter: float
    """scatter of the lines about `lean_by_lines`, over their own sd, at least 1"""
    residual: Array
    """(n,) angle between each of n lines' planes and the vertical by `lean_by_lines` [rad]"""
    lean_by_lines: Array
    """(2,) lean [rad] of the vertical as the lines show it, if the camera's pose has no error"""
    lines_prior_sd: float
    """prior standard deviation [rad] of `lean_by_lines`: table tilt and camera rotation together"""

    @property
    def contradicts_prior(self) -> bool:
        """True if the plumb lines show an implausibly large lean of the vertical.

        Then a line is no plumb line, or the prior is wrong. Implausible is a `lean_by_lines` towards x or y
        of more than `MAX_PRIOR_SIGMAS` times its prior sd (before the lines were used).
        """
        return bool(np.max(np.abs(self.lean_by_lines)) > MAX_PRIOR_SIGMAS * self.lines_prior_sd)

    @property
    def sd(self) -> Array:
        """Standard deviations (2,) [rad] of the vertical's lean towards the world frame's x and y."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def determined(self) -> tuple[bool, bool]:
        """Two values, for the lean towards W's x and towards its y: True if the plumb lines determine it.

        W is the world frame, z normal to the table. A lean is determined if its sd is below `MAX_SD_SHARE` of
        its prior sd, the one before the lines were used.
        """
        x, y = (bool(sd < MAX_SD_SHARE * self.prior_sd) for sd in self.sd)
        return x, y


def find_plumb_lines(image: NDArray[np.uint8], camera: CameraModel) -> list[PlumbLine]:
    """Find long, straight lines near the vertical of an image, which may be hanging strings.

    Lines nearer together than `MIN_SEPARATION_PX` count as one string.

    Args:
        image: (height, width) grey values.
        camera: camera with its lens, for the undistortion.

    Returns:
        At most `MOST_LINES` lines, the longest first, with their ends [undistorted px]; empty if none is
        found.
    """
    ideal = pixel_map(camera).ideal
    found: list[PlumbLine] = []
    for dark, most in ((True, 4 * MOST_LINES), (False, 8 * MOST_LINES)):
        for scale in SCALES_PX:
            points = _ridge_points(image, ideal, scale, dark)
            while len(found) < most:
                line = _longest(points, image.shape[0], dark)
                if line is None:
                    break
                found.append(line)
                points = points[np.abs(_across(points, line)) > MIN_SEPARATION_PX / 2]
    found.sort(key=lambda line: (-line.rows, line.scatter))
    distinct: list[PlumbLine] = []
    for line in found:
        if all(_separation(line, other) > MIN_SEPARATION_PX for other in distinct):
            distinct.append(line)
    return distinct[:MOST_LINES]


def upright(lines: Sequence[PlumbLine], camera: CameraModel) -> list[PlumbLine]:
    """Lines that may be plumb lines, in the order given: those nearly parallel to the world frame's z.

    The plane through the camera's centre and the line must be within `MAX_OFF_PLUMB_RAD` of z.

    Args:
        lines: lines in the image.
        camera: camera with its pose in the world frame.
    """
    return [
        line
        for line in lines
        if abs(math.asin(float(np.clip(plane_normal(line, camera)[2], -1, 1)))) < MAX_OFF_PLUMB_RAD
    ]


def merged_line(lines: Sequence[PlumbLine]) -> PlumbLine:
    """Mean of the lines that one string has in several images.

    The sd of its ends [px] grows with their disagreement (a swinging string). Everything except the ends and
    their sd is that of the longest line.

    Args:
        lines: at least one line; a single one is returned unchanged.
    """
    if len(lines) == 1:
        return lines[0]
    heights = np.array(
        [np.mean([line.bottom[1] for line in lines]), np.mean([line.top[1] for line in lines])]
    )
    slopes = np.array([(line.bottom - line.top)[0] / (line.bottom - line.top)[1] for line in lines])
    columns = np.array(
        [
            line.bottom[0] + slope * (heights - line.bottom[1])
            for line, slope in zip(lines, slopes, strict=True)
        ]
    )
    ends = np.column_stack([columns.mean(axis=0), heights])
    own = float(np.mean([line.end_sd**2 for line in lines])) - MIN_END_SD_PX**2
    between = float(np.var(columns, axis=0, ddof=1).max())
    end_sd = math.sqrt(max(own, between) / len(lines) + MIN_END_SD_PX**2)
    longest = max(lines, key=lambda line: line.rows)
    return replace(longest, bottom=ends[0], top=ends[1], end_sd=end_sd)


def plane_normal(line: PlumbLine, camera: CameraModel) -> Array:
    """Unit normal (3,), in the world frame, of the plane through the camera's centre and a string.

    The plane contains the vertical if the string hangs freely. The sign of the normal has no meaning.

    Args:
        line: image of the string.
        camera: camera with its pose in the world frame.
    """
    rays = np.column_stack([np.array([line.bottom, line.top]), np.ones(2)]) @ np.linalg.inv(camera.K).T
    normal = camera.T_world_camera[:3, :3] @ np.cross(rays[0], rays[1])
    return np.asarray(normal / np.linalg.norm(normal), dtype=np.float64)


def table_lean(
    lines: Sequence[PlumbLine], camera: CameraModel, prior_sd: float, camera_turn_sd: float
) -> TableLean:
    """Estimate how the vertical leans from the table's normal, from plumb lines and a prior.

    In the world frame W (z normal to the table) the vertical is (lean_x, lean_y, 1). For the unit normal n of
    the plane through a line and the camera's centre, n_x lean_x + n_y lean_y + n_z = 0: solved by least
    squares.

    Args:
        lines: plumb lines of one camera, at least one; several images of a string by a fixed camera are
            merged before (`merged_line`).
        camera: camera with its pose in W.
        prior_sd: standard deviation of either lean before the measurement (prior) [rad].
        camera_turn_sd: standard deviation of T_world_camera's rotation about each axis of W [rad], common to
            all lines.

    Returns:
        The lean (2,) towards W's x and y [rad] with its covariance, and per line the angle [rad] between its
        plane and the vertical that the lines show.
    """
    normals = np.array([plane_normal(line, camera) for line in lines])
    sd = np.array([_turn_sd(line) for line in lines])
    rows = normals[:, :2]
    # An error of the camera's rotation rotates the vertical that it shows: the lean by the lines is the sum
    # of the table's and the camera's.
    seen_prior = math.hypot(prior_sd, camera_turn_sd)

    def solved(sd: Array) -> tuple[Array, Array]:
        weighted = rows / sd[:, None]
        covariance: Array = np.asarray(
            np.linalg.inv(weighted.T @ weighted + np.eye(2) / seen_prior**2), dtype=np.float64
        )
        return covariance @ (weighted.T @ (-normals[:, 2] / sd)), covariance

    seen, covariance = solved(sd)
    misfit = (rows @ seen + normals[:, 2]) / sd
    freedom = len(lines) - float(np.trace(covariance @ ((rows / sd[:, None]).T @ (rows / sd[:, None]))))
    scatter = math.sqrt(max(1.0, float(misfit @ misfit) / max(freedom, 1.0)))
    seen, covariance = solved(sd * scatter)
    share = prior_sd**2 / seen_prior**2
    lean = share * seen
    total = share**2 * covariance + np.eye(2) * share * camera_turn_sd**2
    return TableLean(lean, total, prior_sd, scatter, rows @ seen + normals[:, 2], seen, seen_prior)


def _turn_sd(line: PlumbLine) -> float:
    """Standard deviation of a line's direction in the image [rad], from that of the line's ends."""
    return math.sqrt(2.0) * line.end_sd / float(np.linalg.norm(line.top - line.bottom))


def _ridge_points(image: NDArray[np.uint8], ideal: Array, scale: float, dark: bool) -> Array:
    """Points (n, 3) on ridges (images of strings), found row by row: x and y [undistorted px], row number.

    Args:
        image: (height, width) grey values.
        ideal: (height, width, 2) undistorted position of every pixel [px].
        scale: width of the ridge filter [px].
        dark: True for ridges darker than their surroundings, False for brighter ones.
    """
    grey = image.astype(np.float64)
    first = gaussian_filter1d(grey, scale, axis=1, order=1)
    second = gaussian_filter1d(grey, scale, axis=1, order=2) * (1.0 if dark else -1.0)
    strong = second * scale**2 > MIN_CONTRAST
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
    """Straight line through the most of the given points, found by votes and refined by least squares.

    Args:
        points: (n, 3) x and y [undistorted px], and row number.
        height: height of the image [px].
        dark: True if the points are of dark ridges.

    Returns:
        The line between its two ends [undistorted px]; None if it covers less than `MIN_ROWS_SHARE` of the
        rows, or bends by more than `MAX_SAGITTA_PX`.
    """
    if len(points) < MIN_ROWS_SHARE * height:
        return None
    middle = float(np.median(points[:, 1]))
    best, most = (0.0, 0.0), 0.0
    for slope in np.linspace(-MAX_SLOPE, MAX_SLOPE, SLOPE_COUNT).tolist():
        at = (points[:, 0] - slope * (points[:, 1] - middle)) / VOTE_STEP_PX
        low = float(at.min())
        votes = np.bincount((at - low).astype(np.int64))
        pairs = votes[:-1] + votes[1:] if len(votes) > 1 else votes
        top = int(np.argmax(pairs))
        if pairs[top] > most:
            best, most = (slope, (low + top + 1.0) * VOTE_STEP_PX), float(pairs[top])
    if most < MIN_ROWS_SHARE * height:
        return None
    slope, place = best
    # At the ends the rows of a line lie off it by up to half a step of the slope.
    near = 2 * VOTE_STEP_PX + MAX_SLOPE / SLOPE_COUNT * height
    kept = points
    for _ in range(12):
        off = points[:, 0] - place - slope * (points[:, 1] - middle)
        kept = points[np.abs(off) < near]
        if len(kept) < MIN_ROWS_SHARE * height:
            return None
        slope, place = (float(value) for value in np.polyfit(kept[:, 1] - middle, kept[:, 0], 1))
        spread = float(np.std(kept[:, 0] - place - slope * (kept[:, 1] - middle)))
        near = (
            max(min(near / 1.6, MAX_DISTANCE_PX), 3.5 * spread)
            if near > MAX_DISTANCE_PX
            else max(0.3, min(MAX_DISTANCE_PX, 3.5 * spread))
        )
    rows = len(np.unique(kept[:, 2]))
    if rows < MIN_ROWS_SHARE * height:
        return None
    along = kept[:, 1] - middle
    off = kept[:, 0] - place - slope * along
    half = 0.5 * float(np.ptp(along))
    bend = float(np.polyfit(along / half, off, 2)[0])
    if abs(bend) > MAX_SAGITTA_PX:
        return None
    scatter = float(np.sqrt(np.mean(off**2)))
    # Neighbouring rows share the discretisation error of a line that crosses pixels slowly.
    alike = _correlated_rows(off[np.argsort(kept[:, 2], kind="stable")])
    end_sd = math.hypot(2.0 * scatter * math.sqrt(alike / rows), MIN_END_SD_PX, bend)
    ends = [np.array([place + slope * y, middle + y]) for y in (float(along.max()), float(along.min()))]
    return PlumbLine(ends[0], ends[1], end_sd, rows, dark, scatter)


def _correlated_rows(off: Array) -> float:
    """Number of neighbouring rows whose residuals count as one, from the residuals' autocorrelation.

    It is 1 for fewer than 20 rows or if all residuals are equal.

    Args:
        off: (n,) residuals of a line's points, row by row [px].
    """
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
    """Signed distance (n,) [px] of points from an unbounded line, positive to its left in the image.

    Args:
        points: (n, 3) x and y [undistorted px], and a number that is not used.
        line: the line.
    """
    along = (line.top - line.bottom) / np.linalg.norm(line.top - line.bottom)
    return (points[:, 0] - line.bottom[0]) * along[1] - (points[:, 1] - line.bottom[1]) * along[0]


def _separation(line: PlumbLine, other: PlumbLine) -> float:
    """Mean distance [undistorted px] of the ends and the middle of `line` from the line `other`."""
    ends = np.column_stack([np.array([line.bottom, line.top, (line.bottom + line.top) / 2]), np.zeros(3)])
    return float(np.abs(_across(ends, other)).mean())
