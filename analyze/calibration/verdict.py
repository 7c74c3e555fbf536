"""Judges a calibration: reasons why the views do not determine the lens, and advice on further views."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.calibration.board_pose import Pose
    from analyze.calibration.lens import Lens
    from analyze.calibration.precision import PixelMap
    from analyze.types import Array

MIN_VIEWS = 6
"""least number of views; with fewer a bad one cannot be distinguished from the rest"""
MAX_FOCAL_SD, GOOD_FOCAL_SD = 0.01, 0.002
"""relative sd of the focal length above which the lens is refused, and above which a warning is given; a
centre of mass to 1 mm (method, targets) needs a lens to 0.2 %"""
MAX_MIDDLE_SD = 0.03
"""sd of the principal point, over the image's diagonal, above which the lens is refused"""
MAX_PIXEL_SD, GOOD_PIXEL_SD = 1.0, 0.3
"""largest sd of a pixel in the image [px] above which the lens is refused, and above which a warning is
given; a tag's corner is accurate to 0.01 px, and a tag moves through a third of the image in a tip"""
GOOD_ASPECT = 0.003
"""relative difference of fx and fy above which a warning is given"""
GOOD_SCATTER = 4.0
"""scatter of the corners, over their own noise, above which a warning is given"""
GOOD_COVERAGE = 0.6
"""share of the image's cells with corners, below which a warning is given"""
CELLS = (8, 6)
"""columns and rows of cells in which coverage is counted"""
_MIN_TILT_RAD = math.radians(12.0)
"""largest tilt [rad] of boards that count as facing the camera"""


@dataclass(frozen=True)
class Coverage:
    """Coverage of the image by the board's corners: their number, over all views, in each cell of a grid."""

    count: Array
    """(rows, columns) number of corners in each cell; `CELLS` gives columns and rows"""

    @property
    def share(self) -> float:
        """Share, 0 to 1, of the cells of a grid over the image that have at least one board corner."""
        return float(np.mean(self.count > 0))


def coverage(places: Sequence[Array], width: int, height: int) -> Coverage:
    """Count the board's corners in each cell of the image, all views together.

    Args:
        places: positions (n, 2) of the corners in each view, column and row as in the image [px].
        width: image width [px].
        height: image height [px].

    Returns:
        Number of corners per cell (rows, columns); `CELLS` holds the numbers of columns and rows.
    """
    points = np.concatenate(list(places))
    count, _, _ = np.histogram2d(
        points[:, 1], points[:, 0], bins=(CELLS[1], CELLS[0]), range=((0, height), (0, width))
    )
    return Coverage(count)


def tilt(pose: Pose, middle: Array) -> float:
    """Angle between a board's normal and the line of sight to its middle, 0 to pi/2 [rad].

    Args:
        pose: pose of the board in the camera's frame.
        middle: (3,) middle of the board in the board's frame [m].
    """
    R = pose.matrix
    sight = R @ middle + pose.translation
    return math.acos(min(1.0, abs(float(R[:, 2] @ sight)) / float(np.linalg.norm(sight))))


def undetermined(
    lens: Lens, sd: Array, pixels: PixelMap, tilts: Sequence[float], covered: Coverage
) -> list[str]:
    """Reasons why the views do not determine the lens, each with numbers and a remedy; empty if they do.

    The number of views and the focal length are always judged, the principal point and the distortion only if
    nothing was found before.

    Args:
        lens: the lens, with p numbers: focal lengths and principal point [px], distortion coefficients.
        sd: (p,) standard deviations of the lens's numbers, in their units.
        pixels: standard deviation [px] of the pixel to which a direction projects, over the image.
        tilts: angle between the board's normal and the line of sight per view [rad].
        covered: coverage of the image by corners of the board.
    """
    found: list[str] = []
    if len(tilts) < MIN_VIEWS:
        found.append(
            f"only {counted(len(tilts), 'view', 'fits')} one lens, at least {MIN_VIEWS} are needed, 15 "
            "are good: add views with the board held still"
        )
    names = dict(zip(lens.names, zip(lens.numbers, sd, strict=True), strict=True))
    focal, focal_sd = max((names["fx"], names["fy"]), key=lambda each: each[1] / each[0])
    if focal_sd > MAX_FOCAL_SD * focal:
        found.append(
            f"focal length {focal:.0f} ± {focal_sd:.0f} px ({100 * focal_sd / focal:.1f} %)"
            f" is not determined: {_tilt_advice(tilts)}"
        )
    off = max(names["cx"][1], names["cy"][1])
    if off > MAX_MIDDLE_SD * math.hypot(lens.width, lens.height) and not found:
        found.append(
            f"the image's middle ({names['cx'][0]:.0f}, {names['cy'][0]:.0f}) ± {off:.0f} px"
            f" is not determined: {_tilt_advice(tilts)}"
        )
    if pixels.worst > MAX_PIXEL_SD and not found:
        found.append(
            f"distortion is not determined at the {place_in_image(lens, *pixels.worst_at)} of the image,"
            f" ± {pixels.worst:.1f} px: corners were seen in {100 * covered.share:.0f} % of it:"
            " add views in which the board reaches into all four corners"
        )
    return found


