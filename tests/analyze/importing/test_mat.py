"""Imports of strikes on the mat: each strike's camera pose, bumps between and during strikes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analyze.calibration.mat_pose import camera_move, mat_pose, unposed_move
from analyze.calibration.mat_view import MatView
from analyze.cameras.camera_file import CameraFile
from analyze.importing.mat_cameras import SeenMat, mat_cameras
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.tip_view import TagView
from analyze.importing.write_recording import write_recording
from analyze.reading.recording import open_recording
from analyze.tags.mat import mat
from analyze.tracking.camera_model import project_ideal
from schemas.session_manifest import CameraCalibrationSpec
from tests.analyze.importing.mat_videos import PHONE, write_strikes
from tests.mat_views import Phone, looking

LENS = Phone(640, 360, 620.0).lens
AT = looking(np.array([0.03, -0.36, 0.19]), np.array([0.0, 0.0, 0.01]))
NAMES = ("s1.mp4", "s2.mp4", "s3.mp4", "s4.mp4")


def camera(placed=False):
    calibration = CameraCalibrationSpec(
        width=640,
        height=360,
        K=LENS.K.tolist(),
        distortion=[0.06, 0, 0, 0, 0],
        T_world_camera=np.eye(4).tolist(),
    )
    return CameraFile(Path("camera.toml"), calibration, placed)


def moved(millimetres):
    T = AT.copy()
    T[0, 3] += millimetres / 1000
    return T


def seen(T, name="s1.mp4", tags=12, after=None, seed=0):
    """The mat in one tip, by projected corners with noise of 0.04 px."""

    def view(pose, many):
        chosen = mat("A4").tags[:many]
        corners = project_ideal(
            LENS, (np.array([tag.corners for tag in chosen]) - pose[:3, 3]) @ pose[:3, :3]
        )
        corners += 0.04 * np.random.default_rng(seed).standard_normal(corners.shape)
        covariance = np.broadcast_to(0.04**2 * np.eye(2), (many, 4, 2, 2))
        return MatView(mat("A4"), chosen, corners, covariance)

    first = view(T, tags)
    if tags < 2:
        return SeenMat(name, first, None, None, "too few tags")
    pose = mat_pose(first, LENS)
    move = None if after is None else camera_move(pose, mat_pose(view(after, 12), LENS), LENS)
    return SeenMat(name, first, pose, move)


def test_bumped_strikes_have_their_own_pose_and_are_reported():
    tips = [
        seen(T, name, seed=n) for n, (T, name) in enumerate(zip([AT, AT, moved(3), AT], NAMES, strict=True))
    ]
    found = mat_cameras(tips, NAMES, camera(), LENS)
    assert found is not None
    assert found.views == 4
    assert found.own[0] is found.own[1] is found.own[3]
    assert np.linalg.norm(found.own[2][:3, 3] - moved(3)[:3, 3]) < 3e-4
    assert np.linalg.norm(found.T_world_camera[:3, 3] - AT[:3, 3]) < 3e-4
    [remark] = found.remarks
    assert remark.startswith("s3.mp4: the camera stood otherwise than in s1.mp4, by 3.")
    placed = found.placed(camera())
    assert placed.placed
    assert placed.calibration.T_world_camera == found.T_world_camera.tolist()


def test_views_of_a_bumped_camera_are_as_from_the_place_of_the_others():
    found = mat_cameras([seen(T) for T in (AT, AT, moved(8), AT)], NAMES, camera(), LENS)
    T_world_tag = np.eye(4)
    tags = [[TagView(0, np.linalg.inv(T) @ T_world_tag, None)] for T in (AT, AT, moved(8), AT)]
    for (view,) in found.as_from_one_place(tags):
        assert np.abs(found.T_world_camera @ view.T_camera_marker - T_world_tag).max() < 1e-3


def test_bump_during_a_strike_is_reported():
    tips = [seen(AT), seen(AT, "s2.mp4", after=moved(2)), seen(AT), seen(AT, after=AT)]
    [remark] = mat_cameras(tips, NAMES, camera(), LENS).remarks
    assert remark.startswith("s2.mp4: the camera was moved by 2.")
    assert "during the strike" in remark


def test_strikes_without_the_mat_or_with_too_little_of_it_are_named():
    found = mat_cameras(
        [seen(AT), None, seen(AT, "s3.mp4", tags=1), seen(moved(9), "s4.mp4", tags=1)], NAMES, camera(), LENS
    )
    none, little, bumped = found.remarks
    assert none.startswith("s2.mp4: no mat is seen")
    assert little.startswith("s3.mp4: the camera is taken to stand as in s1.mp4: too few tags")
    assert bumped.startswith("s4.mp4: the camera stood otherwise than in s1.mp4, by ")
    assert "its pose is not known: leave this strike out" in bumped
    assert found.own[1] is None
    assert found.own[2] is found.own[0]
    assert found.own[3] is None
    assert mat_cameras([None] * 4, NAMES, camera(), LENS) is None


def test_another_pose_in_the_camera_file_is_reported():
    [remark] = mat_cameras([seen(AT)], NAMES[:1], camera(placed=True), LENS).remarks
    assert "from its place in camera.toml (T_world_camera): the mat's is used" in remark


def test_shift_of_one_common_tag_shows_a_bump():
    one, other = (replace(seen(T).view) for T in (AT, moved(1)))
    assert unposed_move(one, other).moved


@pytest.mark.slow
def test_videos_on_the_mat_become_strikes_with_their_cameras(tmp_path):
    poses = write_strikes(tmp_path, [0, 3], {3: (0.004, 0.0, 0.002)})
    options = ImportOptions(
        tuple(tmp_path / f"{name}.mp4" for name in poses),
        PHONE / "teabox.toml",
        PHONE / "plan.json",
        tmp_path / "camera.toml",
    )
    with prepare(options) as prepared:
        assert prepared.place is None
        assert any("s4.mp4: the camera stood otherwise than in s1.mp4" in each for each in prepared.remarks())
        write_recording(prepared, tmp_path / "t.mcap")
    recording = open_recording(tmp_path / "t.mcap")
    for record in recording.strikes:
        T, true = np.array(record.T_world_camera).reshape(4, 4), poses[record.plan_strike_id]
        assert np.linalg.norm(T[:3, 3] - true[:3, 3]) < 3e-4
        assert np.degrees(np.arccos((np.trace(T[:3, :3].T @ true[:3, :3]) - 1) / 2)) < 0.05
