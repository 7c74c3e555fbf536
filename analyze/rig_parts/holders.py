"""Parts beside the striker: holder of a camera, and clamp of the mat under the pivot line."""

from __future__ import annotations

from analyze.rig_parts.solids import (
    BEYOND,
    Dimension,
    RigPart,
    Solid,
    bore_y,
    cone,
    cut,
    disc,
    rounded,
    slab,
    slot,
)

HOLDER_WIDTH, HOLDER_DEPTH, HOLDER_HEIGHT, PLATE = 56.0, 46.0, 64.0, 6.0
"""Outer lengths of the camera's holder, and thickness of its plates [mm]."""
TRIPOD = 6.8
"""Width of the slot for a tripod's screw (1/4 inch) [mm]."""
M6, M4 = 6.6, 4.5
"""Diameters of holes for screws [mm]."""
CLAMP_LENGTH, CLAMP_WIDTH, CLAMP_HEIGHT, CLAMP_SCREWS = 70.0, 16.0, 6.0, 54.0
"""Outer lengths of the mat's clamp, and distance of its screws [mm]."""
MAT_WIDTH, MAT_THICKNESS = 40.0, 0.6
"""Width and thickness of the strip of sandpaper that it holds [mm]."""


def camera_holder() -> RigPart:
    """Angle that holds a camera by its tripod thread, at a height that a slot sets, on two bolts."""
    half, deep, high, thick = HOLDER_WIDTH / 2, HOLDER_DEPTH, HOLDER_HEIGHT, PLATE
    base = rounded(-half, half, 0.0, deep, 0.0, thick, 4.0) + slab(-half, half, deep - 8.0, deep, 0.0, thick)
    corners = [bore_y(16.0, side * (half - 8.0), high - 8.0, deep - thick, deep) for side in (-1, 1)]
    upright = Solid.batch_hull([slab(-half, half, deep - thick, deep, 0.0, thick), *corners])
    gussets = [_gusset(side * (half - thick / 2) - thick / 2) for side in (-1, 1)]
    body = base + upright + gussets[0] + gussets[1]
    slots = [slot(M6, 10.0, -BEYOND, thick + BEYOND, x, 16.0) for x in (-13.0, 13.0)]
    screw = Solid.batch_hull(
        [bore_y(TRIPOD, 0.0, z, deep - thick - BEYOND, deep + BEYOND) for z in (26.0, high - 12.0)]
    )
    return RigPart(
        "camera-holder",
        "holder of a camera with a tripod thread",
        cut(body, *slots, screw),
        (
            Dimension("top", (-half, 0.0), (half, 0.0), -8.0),
            Dimension("top", (half, 0.0), (half, deep), -8.0),
            Dimension("top", (-13.0, 16.0), (13.0, 16.0), 30.0 + 8.0),
            Dimension("front", (half, 0.0), (half, high), -8.0),
            Dimension("front", (-half, 26.0), (-half, high - 12.0), 8.0),
            Dimension("front", (-half, 0.0), (-half, 26.0), 8.0),
        ),
        "1 tripod screw, 1/4 inch; 2 M6 into the post or the table",
    )


def _gusset(x: float) -> Solid:
    """Triangular rib between base and upright of the camera's holder, from x to x + PLATE [mm]."""
    inner = HOLDER_DEPTH - PLATE
    low = slab(x, x + PLATE, 4.0, inner + BEYOND, 0.0, PLATE)
    high = slab(x, x + PLATE, inner, inner + BEYOND, 0.0, HOLDER_HEIGHT - 16.0)
    return Solid.batch_hull([low, high])


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
