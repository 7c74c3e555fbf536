"""Camera poses by rendered mats against the truth, and bumped cameras found (`make bench-mat`).

Each view is drawn with a box on the mat and, in every second one, hands over up to half of the tags; once
with an exact print, once with paper that curls by 0.15 mm, is 0.1 % out of scale and, of three sheets, glued
by hand; estimated by one image, and by as many as an import takes at rest. The camera is then bumped by 1 to
20 mm, 0.2 to 5 degrees, or both, and drawn again with other tags hidden; and once more where it stands, for
false alarms. Arguments: number of views, seed.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.calibration.mat_pose import CameraMove, MatPose, camera_move, mat_pose, read_mat, unposed_move
from analyze.calibration.mat_view import MatView, mean_view
from analyze.errors import CalibrationError
from analyze.importing.mat_cameras import REST_IMAGES
from tests.mat_views import (
    Paper,
    Phone,
    Scene,
    bumped,
    drawn,
    half_hidden,
    noisy,
    picture,
    random_paper,
    random_view,
)

PHONES = (Phone(parts=7), Phone(960, 540, 900.0, -0.08, 0.6, 2.0, parts=7))
"""3 x 3 rays to a pixel would put the camera 0.3 mm off where only three tags are seen"""
PAPERS = ("A4", "A4", "A3", "A4x3")
BOX = ((-0.075, -0.0325, 0.0), (0.0, 0.0325, 0.13))


@dataclass(frozen=True)
class Error:
    """Error of one pose: rotation [deg], place [mm], and both in standard deviations."""

    degrees: float
    mm: float
    z: np.ndarray
    """(6,)"""
    tags: int


def pose_of(image: np.ndarray, phone: Phone) -> tuple[MatView | None, MatPose | None]:
    """Tags and pose by one image; None if refused."""
    view = read_mat(image, phone.lens)
    return view, pose_by(view, phone)


def pose_by(view: MatView | None, phone: Phone) -> MatPose | None:
    """Pose by the tags of one image, or the mean of several; None if refused."""
    try:
        return None if view is None else mat_pose(view, phone.lens)
    except CalibrationError as error:
        out(f"  refused: {error}")
        return None


def still_pose(light: np.ndarray, phone: Phone, random: np.random.Generator) -> MatPose | None:
    """Pose by as many images of a camera that stands still as an import takes; None if refused."""
    views = (read_mat(noisy(phone, light, random), phone.lens) for _ in range(REST_IMAGES))
    return pose_by(mean_view([view for view in views if view is not None]), phone)


def move_of(
    before: tuple[MatView | None, MatPose | None], after: tuple[MatView | None, MatPose | None], phone: Phone
) -> CameraMove | None:
    """Move of the camera, as an import judges it."""
    if before[1] is not None and after[1] is not None:
        return camera_move(before[1], after[1], phone.lens)
    return None if before[0] is None or after[0] is None else unposed_move(before[0], after[0])


def out(line: str) -> None:
    """Print a line."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def error_of(pose: MatPose | None, T: np.ndarray) -> list[Error]:
    """Error of a pose against the true one; none of a view that is refused."""
    if pose is None:
        return []
    turn = Rotation.from_matrix(pose.T_world_camera[:3, :3] @ T[:3, :3].T).as_rotvec()
    shift = pose.T_world_camera[:3, 3] - T[:3, 3]
    z = np.concatenate([turn, shift]) / np.sqrt(np.diag(pose.covariance))
    degrees, mm = math.degrees(np.linalg.norm(turn)), 1000 * float(np.linalg.norm(shift))
    return [Error(degrees, mm, z, len(pose.view.tags))]


def show(name: str, errors: list[Error], views: int) -> None:
    """Print one row of the table of poses."""
    degrees, mm = (np.array([getattr(each, key) for each in errors]) for key in ("degrees", "mm"))
    z = np.concatenate([each.z for each in errors])
    inside = 100 * np.mean(np.abs(z) < 1.96)
    out(
        f"{name}: {len(errors)} of {views} views; rotation rms {np.sqrt(np.mean(degrees**2)):.3f}, at most "
        f"{degrees.max():.3f} deg; place rms {np.sqrt(np.mean(mm**2)):.2f}, at most {mm.max():.2f} mm; "
        f"z rms {np.sqrt(np.mean(z**2)):.2f}, within 1.96 sd {inside:.0f} %; tags "
        f"{np.mean([each.tags for each in errors]):.1f}"
    )


def main(views: int = 40, seed: int = 1) -> None:
    """Draw, estimate and print."""
    errors: dict[str, list[Error]] = {}
    found, missed, false_alarms, compared = 0, list[str](), 0, 0
    for number in range(views):
        random = np.random.default_rng((seed, number))
        phone, paper = PHONES[number % 2], PAPERS[number // 2 % 4]
        T, box = random_view(random), BOX if number % 4 != 3 else None
        share = random.uniform(0.2, 0.5) if number % 2 else 0.0
        scene = half_hidden(Scene(paper, Paper(), box), phone, T, random, share)
        taped = replace(scene, print_=random_paper(random))
        turn = math.radians(math.exp(random.uniform(math.log(0.2), math.log(5))))
        distance = math.exp(random.uniform(math.log(1), math.log(20))) / 1000
        turn, distance = [(0.0, distance), (turn, 0.0), (turn, distance)][number % 3]
        moved = bumped(T, random, distance, turn)
        for print_, seen in (("exact print", scene), ("taped paper", taped)):
            light = drawn(phone, T, seen)
            again = pose_of(noisy(phone, light, random), phone)
            still = still_pose(light, phone, np.random.default_rng((seed, number, 1)))
            for images, pose in (("one image", again[1]), (f"{REST_IMAGES} images", still)):
                errors.setdefault(f"{print_}, {images}", []).extend(error_of(pose, T))
        for place, is_bump in ((moved, True), (T, False)):
            other = half_hidden(replace(taped, hands=()), phone, place, random, random.uniform(0, 0.4))
            after = pose_of(picture(phone, place, other, random), phone)
            move = move_of(again, after, phone)
            what = f"view {number}: {1000 * distance:.1f} mm, {math.degrees(turn):.2f} deg"
            if is_bump:
                found += move is not None and move.moved
                if move is None or not move.moved:
                    missed.append(f"{what}: {'no common tags' if move is None else f'chi2 {move.chi2:.0f}'}")
            elif move is not None:
                compared += 1
                false_alarms += move.moved
    for name in sorted(errors):
        show(name, errors[name], views)
    out(f"bumps found {found} of {views}; false alarms {false_alarms} of {compared}")
    for line in missed:
        out(f"  missed {line}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
