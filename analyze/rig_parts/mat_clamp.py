"""Clamp of the mat under the pivot line."""

from __future__ import annotations

from analyze.rig_parts.bought import M4
from analyze.rig_parts.solids import BEYOND, Dimension, RigPart, Solid, cone, cut, disc, rounded, slab

CLAMP_LENGTH, CLAMP_WIDTH, CLAMP_HEIGHT, CLAMP_SCREWS = 70.0, 16.0, 6.0, 54.0
"""Outer lengths of the mat's clamp, and distance of its screws [mm]."""
MAT_WIDTH, MAT_THICKNESS = 40.0, 0.6
"""Width and thickness of the strip of sandpaper that it holds [mm]."""


def mat_clamp() -> RigPart:
    """Bar that holds an end of the strip of sandpaper; its notch marks the pivot line."""
    half, wide, high = CLAMP_LENGTH / 2, CLAMP_WIDTH / 2, CLAMP_HEIGHT
    body = rounded(-half, half, -wide, wide, 0.0, high, 3.0)
    strip = MAT_WIDTH / 2
    holes = [slab(-strip, strip, -wide - BEYOND, wide + BEYOND, high - MAT_THICKNESS, high + BEYOND)]
    for x in (-CLAMP_SCREWS / 2, CLAMP_SCREWS / 2):
        holes += [disc(M4, -BEYOND, high + BEYOND, x), cone(9.0, M4, -0.01, 2.4, x)]
    notch = Solid.cube((3.0, 3.0, 2 * high), True).rotate((0.0, 0.0, 45.0)).translate((0.0, wide, high / 2))
    return RigPart(
        "mat-clamp",
        "clamp of the strip of sandpaper; its notch is the pivot line",
        cut(body, *holes, notch),
        (
            Dimension("top", (-half, -wide), (half, -wide), -14.0),
            Dimension("top", (-CLAMP_SCREWS / 2, -wide), (CLAMP_SCREWS / 2, -wide), -6.0),
            Dimension("top", (half, -wide), (half, wide), -8.0),
            Dimension("front", (half, 0.0), (half, high), -8.0),
            Dimension("front", (-strip, high), (strip, high), 8.0),
        ),
        "2 M4 countersunk screws into the table",
        count=2,
    )
