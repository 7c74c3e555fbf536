"""Lens estimated from the corners of many views: its stated errors hold.

Views that do not determine the lens are refused, with the quantities that they leave open.
"""

import numpy as np
import pytest

from analyze.calibration.board import corner_points
from analyze.calibration.board_pose import weighted_corners
from analyze.calibration.calibrate import Shot, assess
from analyze.calibration.detect import View
from analyze.calibration.lens import plain_lens
from analyze.calibration.precision import pixel_sd
from analyze.calibration.solve import solve
from analyze.tags.sheet import Board
from schemas.session_manifest import LensModel
from tests.analyze.calibration.boards import TrueBoard, TrueLens, facing
from tests.analyze.calibration.compare import pixel_errors, truth

BOARD, PRINTED = Board("5x5_100", 7, 9, 22.0, 15.4), TrueBoard()
LENS = TrueLens(656, 492, 1430.0, 1431.0, 331.0, 242.0, (-0.12, 0.1, 3e-4, -2e-4, 0.02))
WIDE = TrueLens(656, 492, 300.0, 301.0, 331.0, 242.0, (0.05, -0.02, 0.003, -0.001), LensModel.FISHEYE)
CORNER_SD = 0.007


def all_over(rng, depth=0.6, many=15):
    """Arguments of `facing` for `many` boards tilted by 11 to 43 degrees, everywhere in the image."""
    return [
        (
            [rng.uniform(-0.13, 0.13) * depth, rng.uniform(-0.1, 0.1) * depth, depth],
            rng.uniform(0.2, 0.75),
            rng.uniform(0, 6.28),
            rng.uniform(0, 6.28),
        )
        for _ in range(many)
    ]


def seen(lens, views, rng, sd=CORNER_SD):
    """Corners of the board in `views`, with noise of 1 sigma `sd` [px] but without drawing images.

    Views with fewer than 8 corners in the image are left out.
    """
    shots = []
    for number, (middle, tilt, towards, spin) in enumerate(views):
        R, p = facing(PRINTED, middle, tilt, towards, spin)
        place = lens.project(PRINTED.corners() @ R.T + p)
        index = np.flatnonzero(((place > 8) & (place < [lens.width - 9, lens.height - 9])).all(axis=1))
        if len(index) < 8:
            continue
        noisy = place[index] + rng.normal(0, sd, (len(index), 2))
        view = View(
            index,
            noisy,
            np.tile(CORNER_SD**2 * np.eye(2), (len(index), 1, 1)),
            np.zeros((len(index), 2, 2)),
            0.7,
        )
        shots.append(Shot(f"{number}.png", np.zeros((lens.height, lens.width), np.uint8), view))
    return shots


def calibrated(lens, views, rng, sd=CORNER_SD):
    shots, points = seen(lens, views, rng, sd), corner_points(BOARD)
    views = [weighted_corners(shot.view, points) for shot in shots]
    bundle = solve(views, lens.model, lens.width, lens.height)
    return assess(shots, bundle, points, (), 0)


@pytest.mark.parametrize(("lens", "depth", "spread"), [(LENS, 0.6, 1.0), (WIDE, 0.13, 6.0)])
def test_the_sd_of_every_number_is_what_its_errors_are(lens, depth, spread):
    z = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        views = [([spread * x, spread * y, w], t, a, s) for ([x, y, w], t, a, s) in all_over(rng, depth)]
        found = calibrated(lens, views, rng)
        assert not found.undetermined
        assert 0.9 < found.scatter < 1.1
        z.append((found.lens.numbers - truth(lens)) / found.sd)
    # Numbers of one lens are correlated: 3 lenses of 9 numbers are some 10 independent ones.
    assert 0.35 < np.sqrt(np.mean(np.square(z))) < 1.6
    assert np.abs(z).max() < 4.5


def test_the_stated_error_of_pixels_holds_over_the_whole_image():
    rng = np.random.default_rng(5)
    found = calibrated(LENS, all_over(rng), rng)
    off = pixel_errors(found.lens, LENS)
    assert np.nanmax(off / found.pixels.value.ravel()) < 3.5
    assert found.pixels.worst < 0.1


