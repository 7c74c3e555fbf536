"""Makes the picture of the rig's printable parts: `python docs/rig_parts_picture.py PICTURE.png`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from fixture_picture import FIXTURE, Part, view

if TYPE_CHECKING:
    from analyze.rig_parts.assembly import Placed

RUBBER, SANDPAPER, ARM, METAL = (0.80, 0.36, 0.30), (0.80, 0.72, 0.55), (0.93, 0.70, 0.38), (0.72, 0.74, 0.76)
"""colours, red, green, blue"""
APART = {
    "horn-": 26.0,
    "servo": 52.0,
    "servo-": 78.0,
    "bearing-hub": 34.0,
    "washer, near": -26.0,
    "axle": -44.0,
    "spacer-short": -14.0,
    "bearing, near": 12.0,
    "spacer-long": 48.0,
    "bearing, far": 58.0,
    "spacer-short, second": 70.0,
    "axle-plate": 84.0,
    "washer, far": 104.0,
    "nut": 114.0,
    "ballast, near": -18.0,
    "ballast's nut": -30.0,
    "ballast, far": 18.0,
    "ballast's bolt": 30.0,
}
"""shift along the hinge of parts that are drawn apart [mm], by the name or its beginning"""
POST = (-150.0, 70.0)
"""heights between which the post is drawn [mm]"""


def main() -> int:
    """Draw the strikers, one taken apart, and the smaller parts; return 2 on wrong usage, else 0."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python docs/rig_parts_picture.py PICTURE.png\n")
        return 2
    from analyze.rig_parts import bought
    from analyze.rig_parts.all_parts import rig_prints
    from analyze.rig_parts.assembly import pendulum, servo_striker, solenoid_striker
    from analyze.rig_parts.solids import printed_surface, slab

    prints = rig_prints(0.12)
    meshes = {each.part.name: each.part.mesh for each in prints.parts}
    heavy, light = prints.ballast(0.17), prints.ballast(0.09)
    servo = servo_striker(bought.SERVOS[0], 120.0, light)
    views = [
        view([*_drawn(servo, 0.0, apart=False)], 35.0, 18.0),
        view([*_drawn(servo, 0.0, apart=True)], 35.0, 18.0),
        view([*_drawn(pendulum(120.0, heavy), 0.0, apart=True)], 35.0, 18.0),
        view([*_drawn(solenoid_striker(120.0, heavy), -0.27, apart=False)], -35.0, 22.0),
    ]
    strip = printed_surface(slab(-20.0, 20.0, -90.0, 14.0, 0.0, 0.6))
    clamp = meshes["mat-clamp"].vertices @ np.diag([1.0, -1.0, -1.0]) + np.array([0.0, 0.0, 7.0])
    post = printed_surface(bought.profile(110.0).translate((0.0, 62.0, -30.0)))
    bar = bought.profile(120.0).rotate((0.0, 90.0, 0.0)).translate((-60.0, 10.0, -10.0))
    lamp = meshes["lamp-holder"]
    camera = meshes["camera-holder"]
    views += [
        view([(camera.vertices, camera.faces, FIXTURE), (post.vertices, post.faces, METAL)], -35.0, 30.0),
        np.vstack(
            [
                _half(view([(lamp.vertices, lamp.faces, FIXTURE), _metal(bar)], -35.0, 30.0)),
                _half(
                    view(
                        [
                            (strip.vertices, strip.faces, SANDPAPER),
                            (clamp, meshes["mat-clamp"].faces, FIXTURE),
                        ],
                        28.0,
                        34.0,
                    )
                ),
            ]
        ),
    ]
    rows = [np.hstack(views[:3]), np.hstack(views[3:])]
    cv2.imwrite(sys.argv[1], np.vstack(rows), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


def _half(image: np.ndarray) -> np.ndarray:
    """Image of half the height, with white at its sides."""
    high, wide = image.shape[:2]
    small = cv2.resize(image, (wide // 2, high // 2), interpolation=cv2.INTER_AREA)
    return cv2.copyMakeBorder(small, 0, 0, wide // 4, wide // 4, cv2.BORDER_CONSTANT, value=(255, 255, 255))


def _metal(solid: object) -> Part:
    from analyze.rig_parts.solids import printed_surface

    mesh = printed_surface(solid)  # pyright: ignore[reportArgumentType]
    return mesh.vertices, mesh.faces, METAL


def _drawn(parts: list[Placed], angle: float, *, apart: bool) -> list[Part]:
    """Surfaces and colours of a rig, in place or drawn apart along the hinge.

    Args:
        parts: the parts.
        angle: angle of the arm [rad].
        apart: whether they are drawn apart; the post is then left out.
    """
    from analyze.rig_parts.solids import printed_surface, slab

    shown: list[Part] = []
    seen: set[str] = set()
    for each in parts:
        solid = each.at(angle)
        if each.name == "post":
            if apart:
                continue
            solid = solid ^ slab(-500.0, 500.0, -500.0, 500.0, *POST)
        name = f"{each.name}, second" if each.name in seen else each.name
        seen.add(name)
        if apart:
            shift = max(
                ((key, far) for key, far in APART.items() if name == key or (key[-1] == "-" and key in name)),
                key=lambda found: len(found[0]),
                default=("", 0.0),
            )[1]
            solid = solid.translate((0.0, shift, 0.0))
        mesh = printed_surface(solid)
        colour = ARM if each.name == "arm" else FIXTURE if each.printed else METAL
        shown.append((mesh.vertices, mesh.faces, RUBBER if each.name in ("pad", "rest") else colour))
    return shown


if __name__ == "__main__":
    sys.exit(main())
