"""Corners of chess squares compared with rendered boards: no bias, little noise, correct sd.

Lines that the lens bends are straightened.
"""

import numpy as np
import pytest

from analyze.calibration.board import corner_points
from analyze.calibration.board_pose import Pose
from analyze.calibration.detect import find_corners, likely_squares, read_board
from analyze.calibration.lens import Lens
from analyze.calibration.straight import refit
from analyze.tags.sheet import Board
from schemas.session_manifest import LensModel
from tests.analyze.calibration.boards import TrueBoard, TrueLens, facing, photograph
from tests.analyze.tracking.rendering import Look

BOARD, PRINTED = Board("5x5_100", 5, 7, 22.0, 15.4), TrueBoard(5, 7)
LENS = TrueLens(400, 300, 715.0, 717.0, 203.0, 148.0, (-0.12, 0.1, 3e-4, -2e-4, 0.0))


def errors(lens, pose, look_of, rng):
    """Errors (n, 2) px and covariances (n, 2, 2) px^2 of all corners of one view."""
    R, p = pose
    image = photograph(lens, PRINTED, R, p, rng, look_of)
    view = find_corners(image, BOARD, read_board(image, BOARD))
    assert view is not None
    return view.place - lens.project(PRINTED.corners() @ R.T + p)[view.index], view.covariance


def test_corners_are_counted_as_printed():
    assert np.allclose(corner_points(BOARD), PRINTED.corners())


@pytest.mark.parametrize(("distance", "tilt", "spin"), [(0.4, 0.0, 0.0), (0.4, 0.6, 0.3), (0.5, 0.3, 1.2)])
def test_without_noise_corners_are_exact_however_the_board_is_turned(distance, tilt, spin):
    straight = TrueLens(400, 300, 715.0, 715.0, 203.0, 148.0, (0.0,) * 5)
    error, _ = errors(
        straight,
        facing(PRINTED, [0, 0, distance], tilt, 0.8, spin),
        Look(noise=0.0),
        np.random.default_rng(1),
    )
    assert len(error) == 24
    assert np.abs(error).max() < 0.006
    assert np.abs(error.mean(axis=0)).max() < 0.001, "bias"


def test_corners_are_unbiased_precise_and_honest_under_noise():
    rng, found, covariances = np.random.default_rng(2), [], []
    for tilt in (0.1, 0.4, 0.6):
        pose = facing(
            PRINTED, [rng.uniform(-0.02, 0.02), 0.01, 0.38], tilt, rng.uniform(0, 6), rng.uniform(0, 6)
        )
        error, covariance = errors(LENS, pose, Look(), rng)
        found.append(error)
        covariances.append(covariance)
    error, covariance = np.concatenate(found), np.concatenate(covariances)
    chi2 = np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error)
    # 72 corners have 144 independent numbers: chi^2 / 2 scatters by 12 %.
    assert np.sqrt(np.mean(error**2)) < 0.011
    assert np.abs(error.mean(axis=0)).max() < 0.004
    assert 0.7 < chi2.mean() / 2 < 1.6


def test_a_fisheye_bends_lines_and_moves_corners_until_they_are_straightened():
    lens = TrueLens(400, 300, 150.0, 150.0, 199.5, 149.5, (0.05, -0.02, 0.003, -0.001), LensModel.FISHEYE)
    R, p = facing(PRINTED, [0.075, 0.0, 0.08], 0.2, 0.8, 0.3)
    image = photograph(lens, PRINTED, R, p, np.random.default_rng(3), Look(noise=0.0), pieces=3)
    view = find_corners(image, BOARD, read_board(image, BOARD))
    true = lens.project(PRINTED.corners() @ R.T + p)
    known = Lens(LensModel.FISHEYE, 400, 300, np.array([150.0, 150.0, 199.5, 149.5, *lens.k]))
    turned = np.linalg.svd(R - np.eye(3))[2][
        -1
    ]  # the axis of a half turn and a bit: any rotation vector of R will do
    angle = np.arccos(0.5 * (np.trace(R) - 1))
    axis = turned * np.sign(turned @ np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]))
    better = refit(image, BOARD, view, PRINTED.corners(), known, Pose(angle * axis, p))
    raw, straightened = (np.abs(each.place - true[each.index]).max() for each in (view, better))
    assert straightened < 0.01 < raw


def test_the_layout_of_another_board_is_named():
    R, p = facing(PRINTED, [0, 0, 0.4], 0.3, 0.5, 0.2)
    image = photograph(LENS, PRINTED, R, p, np.random.default_rng(4))
    wrong = read_board(image, Board("5x5_100", 7, 9, 22.0, 15.4))
    assert wrong.another_layout
    assert not read_board(image, BOARD).another_layout
    assert likely_squares([wrong.read], BOARD) == (5, 7)
