"""Corners against an independent renderer: no half-pixel bias, little noise, honest sd.

The angle of a frame meets the method's target.
"""

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from analyze.tracking.camera_model import distort, pixel_map, undistort
from analyze.tracking.edges import fit_square
from analyze.tracking.marker import detect
from tests.analyze.tracking.rendering import corners_of, project, render

SIZE = 0.03
FACING = np.diag([1.0, -1.0, -1.0])


SEEDS = (1, 2, 7)


@dataclass(frozen=True)
class Errors:
    """Errors of tags' corners and angles in rendered images, with the reported sd."""

    corners: np.ndarray
    """(n, 4, 2) errors of the corners [px]"""
    sd: np.ndarray
    """(n,) reported sd of the corners [px]"""
    angle: np.ndarray
    """(n,) errors of the angle in the image [rad]"""

    @property
    def rms(self):
        return np.sqrt(np.mean(self.corners**2))

    @property
    def rms_over_sd(self):
        return self.rms / np.sqrt(np.mean(self.sd**2))


def views(camera, px, count, rng, turned_deg=(0, 360), develop=lambda image: image, **look):
    """Errors of corners and angles of `count` tags in rendered images, `px` wide, with the reported sd.

    The tags are at random places, tilted by up to 8 deg, and turned in the image by an angle drawn from the
    range `turned_deg` [deg]. `develop` is applied to each image; `look` has the fields of `Look`.
    """
    errors, sds, angles = [], [], []
    depth = camera.K[0, 0] * SIZE / px
    for _ in range(count):
        tilt, towards = np.radians(rng.uniform(0, 8)), rng.uniform(0, 2 * np.pi)
        R = cv2.Rodrigues(tilt * np.array([np.cos(towards), np.sin(towards), 0.0]))[0]
        R = R @ cv2.Rodrigues(np.array([0.0, 0.0, np.radians(rng.uniform(*turned_deg))]))[0] @ FACING
        p = np.array([rng.uniform(-0.14, 0.14) * depth, rng.uniform(-0.09, 0.09) * depth, depth])
        image = develop(render(camera, [(7, SIZE, R, p)], rng, **look))
        truth = undistort(camera, project(camera, corners_of(SIZE) @ R.T + p))
        (sighting,) = detect(image)
        square = fit_square(
            image, pixel_map(camera), undistort(camera, sighting.corners_px), sighting.corners_px
        )
        assert square is not None
        errors.append(square.corners - truth)
        sds.append(square.sd)
        a, b = ((q - q.mean(0)) @ np.array([1, 1j]) for q in (truth, square.corners))
        angles.append(np.angle(np.vdot(a, b)))
    return Errors(np.array(errors), np.array(sds), np.array(angles))


# Measured over 8 seeds of 60 views: rms over sd 0.94-0.96; of single seeds 0.88-1.02. 25 views have 200
# independent numbers and scatter by 5 %: the limits are four of these sigmas below what is measured, and
# seven above.
@pytest.mark.parametrize(
    "seed", [SEEDS[0], *(pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS[1:])]
)
@pytest.mark.parametrize(
    ("px", "corner_rms_px", "angle_deg"),
    [
        (40, 0.02, 0.025),
        *(pytest.param(*each, marks=pytest.mark.slow) for each in ((60, 0.016, 0.014), (80, 0.014, 0.009))),
        (120, 0.011, 0.005),
    ],
)
def test_corners_are_unbiased_precise_and_honest(camera, px, corner_rms_px, angle_deg, seed):
    errors = views(camera, px, 25, np.random.default_rng(seed))
    assert errors.rms < corner_rms_px
    assert np.all(np.abs(errors.corners.mean((0, 1))) < 0.006), "half-pixel bias"
    assert 0.75 < errors.rms_over_sd < 1.3, "the sd must be what the corners show"
    assert np.degrees(np.std(errors.angle)) < angle_deg


@pytest.mark.parametrize(
    "look",
    [
        {"white": 110, "black": 60, "background": 80, "blur": 1.2},
        pytest.param({"blur": 2.0}, marks=pytest.mark.slow),
        {"noise": 1.0},
    ],
)
def test_the_sd_is_honest_for_other_looks_too(camera, rng, look):
    assert 0.75 < views(camera, 80, 30, rng, **look).rms_over_sd < 1.3


def test_edges_along_the_pixel_grid_are_as_good_as_others(camera, rng):
    errors = views(camera, 80, 30, rng, turned_deg=(-3, 3))
    assert errors.rms < 0.014
    assert 0.75 < errors.rms_over_sd < 1.3


# Fitted with pixels as points: along the pixel grid 0.09 px off, seven times the sd. Measured here: 0.006 to
# 0.008 px, 0.95 to 1.02.
@pytest.mark.parametrize(("blur", "turned_deg"), [(0.02, (0, 0)), (0.3, (0, 360))])
def test_sharper_edges_than_a_lens_makes_are_as_good(camera, rng, blur, turned_deg):
    errors = views(camera, 80, 25, rng, turned_deg, blur=blur)
    assert errors.rms < 0.01
    assert 0.75 < errors.rms_over_sd < 1.3


def sharpened(image, amount):
    grey = image.astype(float)
    return np.clip(np.rint(grey + amount * (grey - cv2.GaussianBlur(grey, (0, 0), 1.0))), 0, 255).astype(
        np.uint8
    )


def test_edges_that_a_phone_sharpened_are_found(camera, rng):
    """Corners of an image with unsharp masking, twice the difference to a blur of 1 px, are found.

    The step then overshoots by a third of its height on either side.
    """
    errors = views(
        camera, 80, 15, rng, develop=lambda image: sharpened(image, 2.0), white=160, black=80, blur=0.5
    )
    assert errors.rms < 0.05
    assert errors.rms_over_sd < 1.3


def test_without_noise_corners_are_exact(camera, rng):
    assert views(camera, 80, 15, rng, noise=0.0).rms < 0.002


def test_no_square_is_fitted_to_flat_grey(camera, rng):
    image = np.clip(rng.normal(120, 4, (camera.height, camera.width)), 0, 255).astype(np.uint8)
    corners = np.array([[200.0, 200], [280, 200], [280, 280], [200, 280]])
    assert fit_square(image, pixel_map(camera), corners, corners) is None


def test_no_square_at_the_border(camera, rng):
    image = render(camera, [(7, SIZE, FACING, np.array([0.0, 0.0, 0.55]))], rng)
    corners = np.array([[-30.0, 200], [50, 200], [50, 280], [-30, 280]])
    assert fit_square(image, pixel_map(camera), corners, corners) is None


def test_a_tag_seen_from_the_side_at_the_lower_border(camera, rng):
    """The tag's upright edges are short and its level ones long; all pixels used must lie in the image."""
    image = np.full((camera.height, camera.width), 180, dtype=np.uint8)
    bottom = camera.height - 12
    image[bottom - 14 : bottom, 200:300] = 30
    raw = np.array(
        [[199.5, bottom - 14.5], [299.5, bottom - 14.5], [299.5, bottom - 0.5], [199.5, bottom - 0.5]]
    )
    found = fit_square(image, pixel_map(camera), undistort(camera, raw), raw)
    assert found is None or np.abs(distort(camera, found.corners) - raw).max() < 1.0


def test_undistort_and_distort_are_inverse(camera, rng):
    points = rng.uniform([0, 0], [655, 491], (50, 2))
    assert np.allclose(distort(camera, undistort(camera, points)), points, atol=1e-6)
