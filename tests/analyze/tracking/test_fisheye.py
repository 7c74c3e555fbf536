"""A fisheye lens: tags far from the middle of the image, and a tip, as well known as through a pinhole."""

import cv2
import numpy as np
import pytest

from analyze.motion.tip_angle import Placement, tip_angle
from analyze.tracking.camera_model import camera_from_spec, distort, pixel_map, undistort
from analyze.tracking.edges import fit_square
from analyze.tracking.marker import detect
from analyze.tracking.track import track_markers
from analyze.types import CameraModel, ImageFrame, Marker
from schemas.document import DocumentError, validate
from schemas.session_manifest import CameraCalibrationSpec, LensModel
from tests.analyze.tracking.rendering import corners_of, project, render

SIZE = 0.03
FACING = np.diag([1.0, -1.0, -1.0])
K = np.array([[300.0, 0, 330.5], [0, 301.0, 243.5], [0, 0, 1]])
BENT = np.array([0.06, -0.02, 0.004, -0.001])
R_WORLD_CAMERA = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])


@pytest.fixture(scope="module")
def lens():
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R_WORLD_CAMERA, [0.03, -0.12, 0.06]
    return CameraModel(656, 492, K, BENT, T, LensModel.FISHEYE)


def aside(angle, around):
    """Rotation that swings the optical axis by `angle` towards `around` in the image."""
    return cv2.Rodrigues(angle * np.array([-np.sin(around), np.cos(around), 0.0]))[0]


def test_distort_undoes_undistort_over_the_whole_image(lens):
    ideal = pixel_map(lens).ideal
    assert np.all(np.isfinite(ideal))
    columns, rows = np.meshgrid(np.arange(656.0), np.arange(492.0))
    assert np.abs(distort(lens, ideal) - np.stack([columns, rows], -1)).max() < 1e-8


def test_points_beyond_the_fisheye_range_have_no_ideal_pixel():
    wide = CameraModel(
        656,
        492,
        np.array([[180.0, 0, 328], [0, 180.0, 246], [0, 0, 1]]),
        np.zeros(4),
        np.eye(4),
        LensModel.FISHEYE,
    )
    corner, middle = undistort(wide, np.array([[0.0, 0.0], [328.0, 300.0]]))
    assert np.all(np.isnan(corner))
    assert middle == pytest.approx([328.0, 246 + 180 * np.tan(54 / 180)])


@pytest.mark.parametrize("off_axis_deg", [5, 25, 45])
def test_corners_are_unbiased_and_honest_off_the_axis(lens, off_axis_deg):
    rng, errors, sds = np.random.default_rng(off_axis_deg), [], []
    for _ in range(12):
        swing = aside(np.radians(off_axis_deg), rng.choice([0, np.pi]) + rng.uniform(-0.6, 0.6))
        R = (
            swing
            @ aside(rng.uniform(0, 0.15), rng.uniform(0, 7))
            @ cv2.Rodrigues(np.array([0, 0, rng.uniform(0, 6.3)]))[0]
            @ FACING
        )
        p = swing @ np.array([0, 0, 300.0 * SIZE / 80])
        image = render(lens, [(7, SIZE, R, p)], rng)
        (sighting,) = detect(image)
        square = fit_square(image, pixel_map(lens), undistort(lens, sighting.corners_px), sighting.corners_px)
        assert square is not None
        errors.append(square.corners - undistort(lens, project(lens, corners_of(SIZE) @ R.T + p)))
        sds.append(square.sd)
    # Off the axis an ideal pixel is a smaller part of a raw one, by up to 1 / cos^2: the same noise is more
    # of them.
    rms = np.sqrt(np.mean(np.square(errors)))
    assert rms < 0.018 / np.cos(np.radians(off_axis_deg)) ** 2
    assert 0.7 < rms / np.sqrt(np.mean(np.square(sds))) < 1.35


def test_a_tip_is_seen_through_it(lens):
    rng = np.random.default_rng(4)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), [-0.02, 0.0, 0.07]
    marker = Marker(7, SIZE, T)
    theta = np.concatenate([np.zeros(8), 0.03 * np.arange(1, 11)])
    frames = []
    for i, angle in enumerate(theta):
        turn = cv2.Rodrigues(np.array([0.0, angle, 0.0]))[0]
        R = R_WORLD_CAMERA.T @ turn @ T[:3, :3]
        p = R_WORLD_CAMERA.T @ (turn @ T[:3, 3] - lens.T_world_camera[:3, 3])
        frames.append(ImageFrame(i * 8_333_333, i, render(lens, [(7, SIZE, R, p)], rng)))
    report = track_markers(frames, lens, [marker])
    assert len(report.tracks[0].time_ns) == len(theta)
    placement = Placement(np.eye(3), np.zeros(3), np.zeros(3), 0.0)
    motion = tip_angle(report.tracks, [marker], lens, placement, 8 * 8_333_333)
    error = motion.angle.theta - theta
    assert np.degrees(np.sqrt(np.mean(error**2))) < 0.03
    assert np.sqrt(np.mean((error / np.hypot(motion.angle.sd, motion.angle.zero_sd)) ** 2)) < 2.0


def test_a_calibration_states_its_lens_model():
    data = {"width": 656, "height": 492, "K": K.tolist(), "T_world_camera": np.eye(4).tolist()}
    assert camera_from_spec(validate(CameraCalibrationSpec, data, "x")).model is LensModel.PINHOLE
    assert (
        camera_from_spec(
            validate(CameraCalibrationSpec, data | {"model": "fisheye", "distortion": BENT.tolist()}, "x")
        ).model
        is LensModel.FISHEYE
    )
    with pytest.raises(DocumentError, match="a fisheye has 4 coefficients k1, k2, k3, k4, not 5"):
        validate(CameraCalibrationSpec, data | {"model": "fisheye", "distortion": [0.1] * 5}, "x")