def test_errors_beyond_the_corners_own_noise_widen_what_is_stated():
    quiet, loud = (
        calibrated(LENS, all_over(np.random.default_rng(6)), np.random.default_rng(6), sd)
        for sd in (CORNER_SD, 10 * CORNER_SD)
    )
    assert loud.scatter == pytest.approx(10.0, rel=0.1)
    assert loud.sd[0] / quiet.sd[0] == pytest.approx(10.0, rel=0.2)
    assert any("the board is not flat" in doubt for doubt in loud.doubts)


def test_boards_that_all_face_the_camera_do_not_determine_the_focal_length():
    rng = np.random.default_rng(7)
    found = calibrated(
        LENS,
        [(middle, 0.03 * rng.uniform(), towards, spin) for middle, _, towards, spin in all_over(rng)],
        rng,
    )
    (reason,) = found.undetermined
    assert "focal length" in reason
    assert "± " in reason
    assert "all boards face the camera within" in reason
    assert "tilted by 20-45 degrees" in reason
    # What it says of itself is true even so.
    assert abs(found.lens.numbers[0] - LENS.fx) < 4 * found.sd[0]


def test_views_of_the_middle_only_do_not_determine_the_corners():
    rng = np.random.default_rng(8)
    found = calibrated(
        LENS,
        [
            ([0.005, 0.0, 1.1], rng.uniform(0.4, 0.75), rng.uniform(0, 6.28), rng.uniform(0, 6.28))
            for _ in range(15)
        ],
        rng,
    )
    (reason,) = found.undetermined
    assert "distortion is not determined at the" in reason
    assert "corner of the image" in reason
    assert "add views in which the board reaches into all four corners" in reason
    assert found.covered.share < 0.5


def test_few_views_that_are_left_are_not_enough_however_well_they_fit():
    rng = np.random.default_rng(12)
    found = calibrated(LENS, all_over(rng, many=5), rng)
    assert any("only 5 views fit one lens, at least 6 are needed" in reason for reason in found.undetermined)


def test_bare_sides_of_the_image_are_named():
    rng = np.random.default_rng(9)
    views = [([-0.13 + 0.02 * rng.uniform(), y, 0.9], t, a, s) for ([_, y, _], t, a, s) in all_over(rng, 0.9)]
    found = calibrated(LENS, views, rng)
    assert found.pixels.worst_at[0] > 500
    assert any(
        "follows from its model only" in doubt and "reaches the right" in doubt for doubt in found.doubts
    )


def test_a_print_stretched_in_one_direction_is_suspected():
    rng = np.random.default_rng(10)
    stretched = TrueLens(656, 492, 1430.0, 1430.0 * 1.006, 331.0, 242.0, LENS.k)
    assert any(
        "compare its two rulers" in doubt for doubt in calibrated(stretched, all_over(rng), rng).doubts
    )


def test_a_camera_rotation_is_removed_from_the_pixel_sd():
    lens = plain_lens(LensModel.PINHOLE, 656, 492, 2000.0)
    only_middle = np.zeros((9, 9))
    only_middle[2, 2] = 1.0
    only_focal = np.zeros((9, 9))
    only_focal[:2, :2] = 1.0
    # A middle that is 1 px off is a turn by 1/2000, but for what perspective adds towards the borders.
    assert pixel_sd(lens, only_middle).worst < 0.05
    assert pixel_sd(lens, only_focal).worst == pytest.approx(np.hypot(327.5, 245.5) / 2000, rel=1e-3)


def test_strain_of_the_image_is_what_the_lens_errors_leave():
    lens = plain_lens(LensModel.PINHOLE, 656, 492, 2000.0)
    unequal = np.zeros((9, 9))
    unequal[:2, :2] = [[1.0, -1.0], [-1.0, 1.0]]
    assert pixel_sd(lens, unequal).strain_sd == pytest.approx(1e-3, rel=0.01)
    ratios = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        found = calibrated(LENS, all_over(rng, many=10), rng)
        off = found.lens.numbers - truth(LENS)
        ratios.append(pixel_sd(found.lens, np.outer(off, off)).strain_sd / found.pixels.strain_sd)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.5


def test_stretched_print_is_in_the_strain():
    rng = np.random.default_rng(8)
    stretched = TrueLens(656, 492, 1430.0, 1430.0 * 1.002, 331.0, 242.0, LENS.k)
    assert calibrated(stretched, all_over(rng), rng).strain_sd == pytest.approx(2e-3, rel=0.1)
