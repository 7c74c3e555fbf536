"""Tags of all families are found, distinguished, followed, and as accurate as the usual ones."""

import cv2
import numpy as np
import pytest

from analyze.errors import TrackingError
from analyze.motion.scene import read_scene
from analyze.tracking.camera_model import distort, pixel_map, undistort
from analyze.tracking.edges import fit_square
from analyze.tracking.marker import detect, families_of, is_marker, wrong_cells
from analyze.tracking.track import track_markers
from analyze.types import ImageFrame, Marker
from schemas.tags import TagFamily, family_and_id, marker_name
from tests.analyze.tracking.rendering import corners_of, project, render

SIZE = 0.03
FACING = np.diag([1.0, -1.0, -1.0])
FRAME_NS = 8_333_333
LEFT, RIGHT = np.array([-0.04, 0.0, 0.55]), np.array([0.04, 0.0, 0.55])


def video_frames(camera, rng, tags, count=3):
    return [
        ImageFrame(i * FRAME_NS, i, render(camera, [(n, SIZE, FACING, p) for n, p in tags], rng))
        for i in range(count)
    ]


@pytest.mark.parametrize("family", TagFamily)
def test_a_tag_of_any_family_is_read_and_known_by_its_code(camera, rng, family):
    name = marker_name(family, family.size - 1)
    (frame,) = video_frames(camera, rng, [(name, LEFT)], 1)
    (sighting,) = detect(frame.image, (family,))
    assert sighting.marker_id == name
    truth = project(camera, corners_of(SIZE) @ FACING.T + LEFT)
    square = fit_square(
        frame.image, pixel_map(camera), undistort(camera, sighting.corners_px), sighting.corners_px
    )
    assert np.abs(square.corners - undistort(camera, truth)).max() < 0.06
    assert is_marker(frame.image, truth, name)
    assert not is_marker(frame.image, truth, marker_name(family, 0))
    assert not is_marker(frame.image, np.roll(truth, 1, axis=0), name)


def test_cells_that_may_be_wrong_follow_from_the_codes():
    # Half the least distance of two codes, which for AprilTags is in their name.
    assert {f.value: wrong_cells(f) for f in TagFamily if "h" in f} == {
        "36h11": 6,
        "36h10": 5,
        "25h9": 5,
        "16h5": 3,
        "mip_36h12": 6,
    }
    assert wrong_cells(TagFamily.ARUCO_4X4_100) == 2


