"""A lens that was found beside the true one."""

from __future__ import annotations

import numpy as np

from analyze.calibration.lens import project
from analyze.calibration.precision import grid, without_turn
from analyze.tracking.camera_model import undistort


def truth(lens):
    """The numbers of a TrueLens as analyze.calibration.lens has them."""
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.k])


def pixel_errors(found, lens):
    """Distance (n,) px, over the image's grid, of the pixel that each direction falls on from where it should
    be, the best turn taken out.

    Args:
        found: Lens.
        lens: TrueLens.
    """
    _, _, points = grid(found)
    rays = (undistort(found.camera(), points) - found.numbers[2:4]) / found.numbers[:2]
    directions = np.column_stack([rays, np.ones(len(rays))])
    _, by_pose, _ = project(found, directions, np.zeros(3), np.zeros(3))
    moves = (lens.project(directions) - points).reshape(-1, 1)
    return np.linalg.norm(without_turn(moves, by_pose[..., :3].reshape(-1, 3)).reshape(-1, 2), axis=1)
