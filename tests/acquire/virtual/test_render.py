from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from acquire.virtual.coverage import Box, coverage
from acquire.virtual.layers import Layer, compose
from acquire.virtual.lens import Lens
from acquire.virtual.objects import OBJECT_NAMES, load_object
from acquire.virtual.render import MAX_SUBEXPOSURES, Renderer
from acquire.virtual.render_mesh import face_groups
from acquire.virtual.sensor import REFERENCE_EXPOSURE_US
from acquire.virtual.station import ARM_LENGTH_M, station
from schemas.tags import TagFamily

SEED = 3
STATION = station(SEED)
AXIS = np.array([-0.10, 0.0, 0.11 + ARM_LENGTH_M])


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def tipped(virtual_object, theta, k=1, span=0.0):
    """Poses of an object tipped by k angles around `theta` [rad], as `Renderer.render` takes them.

    The angles are spread over `span` [rad]. The axis is the world's y axis, on which the lower edge at +x of
    the standing object lies.

    Returns:
        Positions (k, 3) [m], quaternions (k, 4, w first), arm angles (k,) [rad] and arm axes (k, 3) [m].
    """
    p_rest = np.array(
        [-virtual_object.mesh_vertices[:, 0].max(), 0.0, -virtual_object.mesh_vertices[:, 2].min()]
    )
    angles = theta + span * ((np.arange(k) + 0.5) / k - 0.5)
    R = Rotation.from_rotvec(np.outer(angles, [0.0, 1.0, 0.0]))
    return R.apply(p_rest), R.as_quat()[:, [3, 0, 1, 2]], np.zeros(k), np.tile(AXIS, (k, 1))


def picture(renderer, poses, exposure_us=REFERENCE_EXPOSURE_US, gain_db=0.0):
    return renderer.render(*poses, exposure_us, gain_db)


def mean_picture(renderer, poses, frames=40):
    return np.mean([picture(renderer, poses) for _ in range(frames)], axis=0)


def square_px(virtual_object, marker_id, poses):
    """True corners (4, 2) [px] of a tag's black square in the first pose, in the detector's order."""
    marker = next(m for m in virtual_object.spec.marker if m.id == marker_id)
    h = marker.size_m / 2
    T = np.array(marker.T_object_marker)
    corners = np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]]) @ T[:3, :3].T + T[:3, 3]
    world = Rotation.from_quat(poses[1][0][[1, 2, 3, 0]]).apply(corners) + poses[0][0]
    return opencv_pixels(world)


def opencv_pixels(points_world):
    R = STATION.T_world_camera[:3, :3].T
    t = -R @ STATION.T_world_camera[:3, 3]
    return cv2.projectPoints(points_world, cv2.Rodrigues(R)[0], t, STATION.K, STATION.distortion)[0].reshape(
        -1, 2
    )


# --- filling


def test_coverage_is_the_exact_area_and_never_outside_zero_to_one():
    rng = np.random.default_rng(0)
    box = Box(10, 5, 80, 70)
    for _ in range(20):
        centre, angle = rng.uniform(35, 45, 2), rng.uniform(0, 7)
        corner = centre + rng.uniform(5, 20) * np.stack(
            [np.cos(angle + np.arange(3) * 2.1), np.sin(angle + np.arange(3) * 2.1)], axis=1
        )
        (found,) = coverage(corner, np.roll(corner, -1, axis=0), np.ones((1, 3)), box)
        x, y = corner.T
        assert found.sum() == pytest.approx(
            0.5 * abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))), abs=1e-3
        )
        assert found.min() > -1e-6
        assert found.max() < 1 + 1e-6


def test_edges_outside_the_box_change_nothing_inside():
    corner = np.array([[0.0, 0.0], [100.0, 3.0], [90.0, 100.0], [-20.0, 60.0]])
    edges = (corner, np.roll(corner, -1, axis=0), np.ones((1, 4)))
    small, large = Box(10, 5, 60, 50), Box(-30, -10, 110, 110)
    np.testing.assert_allclose(
        coverage(*edges, small)[0], coverage(*edges, large)[0][small.within(large)], atol=1e-6
    )


