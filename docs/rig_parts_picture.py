"""Makes the picture of the rig's printable parts: `python docs/rig_parts_picture.py PICTURE.png`."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from fixture_picture import FIXTURE, view

FELT, SANDPAPER, HUB = (0.80, 0.36, 0.30), (0.80, 0.72, 0.55), (0.93, 0.70, 0.38)
"""colours, red, green, blue"""


def main() -> int:
    """Draw the striker taken apart, then camera holder and mat clamp; return 2 on wrong usage, else 0."""
    if len(sys.argv) != 2:
        sys.stderr.write("usage: python docs/rig_parts_picture.py PICTURE.png\n")
        return 2
    from analyze.fixture.solid import Mesh
    from analyze.rig_parts.all_parts import rig_prints
    from analyze.rig_parts.solids import disc, slab
    from analyze.rig_parts.solids import printed_surface as surface

    meshes = {each.part.name: each.part.mesh for each in rig_prints(0.12).parts}

    def placed(mesh: Mesh, turn: np.ndarray, shift: tuple[float, float, float], colour=FIXTURE):
        return mesh.vertices @ turn.T + np.array(shift), mesh.faces, colour

    flat = np.eye(3)
    to_y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # z of the part is y of the arm
    upside_down = np.diag([1.0, -1.0, -1.0])
    felt, strip = surface(disc(13.0, 13.0, 16.0)), surface(slab(-20.0, 20.0, -90.0, 14.0, 0.0, 0.6))
    striker = [
        placed(meshes["arm"], flat, (0.0, 0.0, 0.0)),
        placed(meshes["horn-xm430"], flat, (0.0, 0.0, -34.0), HUB),
        placed(meshes["bearing-hub"], flat, (0.0, 0.0, 36.0), HUB),
        placed(meshes["pad"], to_y, (120.0, 24.0, 6.0), HUB),
        placed(felt, to_y, (120.0, 30.0, 6.0), FELT),
    ]
    clamp = [placed(strip, flat, (0.0, 0.0, 0.0), SANDPAPER)]
    clamp.append(placed(meshes["mat-clamp"], upside_down, (0.0, 0.0, 7.0)))
    views = [
        view(striker, 160.0, 24.0),
        view([placed(meshes["camera-holder"], flat, (0.0, 0.0, 0.0))], -35.0, 30.0),
        view(clamp, 28.0, 34.0),
    ]
    cv2.imwrite(sys.argv[1], np.hstack(views), [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return 0


if __name__ == "__main__":
    sys.exit(main())