@pytest.mark.parametrize("px", [60, pytest.param(100, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "family",
    [TagFamily.APRILTAG_25H9, TagFamily.ARUCO_4X4_100, TagFamily.ARUCO_5X5_100, TagFamily.ARUCO_7X7_50],
)
def test_corners_are_as_good_as_the_usual_familys(camera, family, px):
    rng, errors, sds = np.random.default_rng(px), [], []
    depth = camera.K[0, 0] * SIZE / px
    for i in range(12):
        R = (
            cv2.Rodrigues(np.array([*rng.uniform(-0.1, 0.1, 2), 0]))[0]
            @ cv2.Rodrigues(np.array([0, 0, rng.uniform(0, 6.3)]))[0]
            @ FACING
        )
        p = np.array([rng.uniform(-0.1, 0.1) * depth, rng.uniform(-0.07, 0.07) * depth, depth])
        image = render(camera, [(marker_name(family, i), SIZE, R, p)], rng)
        (sighting,) = detect(image, (family,))
        square = fit_square(
            image, pixel_map(camera), undistort(camera, sighting.corners_px), sighting.corners_px
        )
        errors.append(square.corners - undistort(camera, project(camera, corners_of(SIZE) @ R.T + p)))
        sds.append(square.sd)
    rms = np.sqrt(np.mean(np.square(errors)))
    assert rms < 0.017
    assert 0.7 < rms / np.sqrt(np.mean(np.square(sds))) < 1.35


def test_one_number_in_two_families_is_two_markers(camera, rng):
    frames = video_frames(camera, rng, [(7, LEFT), ("25h9-7", RIGHT)])
    report = track_markers(frames, camera, [Marker("25h9-7", SIZE, None), Marker(7, SIZE, None)])
    assert {track.marker_id: np.sign(track.p_camera_marker[0, 0]) for track in report.tracks} == {
        7: -1,
        "25h9-7": 1,
    }
    assert all(len(track.time_ns) == 3 for track in report.tracks)
    assert [track.marker_id for track in track_markers(frames, camera, [Marker(7, SIZE, None)]).tracks] == [7]


def test_a_family_that_the_object_does_not_name_is_not_searched_for(camera, rng):
    frames = video_frames(camera, rng, [(7, LEFT), ("25h9-7", RIGHT)])
    assert track_markers(frames, camera, [Marker(7, SIZE, None)]).unknown_ids == ()
    assert set(read_scene(frames[0], camera).corners) == {7}
    assert set(read_scene(frames[0], camera, families_of([7, "25h9-3"])).corners) == {7, "25h9-7"}
    report = track_markers(frames, camera, [Marker("25h9-7", SIZE, None), Marker(3, SIZE, None)])
    assert report.unknown_ids == (7,)


@pytest.mark.parametrize("printed", [("36h11", 7), ("25h9", 7), ("4x4_50", 7), ("5x5_100", 7)])
def test_tags_of_another_family_than_the_file_says_are_named(camera, rng, printed):
    family, tag_id = printed
    frames = video_frames(camera, rng, [(marker_name(TagFamily(family), tag_id), LEFT)])
    with pytest.raises(
        TrackingError,
        match=f"marker 7 of {family} seems to be in view, the object carries 6x6_250-7: correct the",
    ):
        track_markers(frames, camera, [Marker("6x6_250-7", SIZE, None)])


def test_noise_is_no_marker_of_any_family(camera, rng):
    image = np.clip(rng.normal(120, 40, (camera.height, camera.width)), 0, 255).astype(np.uint8)
    frames = [ImageFrame(i * FRAME_NS, i, image) for i in range(3)]
    assert track_markers(frames, camera, [Marker("4x4_1000-1", SIZE, None)]).tracks == ()


def test_the_markers_of_a_charuco_board_are_tags_like_others(camera):
    """A board of 3 x 3 squares on the object: each white square holds a marker of 5x5_100, seen at 60 px."""
    board = cv2.aruco.CharucoBoard(
        (3, 3), 0.022, 0.0154, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    )
    fine, px_per_m = 8, 84 / 0.022
    drawn = board.generateImage(
        (int(0.066 * px_per_m * fine) + 160, int(0.066 * px_per_m * fine) + 160), None, 80
    )
    drawn = cv2.GaussianBlur(drawn.astype(np.float32), (0, 0), 0.7 * fine)
    small = cv2.resize(30 + drawn * 0.7, None, fx=1 / fine, fy=1 / fine, interpolation=cv2.INTER_AREA)
    rng, image = np.random.default_rng(1), np.full((camera.height, camera.width), 120.0)
    image[100 : 100 + len(small), 150 : 150 + len(small)] = small
    names = ["5x5_100-0", "5x5_100-1", "5x5_100-2", "5x5_100-3"]
    frames = [
        ImageFrame(i * FRAME_NS, i, np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8))
        for i in range(4)
    ]
    report = track_markers(frames, camera, [Marker(name, 0.0154, None) for name in names])
    assert [track.marker_id for track in report.tracks] == names
    for track in report.tracks:
        assert len(track.time_ns) == 4
        assert track.corner_sd_px.mean() < 0.03
        assert track.corners_px.std(axis=0).max() < 0.04
        assert family_and_id(track.marker_id)[0] is TagFamily.ARUCO_5X5_100
        edges = np.linalg.norm(track.corners_px - np.roll(track.corners_px, 1, axis=1), axis=2)
        assert edges == pytest.approx(0.0154 * px_per_m, abs=0.15)
        assert np.allclose(distort(camera, undistort(camera, track.corners_px)), track.corners_px, atol=1e-6)
