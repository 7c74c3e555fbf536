"""Comparison of an estimated lens with the true one."""

from __future__ import annotations

import numpy as np

from analyze.calibration.lens import project
from analyze.calibration.precision import grid, without_turn
from analyze.tracking.camera_model import undistort


def truth(lens):
    """Numbers (p,) of a TrueLens in the order of analyze.calibration.lens: fx, fy, cx, cy, distortion."""
    return np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.k])


def pixel_errors(found, lens):
    """Distances (n,) [px] between the pixels on which a direction falls by both lenses, over a grid.

    The best rotation of the camera is removed.

    Args:
        found: estimated Lens.
        lens: TrueLens.
    """
    _, _, points = grid(found)
    rays = (undistort(found.camera(), points) - found.numbers[2:4]) / found.numbers[:2]
    directions = np.column_stack([rays, np.ones(len(rays))])
    _, by_pose, _ = project(found, directions, np.zeros(3), np.zeros(3))
    moves = (lens.project(directions) - points).reshape(-1, 1)
    return np.linalg.norm(without_turn(moves, by_pose[..., :3].reshape(-1, 3)).reshape(-1, 2), axis=1)