def test_pixel_centres_have_integer_coordinates():
    corner = np.array([[2.5, 1.5], [3.5, 1.5], [3.5, 2.5], [2.5, 2.5]])  # pixel (3, 2) exactly
    (found,) = coverage(corner, np.roll(corner, -1, axis=0), np.ones((1, 4)), Box(0, 0, 8, 6))
    expected = np.zeros((6, 8))
    expected[2, 3] = 1.0
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_two_layers_that_meet_at_an_edge_leave_no_seam_and_the_front_one_hides():
    box = Box(0, 0, 3, 1)
    front = Layer(box, np.array([[100.0, 30.0, 0.0]], np.float32), np.array([[1.0, 0.3, 0.0]], np.float32))
    back = Layer(box, np.array([[200.0, 140.0, 200.0]], np.float32), np.array([[1.0, 0.7, 1.0]], np.float32))
    found = compose([front, back])
    np.testing.assert_allclose(found.cover, 1.0, atol=1e-6)
    np.testing.assert_allclose(found.light, [[100.0, 170.0, 200.0]], rtol=1e-5)


def test_lens_is_opencvs():
    points = np.random.default_rng(1).uniform([-0.1, -0.05, 0.0], [0.15, 0.05, 0.18], (200, 3))
    np.testing.assert_allclose(Lens(STATION).pixels(points), opencv_pixels(points), atol=1e-8)


@pytest.mark.parametrize(("name", "groups"), [("carton", 1), ("salt", 1), ("juice", 2), ("spray", 2)])
def test_bottles_are_split_where_the_head_meets_the_shoulder(name, groups):
    shape = load_object(name, SEED)
    assert len(face_groups(shape.mesh_vertices, shape.mesh_faces)) == groups


# --- geometry of the picture


def test_tag_edges_lie_where_the_lens_puts_them():
    """Mean position of each side of the black square, from the grey levels alone: bias below 0.02 px."""
    carton, renderer = load_object("carton", SEED), Renderer(load_object("carton", SEED), STATION, SEED)
    poses = tipped(carton, 0.0)
    image = mean_picture(renderer, poses)
    corner = square_px(carton, 3, poses)
    for turned, (a, b) in ((image, (0, 3)), (image, (1, 2)), (image.T, (0, 1)), (image.T, (3, 2))):
        first, last = corner[[a, b]] if turned is image else corner[[a, b]][:, ::-1]
        errors = []
        for row in range(int(first[1]) + 8, int(last[1]) - 8):
            true = first[0] + (row - first[1]) / (last[1] - first[1]) * (last[0] - first[0])
            left = round(true) - 5
            line = turned[row, left : left + 11]  # one cell is 9.7 px wide
            low, high = line[:3].mean(), line[-3:].mean()
            # area under the step: how many of the 11 pixels lie left of the edge
            errors.append(left - 0.5 + np.sum((line - high) / (low - high)) - true)
        assert abs(np.mean(errors)) < 0.02


@pytest.mark.parametrize(("name", "family"), [("carton", "25h9"), ("carton", "4x4_100"), ("spray", "7x7_50")])
def test_tags_of_other_families_are_drawn_as_large_and_as_they_are(name, family):
    usual = load_object(name, SEED)
    markers = [marker.model_copy(update={"family": TagFamily(family)}) for marker in usual.spec.marker]
    shape = replace(usual, spec=usual.spec.model_copy(update={"marker": markers}))
    poses = tipped(shape, 0.2)
    image = picture(Renderer(shape, STATION, SEED), poses)
    facing = max(shape.spec.marker, key=lambda m: -np.array(m.T_object_marker)[1, 2])
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, TagFamily(family).opencv))
    )
    corners, ids, _ = detector.detectMarkers(image)
    assert facing.id in ids.ravel()
    found = corners[list(ids.ravel()).index(facing.id)].reshape(4, 2)
    np.testing.assert_allclose(found, square_px(shape, facing.id, poses), atol=1.0)


