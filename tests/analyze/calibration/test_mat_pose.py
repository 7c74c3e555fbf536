"""Camera poses by the mat: rendered and computed views, bumps, covariance, refusals."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analyze.calibration.mat_pose import camera_move, mat_pose, read_mat, unposed_move
from analyze.calibration.mat_view import MatView, mean_view
from analyze.errors import CalibrationError
from analyze.tags.mat import mat
from analyze.tracking.camera_model import project_ideal
from tests.mat_views import Phone, Scene, bumped, half_hidden, looking, picture

PHONE = Phone(640, 360, 620.0)
PLACE = looking(np.array([0.03, -0.36, 0.19]), np.array([0.0, 0.0, 0.01]), 0.02)
NOISE_PX = 0.04


def errors(pose, T):
    turn = Rotation.from_matrix(pose.T_world_camera[:3, :3] @ T[:3, :3].T).as_rotvec()
    return np.concatenate([turn, pose.T_world_camera[:3, 3] - T[:3, 3]])


@cache
def seen_from(bump_m=0.0, turn=0.0, hidden=0.0):
    random = np.random.default_rng(3)
    T = bumped(PLACE, random, bump_m, turn)
    scene = Scene(box=((-0.07, -0.03, 0.0), (0.0, 0.03, 0.06)))
    view = read_mat(picture(PHONE, T, half_hidden(scene, PHONE, T, random, hidden), random), PHONE.lens)
    assert view is not None
    return view


def computed(random, T=PLACE, paper="A4", tags=None, heights=0.0, noise=NOISE_PX):
    """A view without an image: projected corners with noise, of paper with random heights [m]."""
    layout = mat(paper)
    chosen = layout.tags if tags is None else tuple(layout.tags[number] for number in tags)
    points = np.array([tag.corners for tag in chosen])
    points[..., 2] += heights * random.standard_normal((len(chosen), 1))
    corners = project_ideal(PHONE.lens, (points - T[:3, 3]) @ T[:3, :3])
    corners += noise * random.standard_normal(corners.shape)
    return MatView(layout, chosen, corners, np.broadcast_to(noise**2 * np.eye(2), (len(chosen), 4, 2, 2)))


def test_rendered_mat_shows_the_cameras_pose():
    pose = mat_pose(seen_from(), PHONE.lens)
    error = errors(pose, PLACE)
    assert np.linalg.norm(error[:3]) < np.radians(0.05)
    assert np.linalg.norm(error[3:]) < 3e-4
    assert np.all(np.abs(error) < 3 * np.sqrt(np.diag(pose.covariance)))


def test_half_of_the_tags_suffices_and_a_small_bump_is_found():
    before, after = (mat_pose(seen_from(*each), PHONE.lens) for each in ((), (0.001, 0.0, 0.45)))
    assert len(after.view.tags) < len(before.view.tags)
    move = camera_move(before, after, PHONE.lens)
    assert move is not None
    assert move.moved
    assert move.distance == pytest.approx(0.001, abs=4e-4)
    assert unposed_move(before.view, after.view).pixels > 0.4


def test_still_camera_is_not_called_moved():
    random = np.random.default_rng(7)
    for _ in range(20):
        first = mat_pose(computed(random), PHONE.lens)
        some = random.permutation(12)[:6].tolist()
        second = mat_pose(computed(random, tags=some), PHONE.lens)
        assert not camera_move(first, second, PHONE.lens).moved
        assert unposed_move(first.view, second.view).pixels == 0


def test_standard_deviations_are_those_of_noise_and_paper():
    random = np.random.default_rng(5)
    z = []
    for _ in range(60):
        pose = mat_pose(computed(random, heights=1.5e-4), PHONE.lens)
        z.append(errors(pose, PLACE) / np.sqrt(np.diag(pose.covariance)))
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_glued_sheets_may_lie_a_little_wrong():
    random = np.random.default_rng(5)
    view = computed(random, paper="A4x3")
    on = np.array([tag.sheet == 2 for tag in view.tags])
    points = np.array([tag.corners for tag in view.tags])
    points[on] += [0.0008, -0.0006, 0.0]
    corners = project_ideal(PHONE.lens, (points - PLACE[:3, 3]) @ PLACE[:3, :3])
    pose = mat_pose(replace(view, corners=corners), PHONE.lens)
    assert len(pose.view.tags) == len(view.tags)
    assert np.linalg.norm(errors(pose, PLACE)[3:]) < 3e-4


def test_wrong_corner_is_left_out_and_the_mean_of_images_is_used():
    random = np.random.default_rng(5)
    views = [computed(random) for _ in range(4)]
    views[2].corners[3] += 30.0
    mean = mean_view(views)
    assert np.linalg.norm(errors(mat_pose(mean, PHONE.lens), PLACE)[3:]) < 3e-4
    mean.corners[5] += 20.0
    pose = mat_pose(mean, PHONE.lens)
    assert len(pose.view.tags) == 11
    assert np.linalg.norm(errors(pose, PLACE)[3:]) < 3e-4


def test_scale_moves_the_camera_away_from_the_origin():
    view = computed(np.random.default_rng(5))
    exact, large = (mat_pose(view, PHONE.lens, scale) for scale in (None, 181.8))
    assert large.T_world_camera[:3, 3] == pytest.approx(1.01 * exact.T_world_camera[:3, 3])
    with pytest.raises(CalibrationError, match="stated to be 100 mm long, on the A4 mat it is 180 mm"):
        mat_pose(view, PHONE.lens, 100.0)


@pytest.mark.parametrize(
    ("tags", "said"), [([4], "1 tag is seen, 2 are needed"), ([9, 10], "raise the camera")]
)
def test_too_few_tags_are_refused_with_the_remedy(tags, said):
    view = computed(np.random.default_rng(5), tags=tags, noise=1.0 if len(tags) > 1 else NOISE_PX)
    with pytest.raises(CalibrationError, match=said):
        mat_pose(view, PHONE.lens)


def test_mirrored_image_is_refused():
    view = computed(np.random.default_rng(5))
    with pytest.raises(CalibrationError, match="not seen from above"):
        mat_pose(replace(view, corners=view.corners * [-1, 1] + [639, 0]), PHONE.lens)
