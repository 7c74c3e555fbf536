"""Camera poses by rendered mats against the truth, and bumped cameras found (`make bench-mat`).

Each view is drawn with a box on the mat and, in every second one, hands over up to half of the tags; once
with an exact print, once with paper that curls by 0.15 mm, is 0.1 % out of scale and, of three sheets, glued
by hand. The camera is then bumped by 1 to 20 mm, 0.2 to 5 degrees, or both, and drawn again with other tags
hidden; and once more where it stands, for false alarms. Arguments: number of views, seed.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.calibration.mat_pose import CameraMove, MatPose, camera_move, mat_pose, read_mat, unposed_move
from analyze.calibration.mat_view import MatView
from analyze.errors import CalibrationError
from tests.mat_views import Paper, Phone, Scene, bumped, half_hidden, picture, random_paper, random_view

PHONES = (Phone(), Phone(960, 540, 900.0, -0.08, 0.6, 2.0))
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
    try:
        return view, None if view is None else mat_pose(view, phone.lens)
    except CalibrationError as error:
        out(f"  refused: {error}")
        return view, None


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


def error_of(pose: MatPose, T: np.ndarray) -> Error:
    """Error of a pose against the true one."""
    turn = Rotation.from_matrix(pose.T_world_camera[:3, :3] @ T[:3, :3].T).as_rotvec()
    shift = pose.T_world_camera[:3, 3] - T[:3, 3]
    z = np.concatenate([turn, shift]) / np.sqrt(np.diag(pose.covariance))
    return Error(
        math.degrees(np.linalg.norm(turn)), 1000 * float(np.linalg.norm(shift)), z, len(pose.view.tags)
    )


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
    exact, rough = list[Error](), list[Error]()
    found, missed, false_alarms, still = 0, list[str](), 0, 0
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
        before = pose_of(picture(phone, T, scene, random), phone)
        if before[1] is not None:
            exact.append(error_of(before[1], T))
        again = pose_of(picture(phone, T, taped, random), phone)
        if again[1] is not None:
            rough.append(error_of(again[1], T))
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
                still += 1
                false_alarms += move.moved
    show("exact print", exact, views)
    show("taped paper", rough, views)
    out(f"bumps found {found} of {views}; false alarms {false_alarms} of {still}")
    for line in missed:
        out(f"  missed {line}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
