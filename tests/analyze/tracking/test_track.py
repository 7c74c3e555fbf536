"""Following tags through moving images; bad views are named."""

import time

import cv2
import numpy as np
import pytest

from analyze.errors import TrackingError
from analyze.tracking.camera_model import pixel_map
from analyze.tracking.pose import solve_pose
from analyze.tracking.track import MarkerFollower, track_markers
from analyze.types import CameraModel, ImageFrame, Marker
from tests.analyze.tracking.rendering import corners_of, project, render

SIZE = 0.03
FACING = np.diag([1.0, -1.0, -1.0])
FRAME_NS = 8_333_333
K = np.array([[1430.0, 0, 327.5], [0, 1430.0, 245.5], [0, 0, 1]])
LOOP = 60_000
"""turns of an empty loop that take 0.9 ms on the machine that takes 1.5 ms for a frame"""
CAMERA = CameraModel(656, 492, K, np.array([-0.12, 0.05, 3e-4, -2e-4, 0.0]), np.eye(4))


@pytest.fixture(scope="module")
def turning():
    """A tag that rests for ten frames and then turns about a point 60 mm away."""
    rng, frames, angle = np.random.default_rng(7), [], 0.0
    for i in range(26):
        angle += 0.03 if i >= 10 else 0.0
        turn = cv2.Rodrigues(np.array([0.0, 0.0, angle]))[0]
        pivot = np.array([0.02, 0.07, 0.55])
        p = pivot + turn @ (np.array([-0.02, 0.01, 0.55]) - pivot)
        frames.append(ImageFrame(i * FRAME_NS, i, render(CAMERA, [(7, SIZE, turn @ FACING, p)], rng)))
    return frames


def test_every_frame_of_a_tip_is_tracked_cheaply(camera, turning):
    pixel_map(camera)
    follower = MarkerFollower(camera, [Marker(7, SIZE, None)])
    costs, loops = [], []
    for frame in turning:
        start = time.thread_time()
        follower.add(frame)
        costs.append(time.thread_time() - start)
        start = time.thread_time()
        for _ in range(LOOP):
            pass
        loops.append(time.thread_time() - start)
    report = follower.report()
    (track,) = report.tracks
    assert len(track.time_ns) == 26
    assert track.corner_sd_px.mean() < 0.02
    # The target is 1.5 ms on a free machine. A busy one shares caches and cores: the same thread's empty
    # loops measure by how much.
    assert np.median(costs[1:]) < 4.0 * np.median(loops)


def test_pose_turns_with_the_tag_and_never_flips(camera, turning):
    (track,) = track_markers(turning, camera, [Marker(7, SIZE, None)], [7]).tracks
    relative = track.R_camera_marker @ track.R_camera_marker[0].T
    angle = np.arctan2(relative[:, 1, 0], relative[:, 0, 0])
    assert np.allclose(angle[10:], 0.03 * np.arange(1, 17), atol=np.radians(0.6))
    normals = track.R_camera_marker[:, :, 2]
    assert np.degrees(np.arccos(np.clip(normals @ [0, 0, -1.0], -1, 1))).max() < 8.0


def test_a_gap_is_stated_and_the_marker_found_again(camera, rng, turning):
    empty = render(camera, [], rng)
    frames = [ImageFrame(f.time_ns, f.sequence, empty) if 15 <= f.sequence < 19 else f for f in turning]
    report = track_markers(frames, camera, [Marker(7, SIZE, None)])
    assert report.unmarked_ns.tolist() == [i * FRAME_NS for i in range(15, 19)]
    assert len(report.tracks[0].time_ns) == 22
    assert report.frames_total == 26


def two(camera, rng, first, second):
    at = [np.array([-0.04, 0.0, 0.55]), np.array([0.04, 0.0, 0.55])]
    return [
        ImageFrame(
            i * FRAME_NS,
            i,
            render(camera, [(first, SIZE, FACING, at[0]), (second, SIZE, FACING, at[1])], rng),
        )
        for i in range(3)
    ]


def test_a_marker_seen_twice_is_refused(camera, rng):
    with pytest.raises(TrackingError, match="marker 7 is in view twice: cover or remove one"):
        track_markers(two(camera, rng, 7, 7), camera, [Marker(7, SIZE, None)])


def test_an_unknown_marker_beside_a_known_one_is_reported(camera, rng):
    report = track_markers(two(camera, rng, 7, 99), camera, [Marker(7, SIZE, None)])
    assert report.unknown_ids == (99,)
    assert len(report.tracks) == 1


def test_others_are_not_followed_once_the_expected_one_is_seen(camera, rng):
    markers = [Marker(7, SIZE, None), Marker(8, SIZE, None)]
    frames = two(camera, rng, 7, 8)
    assert [track.marker_id for track in track_markers(frames, camera, markers, [7]).tracks] == [7]
    assert [track.marker_id for track in track_markers(frames, camera, markers, [9]).tracks] == [7, 8]
    assert track_markers(frames, camera, markers, [7]).unknown_ids == ()


def test_only_unknown_markers_are_refused(camera, rng):
    with pytest.raises(TrackingError, match="marker 98 is in view, but the object carries 7"):
        track_markers(two(camera, rng, 98, 99), camera, [Marker(7, SIZE, None)])


def test_an_image_of_another_size_is_refused(camera, rng):
    with pytest.raises(TrackingError, match="640 x 480 px, the calibration 656 x 492"):
        track_markers([ImageFrame(0, 0, np.zeros((480, 640), np.uint8))], camera, [Marker(7, SIZE, None)])


def test_both_poses_of_a_square_come_back_better_one_first(camera):
    R = cv2.Rodrigues(np.array([0.35, 0.1, 0.2]))[0] @ FACING
    p = np.array([0.02, -0.01, 0.5])
    points = corners_of(SIZE) @ R.T + p
    ideal = (points @ camera.K.T)[:, :2] / points[:, 2:]
    pair = solve_pose(ideal, SIZE, camera.K)
    assert pair is not None
    assert pair.error_px[0] < 1e-3 <= pair.error_px[1]
    assert np.allclose(pair.R_camera_marker[0], R, atol=1e-4)
    assert np.allclose(pair.p_camera_marker[0], p, atol=1e-5)
    assert project(camera, points).shape == (4, 2)
