"""Whether the views determine the lens, and which views to add where they do not."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.calibration.lens import Lens
    from analyze.calibration.precision import PixelMap
    from analyze.calibration.solve import Pose
    from analyze.types import Array

LEAST_VIEWS = 6
"""with fewer a bad one cannot be told from the rest"""
FOCAL_REFUSED, FOCAL_DOUBTED = 0.01, 0.002
"""relative sd; a centre of mass of 1 mm (METHOD's targets) allows a lens 0.2 % off"""
MIDDLE_REFUSED = 0.03
"""sd of the image's middle over its diagonal"""
PIXEL_REFUSED, PIXEL_DOUBTED = 1.0, 0.3
"""px, sd anywhere in the image; a tag's corner is known to 0.01 px, and a tag moves through a third of the image in a tip"""
ASPECT_DOUBTED = 0.003
SCATTER_DOUBTED = 4.0
COVERED_DOUBTED = 0.6
CELLS = (8, 6)
"""columns and rows of the coverage"""
_FLAT = math.radians(12.0)


@dataclass(frozen=True)
class Coverage:
    """What of the image the corners cover."""

    count: Array
    """(rows, columns) corners in each cell, all views"""

    @property
    def share(self) -> float:
        """Cells with at least one corner."""
        return float(np.mean(self.count > 0))


def coverage(places: Sequence[Array], width: int, height: int) -> Coverage:
    """Of the corners (n, 2) px of each view."""
    points = np.concatenate(list(places))
    count, _, _ = np.histogram2d(points[:, 1], points[:, 0], bins=(CELLS[1], CELLS[0]), range=((0, height), (0, width)))
    return Coverage(count)


def tilt(pose: Pose, middle: Array) -> float:
    """Angle [rad] between the board's normal and the line of sight to its middle (3,) m in B."""
    R = pose.matrix
    sight = R @ middle + pose.translation
    return math.acos(min(1.0, abs(float(R[:, 2] @ sight)) / float(np.linalg.norm(sight))))


def undetermined(lens: Lens, sd: Array, pixels: PixelMap, tilts: Sequence[float], covered: Coverage) -> list[str]:
    """What the views leave open, each with the number and with the views to add; empty where the lens is determined."""
    found: list[str] = []
    if len(tilts) < LEAST_VIEWS:
        found.append(
            f"only {len(tilts)} views fit one lens, at least {LEAST_VIEWS} are needed, 15 are good: add views with the board held still"
        )
    names = dict(zip(lens.names, zip(lens.numbers, sd, strict=True), strict=True))
    focal, focal_sd = max((names["fx"], names["fy"]), key=lambda each: each[1] / each[0])
    if focal_sd > FOCAL_REFUSED * focal:
        found.append(
            f"focal length {focal:.0f} ± {focal_sd:.0f} px ({100 * focal_sd / focal:.1f} %) is not determined: {_tilt_advice(tilts)}"
        )
    off = max(names["cx"][1], names["cy"][1])
    if off > MIDDLE_REFUSED * math.hypot(lens.width, lens.height) and not found:
        found.append(
            f"the image's middle ({names['cx'][0]:.0f}, {names['cy'][0]:.0f}) ± {off:.0f} px is not determined: {_tilt_advice(tilts)}"
        )
    if pixels.worst > PIXEL_REFUSED and not found:
        found.append(
            f"distortion is not determined at the {where(lens, *pixels.worst_at)} of the image, ± {pixels.worst:.1f} px"
            f": corners were seen in {100 * covered.share:.0f} % of it: add views in which the board reaches into all four corners"
        )
    return found


def doubts(lens: Lens, sd: Array, pixels: PixelMap, scatter: float, covered: Coverage) -> list[str]:
    """What is usable but not as it should be."""
    found: list[str] = []
    fx, fy = lens.numbers[:2]
    worst = float(max(sd[0] / fx, sd[1] / fy))
    if worst > FOCAL_DOUBTED:
        found.append(f"focal length is known to {100 * worst:.1f} % only, 0.2 % is asked for: add views tilted by 20-45 degrees")
    if pixels.worst > PIXEL_DOUBTED:
        found.append(
            f"pixels are known to ± {pixels.worst:.2f} px only at the {where(lens, *pixels.worst_at)} of the image: bring the board there"
        )
    if covered.share < COVERED_DOUBTED:
        found.append(
            f"corners were seen in {100 * covered.share:.0f} % of the image; what the lens does in the rest follows from its model only: "
            f"add views in which the board reaches {_empty(covered)}"
        )
    if abs(fx / fy - 1.0) > max(ASPECT_DOUBTED, 4.0 * math.hypot(sd[0] / fx, sd[1] / fy)):
        found.append(
            f"fx and fy differ by {100 * abs(fx / fy - 1.0):.1f} %: pixels are hardly ever that far from square, "
            "so the print is: compare its two rulers"
        )
    if scatter > SCATTER_DOUBTED:
        found.append(
            f"corners lie {scatter:.0f} times farther off than their own noise: the board is not flat, or the lens is not of this model; "
            "the errors stated are scaled for it"
        )
    return found


def where(lens: Lens, column: float, row: float) -> str:
    """A place in the image, in words."""
    across = "left" if column < lens.width / 3 else "right" if column > 2 * lens.width / 3 else ""
    down = "upper" if row < lens.height / 3 else "lower" if row > 2 * lens.height / 3 else ""
    if across and down:
        return f"{down} {across} corner"
    return f"{ {'upper': 'top', 'lower': 'bottom'}.get(down, down) or across or 'middle' }"


def _tilt_advice(tilts: Sequence[float]) -> str:
    most = max(tilts)
    if most < _FLAT:
        return (
            f"all boards face the camera within {math.degrees(most):.0f} degrees: add views with the board tilted by 20-45 degrees to the "
            "left, right, top and bottom"
        )
    least = math.degrees(min(tilts))
    return f"boards are tilted by {least:.0f}-{math.degrees(most):.0f} degrees: add views at 20-45 degrees, to all four sides, nearer"


def _empty(covered: Coverage) -> str:
    """Which of the image's outer parts have no corner."""
    seen = covered.count > 0
    parts = {"left": seen[:, :2], "right": seen[:, -2:], "top": seen[:2], "bottom": seen[-2:]}
    bare = [name for name, part in parts.items() if float(np.mean(part)) < 0.5]
    if len(bare) in {0, len(parts)}:
        return "all four corners of the image"
    return f"the {' and the '.join(bare)}"