def doubts(lens: Lens, sd: Array, pixels: PixelMap, scatter: float, covered: Coverage) -> list[str]:
    """Warnings about a usable lens, each with a number and a remedy or cause; empty if there are none.

    Args:
        lens: the lens: p numbers (fx, fy, cx, cy [px] and the distortion coefficients).
        sd: (p,) standard deviations of these numbers.
        pixels: standard deviation [px], over the image, of the pixel to which a direction projects.
        scatter: factor by which the corners' stated sd must grow to explain the residuals.
        covered: cells of a grid over the image in which corners were seen.
    """
    found: list[str] = []
    fx, fy = lens.numbers[:2]
    worst = float(max(sd[0] / fx, sd[1] / fy))
    if worst > GOOD_FOCAL_SD:
        found.append(
            f"focal length is known to {100 * worst:.1f} % only, 0.2 % is needed:"
            " add views tilted by 20-45 degrees"
        )
    if pixels.worst > GOOD_PIXEL_SD:
        found.append(
            f"the direction of a pixel is known to ± {pixels.worst:.2f} px only"
            f" at the {place_in_image(lens, *pixels.worst_at)} of the image: bring the board there"
        )
    if covered.share < GOOD_COVERAGE:
        found.append(
            f"corners were seen in {100 * covered.share:.0f} % of the image; elsewhere the lens follows"
            f" from its model only: add views in which the board reaches {_empty_parts(covered)}"
        )
    if abs(fx / fy - 1.0) > max(GOOD_ASPECT, 4.0 * math.hypot(sd[0] / fx, sd[1] / fy)):
        found.append(
            f"fx and fy differ by {100 * abs(fx / fy - 1.0):.1f} %: pixels are hardly ever"
            " that far from square, so that the print must be distorted: compare its two rulers"
        )
    if scatter > GOOD_SCATTER:
        found.append(
            f"corners lie {scatter:.0f} times farther off than their own noise: the board is not flat,"
            " or the lens is not of this model; the stated errors are scaled for it"
        )
    return found


def place_in_image(lens: Lens, column: float, row: float) -> str:
    """Words for a position in the image, by thirds, such as "upper left corner", "top" or "middle".

    Args:
        lens: lens with the image size.
        column: column [px].
        row: row [px].
    """
    across = "left" if column < lens.width / 3 else "right" if column > 2 * lens.width / 3 else ""
    down = "upper" if row < lens.height / 3 else "lower" if row > 2 * lens.height / 3 else ""
    if across and down:
        return f"{down} {across} corner"
    return f"{ {'upper': 'top', 'lower': 'bottom'}.get(down, down) or across or 'middle' }"


def _tilt_advice(tilts: Sequence[float]) -> str:
    """Part of a sentence that advises which tilted views to add.

    Args:
        tilts: angle between the board's normal and the line of sight per view [rad], at least one.
    """
    most = max(tilts)
    if most < _MIN_TILT_RAD:
        return (
            f"all boards face the camera within {math.degrees(most):.0f} degrees:"
            " add views with the board tilted by 20-45 degrees to the left, right, top and bottom"
        )
    least = math.degrees(min(tilts))
    return (
        f"boards are tilted by {least:.0f}-{math.degrees(most):.0f} degrees:"
        " add views at 20-45 degrees, to all four sides, nearer"
    )


def _empty_parts(covered: Coverage) -> str:
    """Part of a sentence that names those sides of the image where the board was hardly seen.

    The image is divided into a grid of cells (`CELLS`). Named are the sides along which less than half of the
    two outermost columns' or rows' cells contain a corner of the board. If there is no such side, or if all
    four are: "all four corners of the image".
    """
    seen = covered.count > 0
    parts = {"left": seen[:, :2], "right": seen[:, -2:], "top": seen[:2], "bottom": seen[-2:]}
    bare = [name for name, part in parts.items() if float(np.mean(part)) < 0.5]
    if len(bare) in {0, len(parts)}:
        return "all four corners of the image"
    return f"the {' and the '.join(bare)}"
