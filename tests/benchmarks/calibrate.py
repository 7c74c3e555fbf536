"""Lenses from rendered boards against ground truth and plain OpenCV: `make bench-calibrate`.

20 virtual cameras, 15 views each: 656 x 492 px, focal length about 1430 px, distorted; noise of 4 grey
levels, blur 0.7 px; the print of `analyze print-tags --board charuco`. OpenCV: CharucoDetector and
calibrateCamera with default settings. Then the refusals.
"""

from __future__ import annotations

import argparse
import sys
import time

import cv2
import numpy as np

from analyze.calibration.calibrate import Shot, calibrate
from analyze.calibration.detect import find_corners, read_board
from analyze.calibration.lens import Lens
from analyze.least_squares.intervals import SIGMAS_95
from analyze.tags.printing import BoardOptions, parse_board
from schemas.session_manifest import LensModel
from tests.analyze.calibration.boards import TrueBoard, TrueLens, facing, photograph
from tests.analyze.calibration.compare import pixel_errors, truth

WIDTH, HEIGHT, VIEWS = 656, 492, 15
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2")
BOARD, PRINTED = parse_board(BoardOptions()), TrueBoard()


def camera(rng):
    """Random lens, similar to a rig's."""
    f = 1430 * rng.uniform(0.95, 1.05)
    k = (-0.12 + rng.uniform(-0.03, 0.03), 0.1 + rng.uniform(-0.05, 0.05), *rng.uniform(-3e-4, 3e-4, 2), 0.0)
    return TrueLens(
        WIDTH,
        HEIGHT,
        f,
        f * rng.uniform(0.9995, 1.0005),
        327.5 + rng.uniform(-6, 6),
        245.5 + rng.uniform(-6, 6),
        k,
    )


def session(rng, many=VIEWS, tilts=(0.2, 0.75), reach=(0.13, 0.1), depth=0.6):
    """Poses of a hand-held board, all over the image and tilted to all sides."""
    return [
        facing(
            PRINTED,
            [
                rng.uniform(-1, 1) * reach[0] * depth,
                rng.uniform(-1, 1) * reach[1] * depth,
                depth * rng.uniform(0.95, 1.15),
            ],
            rng.uniform(*tilts),
            rng.uniform(0, 2 * np.pi),
            rng.uniform(0, 2 * np.pi),
        )
        for _ in range(many)
    ]


def ours(images):
    """Camera calibration by this project from `images` of the board."""
    shots = []
    for number, image in enumerate(images):
        view = find_corners(image, BOARD, read_board(image, BOARD))
        if view is not None:
            shots.append(Shot(f"view {number + 1}", image, view))
    return calibrate(shots, BOARD, LensModel.PINHOLE, lambda *_: None)


def opencv(images):
    """Lens and its stated sd by OpenCV's default settings."""
    tags = cv2.aruco.getPredefinedDictionary(PRINTED.family)
    board = cv2.aruco.CharucoBoard(
        (PRINTED.columns, PRINTED.rows), PRINTED.square, 0.7 * PRINTED.square, tags
    )
    detector = cv2.aruco.CharucoDetector(board)
    objects, places = [], []
    for image in images:
        corners, ids, _, _ = detector.detectBoard(image)
        if ids is not None and len(ids) >= 6:
            on_board, place = board.matchImagePoints(corners, ids)
            objects.append(on_board)
            places.append(place)
    _, K, bend, _, _, sd, _, _ = cv2.calibrateCameraExtended(objects, places, (WIDTH, HEIGHT), None, None)
    numbers = np.array([K[0, 0], K[1, 1], K[0, 2], K[1, 2], *np.ravel(bend)[:5]])
    return Lens(LensModel.PINHOLE, WIDTH, HEIGHT, numbers), np.ravel(sd)[:9]


def say(line):
    """Print one line at once."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def row(name, unit, mine, theirs, digits):
    """Print one line of the table: median and worst of both, and errors over the stated sd (rms)."""
    cells = [
        f"{np.median(np.abs(errors)):.{digits}f} ({np.abs(errors).max():.{digits}f})"
        for errors, _ in (mine, theirs)
    ]
    ratio = ["–" if z is None else f"{np.sqrt(np.mean(np.square(z))):.2f}" for _, z in (mine, theirs)]
    return f"| {name}{f' [{unit}]' if unit else ''} | {cells[0]} | {ratio[0]} | {cells[1]} | {ratio[1]} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    seeds = parser.parse_args().seeds
    errors, z, their_errors, their_z, worst, stated, their_worst, seconds = ([] for _ in range(8))
    for seed in range(1, seeds + 1):
        rng = np.random.default_rng((seed, 0xCA1))
        lens = camera(rng)
        images = [photograph(lens, PRINTED, R, p, rng) for R, p in session(rng)]
        start = time.process_time()
        found = ours(images)
        seconds.append(time.process_time() - start)
        errors.append(found.lens.numbers - truth(lens))
        z.append(errors[-1] / found.sd)
        worst.append(pixel_errors(found.lens, lens).max())
        stated.append(found.pixels.worst)
        other, sd = opencv(images)
        their_errors.append(other.numbers - truth(lens))
        their_z.append(their_errors[-1] / sd)
        their_worst.append(pixel_errors(other, lens).max())
        say(
            f"seed {seed}: {len(found.shots)} views, {100 * found.covered.share:.0f} % covered, worst pixel "
            f"{worst[-1]:.3f} (stated ± {stated[-1]:.3f}), OpenCV {their_worst[-1]:.3f} px"
        )
    errors, z, their_errors, their_z = map(np.array, (errors, z, their_errors, their_z))
    say(f"\n{seeds} cameras, {VIEWS} views each; median (worst) of the errors' sizes\n")
    say("| | ours | error / stated sd | OpenCV's defaults | error / stated sd |\n|---|---|---|---|---|")
    for i, (name, unit, digits) in enumerate(
        zip(NAMES, ("px",) * 4 + ("", ""), (3, 3, 3, 3, 4, 3), strict=True)
    ):
        say(row(name, unit, (errors[:, i], z[:, i]), (their_errors[:, i], their_z[:, i]), digits))
    ratio = np.array(worst) / np.array(stated)
    say(row("worst pixel over the image", "px", (np.array(worst), ratio), (np.array(their_worst), None), 3))
    inside = np.mean(np.abs(z[:, : len(NAMES)]) < SIGMAS_95)
    say(
        f"\nwithin 1.96 stated sd: {100 * inside:.0f} %; {np.median(seconds):.1f} s of CPU per camera, "
        "detection included\n"
    )
    refusals()


def refusals() -> None:
    """Print the parameters that unsuitable views do not determine."""
    rng = np.random.default_rng(0xCA1)
    lens = camera(rng)
    for name, poses in (
        ("all face-on", session(rng, 9, (0.0, 0.03))),
        ("only the middle", session(rng, 9, (0.4, 0.75), (0.005, 0.005), 1.05)),
    ):
        found = ours([photograph(lens, PRINTED, R, p, rng) for R, p in poses])
        say(f"{name}: {'; '.join(found.undetermined) or 'NOT REFUSED'}")


if __name__ == "__main__":
    main()