@pytest.mark.parametrize(
    ("name", "theta"), [("carton", 0.0), ("carton", 0.35), ("juice", 0.2), ("salt", 0.1), ("spray", 0.25)]
)
def test_the_detector_finds_the_pose_that_was_drawn(name, theta):
    shape = load_object(name, SEED)
    poses = tipped(shape, theta)
    image = picture(Renderer(shape, STATION, SEED), poses)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), parameters
    )
    corners, ids, _ = detector.detectMarkers(image)
    facing = max(shape.spec.marker, key=lambda m: -np.array(m.T_object_marker)[1, 2])
    assert ids is not None
    found = corners[list(ids.ravel()).index(facing.id)].reshape(4, 2)
    # cv2's corner finder pulls corners of a printed tag inwards by a few tenths of a pixel
    np.testing.assert_allclose(found, square_px(shape, facing.id, poses), atol=0.5)
    h = facing.size_m / 2
    model = np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0]])
    _, rotation, position = cv2.solvePnP(
        model, found, STATION.K, STATION.distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    T = np.array(facing.T_object_marker)
    R_object = Rotation.from_quat(poses[1][0][[1, 2, 3, 0]]).as_matrix()
    R_camera_world = STATION.T_world_camera[:3, :3].T
    expected = R_camera_world @ R_object @ T[:3, :3]
    turned = Rotation.from_matrix(expected.T @ cv2.Rodrigues(rotation)[0]).as_rotvec()
    assert abs(np.degrees(turned[2])) < 0.3  # along the camera's axis, the direction that matters
    assert np.degrees(np.linalg.norm(turned)) < 6.0
    where = R_camera_world @ (R_object @ T[:3, 3] + poses[0][0] - STATION.T_world_camera[:3, 3])
    np.testing.assert_allclose(
        position.ravel()[:2] / position[2, 0], where[:2] / where[2], atol=2e-4
    )  # 0.3 px
    assert position[2, 0] == pytest.approx(where[2], rel=0.02)


# --- time and light


def test_motion_blur_is_the_mean_of_the_poses():
    carton = load_object("carton", SEED)
    poses = tipped(carton, 0.3, k=3, span=0.02)
    renderer = Renderer(carton, STATION, SEED)
    blurred = mean_picture(renderer, poses, 30)
    singles = np.mean(
        [mean_picture(renderer, tuple(x[i : i + 1] for x in poses), 30) for i in range(3)], axis=0
    )
    assert np.abs(blurred - singles).mean() < 1.0
    assert np.abs(cv2.blur(blurred - singles, (5, 5))).max() < 6.0


def test_subexposures_grow_with_the_motion():
    carton = load_object("carton", SEED)
    renderer = Renderer(carton, STATION, SEED)
    assert renderer.subexposures_needed(*tipped(carton, 0.2, k=2, span=0.0)) == 1
    assert renderer.subexposures_needed(*tipped(carton, 0.2, k=2, span=0.006)) == 2
    assert renderer.subexposures_needed(*tipped(carton, 0.2, k=2, span=0.2)) == MAX_SUBEXPOSURES
    swing = tipped(carton, 0.0, k=2)
    assert (
        renderer.subexposures_needed(swing[0], swing[1], np.array([-0.1, 0.0]), swing[3]) == MAX_SUBEXPOSURES
    )


def test_earlier_drawings_leave_no_trace():
    salt = load_object("salt", SEED)
    one, other = (Renderer(salt, STATION, SEED) for _ in range(2))
    last = tipped(salt, 0.3)
    for theta in (0.0, 0.1, 0.9):
        picture(one, tipped(salt, theta, k=2, span=0.01))
        picture(other, last)
    np.testing.assert_array_equal(picture(one, last), picture(other, last))


def test_noise_is_new_in_each_frame_and_has_the_model_sd():
    carton = load_object("carton", SEED)
    poses = tipped(carton, 0.0)
    renderer = Renderer(carton, STATION, SEED)
    frames = np.array([picture(renderer, poses) for _ in range(60)], dtype=float)
    assert not np.array_equal(frames[0], frames[1])
    sd = frames.std(axis=0)
    assert 1.5 < np.percentile(sd, 5) < np.percentile(sd, 95) < 4.0
    assert (
        abs(
            np.corrcoef(
                frames[0].ravel() - frames.mean(0).ravel(), frames[1].ravel() - frames.mean(0).ravel()
            )[0, 1]
        )
        < 0.05
    )


def test_exposure_and_gain_scale_the_light_up_to_saturation():
    carton = load_object("carton", SEED)
    poses = tipped(carton, 0.0)
    renderer = Renderer(carton, STATION, SEED)
    normal = picture(renderer, poses, 1500.0).astype(float)
    dark = picture(renderer, poses, 750.0).astype(float)
    assert dark.mean() == pytest.approx(normal.mean() / 2, rel=0.02)
    gained = picture(renderer, poses, 750.0, 20 * np.log10(2.0))
    assert gained.mean() == pytest.approx(normal.mean(), rel=0.02)
    assert gained[20:60, 400:600].std() > normal[20:60, 400:600].std()
    assert np.mean(picture(renderer, poses, 6000.0) == 255) > 0.3


@pytest.mark.parametrize("name", OBJECT_NAMES)
def test_objects_at_and_beyond_the_border_are_drawn(name):
    shape = load_object(name, SEED)
    renderer = Renderer(shape, STATION, SEED)
    empty = None
    for shift in (0.0, 0.12, 0.18, 5.0):
        p, q, angle, axis = tipped(shape, 0.1)
        aside = np.array([shift, 0.0, 0.0])
        image = picture(renderer, (p + aside, q, angle, axis + aside))
        assert image.shape == (492, 656)
        assert image.dtype == np.uint8
        empty = image
    assert empty is not None
    assert cv2.GaussianBlur(empty, (9, 9), 2).min() > 40
