"""Errors and CPU time of tag angles, compared with plain OpenCV: `make bench-tags` (four minutes).

Images: exact area coverage on a grid of 4 x 4 to a pixel, blurred there by 0.7 px, averaged over each pixel,
noise of 4 grey levels; grey levels of 30 and 205 (contrast 175) on 120; 656 x 492 px. The renderer shares no
code with the estimator. A tag tips by 0.02 rad per frame after eight frames at rest. Angle: rotation since
rest about the pivot axis, for every single frame.

Ours: `track_markers` and `tip_angle`, as for a session's strikes (the tag's place on the object is known).
OpenCV: ArucoDetector on the full frame with default parameters except for corner refinement, solvePnP
(IPPE_SQUARE), rotation against the mean of the rest. Flips: errors of more than 5 deg, which are left out of
the other figures. Times are CPU time of one thread, all in one run.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import click
import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.spatial.transform import Rotation

from analyze.motion.tip_angle import Placement, tip_angle
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.reading.recording import open_recording
from analyze.tracking.camera_model import pixel_map
from analyze.tracking.pose import marker_corners
from analyze.tracking.track import track_markers
from analyze.types import CameraModel, ImageFrame, Marker
from tests.analyze.tracking.rendering import render
from tests.places import FIRST_SAMPLE

SIZE = 0.03
FRAME_NS = 8_333_333
REST, TIP, STEP = 8, 40, 0.02
K = np.array([[1430.0, 0, 327.5], [0, 1430.0, 245.5], [0, 0, 1]])
FLIP_DEG = 5.0
SIDES = (40, 60, 80, 120)
ALONG, ACROSS = "on the axis", "across it"
REFINE = {"SUBPIX": cv2.aruco.CORNER_REFINE_SUBPIX, "APRILTAG": cv2.aruco.CORNER_REFINE_APRILTAG}

Array = NDArray[np.float64]


@dataclass
class Errors:
    """Errors of one method at one size and view."""

    degrees: list[float] = field(default_factory=list)
    missed: int = 0
    frames: int = 0
    cpu_s: float = 0.0

    def add(self, degrees: Array, frames: int, cpu_s: float) -> None:
        """Add the errors of one clip."""
        self.degrees += degrees.tolist()
        self.missed += frames - len(degrees)
        self.frames += frames
        self.cpu_s += cpu_s

    def row(self) -> list[str]:
        """Cells of the table: rms, bias, worst, flips and misses, time."""
        off = np.array(self.degrees)
        good = off[np.abs(off) < FLIP_DEG]
        time_ms = f"{1000 * self.cpu_s / self.frames:.2f}"
        lost = f"{100 * (len(off) - len(good)) / self.frames:.0f} %, {100 * self.missed / self.frames:.0f} %"
        if not len(good):
            return ["-", "-", "-", lost, time_ms]
        return [
            f"{np.sqrt(np.mean(good**2)):.4f}",
            f"{good.mean():+.4f}",
            f"{np.abs(good).max():.3f}",
            lost,
            time_ms,
        ]


@dataclass(frozen=True)
class Clip:
    """Rendered frames of a tip, with the true angle."""

    camera: CameraModel
    marker: Marker
    frames: list[ImageFrame]
    theta: Array
    """(n,) true angle [rad]"""


def render_clip(px: float, view: str, seed: int, rest: int = REST, after: int = 0) -> Clip:
    """Clip of rest, a tip about W's y and rest again, with random start, place and camera direction."""
    rng = np.random.default_rng(seed)
    distance = K[0, 0] * SIZE / px
    # Columns: the camera's x, y, z in W. Along the axis it looks towards +y, across it towards +x.
    R_world_camera = (
        np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
        if view == ALONG
        else np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    )
    R_world_camera = Rotation.from_rotvec(rng.uniform(-0.05, 0.05, 3)).as_matrix() @ R_world_camera
    T = np.eye(4)
    T[:3, :3] = R_world_camera
    aim = np.array([0.4, 0.0, 0.7]) * SIZE + rng.uniform(-0.2, 0.2, 3) * SIZE
    T[:3, 3] = aim - distance * R_world_camera[:, 2]
    camera = CameraModel(656, 492, K, np.array([-0.12, 0.05, 3e-4, -2e-4, 0.0]), T)
    T_object_marker = np.eye(4)
    faces = (
        np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        if view == ALONG
        else np.array([[0.0, 0, -1], [-1, 0, 0], [0, 1, 0]])
    )
    turned = rng.uniform(-0.3, 0.3) if view == ALONG else rng.uniform(-0.05, 0.05)
    T_object_marker[:3, :3] = Rotation.from_rotvec([0, turned, 0]).as_matrix() @ faces
    T_object_marker[:3, 3] = np.array([0.0, 0.0, 0.8]) * SIZE
    tip = STEP * (np.arange(TIP) + rng.uniform(0.5, 1.5))
    theta = np.concatenate([np.zeros(rest), tip, np.full(after, tip[-1])]).astype(np.float64)
    frames = []
    for i, angle in enumerate(theta):
        turn = Rotation.from_rotvec([0, angle, 0]).as_matrix()
        R = R_world_camera.T @ turn @ T_object_marker[:3, :3]
        p = R_world_camera.T @ (turn @ T_object_marker[:3, 3] - T[:3, 3])
        frames.append(ImageFrame(i * FRAME_NS, i, render(camera, [(7, SIZE, R, p)], rng)))
    return Clip(camera, Marker(7, SIZE, T_object_marker), frames, theta)


def ours(seen: Clip) -> Array:
    """Errors (n,) [deg] of our angles in the frames after the rest."""
    report = track_markers(seen.frames, seen.camera, [seen.marker], [7])
    placement = Placement(np.eye(3), np.zeros(3), np.zeros(3), 0.0)
    angle = tip_angle(report.tracks, [seen.marker], seen.camera, placement, REST * FRAME_NS).angle
    true = seen.theta[np.searchsorted([frame.time_ns for frame in seen.frames], angle.time_ns)]
    return np.degrees(angle.theta - true)[angle.time_ns >= REST * FRAME_NS]


def opencvs(seen: Clip, refinement: int) -> Array:
    """Errors (n,) [deg] of a plain OpenCV script in the frames after the rest."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = refinement
    detector = cv2.aruco.ArucoDetector(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), parameters
    )
    points = marker_corners(SIZE)
    rest: list[Array] = []
    tips: list[tuple[int, Array]] = []
    for i, frame in enumerate(seen.frames):
        corners, ids, _ = detector.detectMarkers(frame.image)
        if ids is None or 7 not in ids:
            continue
        quad = corners[np.ravel(ids).tolist().index(7)][0].astype(float)
        _, rotation, _ = cv2.solvePnP(
            points, quad, seen.camera.K, seen.camera.distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        R = seen.camera.T_world_camera[:3, :3] @ cv2.Rodrigues(rotation)[0]
        if i < REST:
            rest.append(R)
        else:
            tips.append((i, R))
    if not rest or not tips:
        return np.zeros(0)
    R_rest = Rotation.from_matrix(np.array(rest)).mean().as_matrix()
    turned = Rotation.from_matrix(np.array([R for _, R in tips]) @ R_rest.T).as_rotvec()[:, 1]
    return np.degrees(turned - seen.theta[[i for i, _ in tips]])


def timed(measure: Callable[[], Array]) -> tuple[Array, float]:
    """Errors (n,) that a function returns, and its CPU time [s]."""
    start = time.process_time()
    result = measure()
    return result, time.process_time() - start


def session(path: Path) -> str:
    """Text on the speed of reading a recording's strikes, from the file to phi and k."""
    with open_recording(path) as recording:
        strikes = recording.strikes
        windows = 1e-9 * sum(strike.window_end_ns - strike.window_start_ns for strike in strikes)
        whole = 1e-9 * (strikes[-1].window_end_ns - strikes[0].window_start_ns)
        frames = sum(
            1
            for strike in strikes
            for _ in recording.frame_meta(start_ns=strike.window_start_ns, end_ns=strike.window_end_ns)
        )
    cost, fits = np.inf, 0
    for _ in range(2):
        start = time.process_time()
        evidence = read_evidence(read_head(path))
        cost = min(cost, time.process_time() - start)
        fits = sum(motion.fit is not None for motion in evidence.motions)
    times = f"{windows / cost:.1f} times faster than the {windows:.1f} s of its windows"
    if whole > windows * 1.01:
        span = f"{whole:.1f} s from its first strike to its last"
        times = f"{whole / cost:.1f} times faster than the {span}, {times}"
    contents = f"{len(strikes)} strikes, {fits} with phi and k, {frames} frames"
    return f"{path.name}: {contents}: {cost:.2f} s of CPU time, {times}"


def speeds(console: Console) -> None:
    """Print frames per second, with as many frames at rest as in a session; the better of two runs."""
    seen = render_clip(80, ALONG, 1, rest=60, after=160)
    few = Clip(seen.camera, seen.marker, seen.frames[::12], seen.theta[::12])
    own = min(timed(lambda: ours(seen))[1] for _ in range(2)) / len(seen.frames)
    for name, refinement in REFINE.items():
        # APRILTAG takes a sixth of a second per frame: it gets a twelfth of the frames.
        its = few if name == "APRILTAG" else seen
        cost = min(
            timed(lambda its=its, refinement=refinement: opencvs(its, refinement))[1] for _ in range(2)
        ) / len(its.frames)
        setting = f"80 px, on the axis, {len(seen.frames)} frames, {TIP} of a tip"
        speed = f"ours {1 / own:.0f} frames per second and core; {name}, full frame, {1 / cost:.0f}"
        console.print(f"{setting}: {speed}; ratio {cost / own:.1f}", highlight=False)


@click.command()
@click.option("--films", default=3, show_default=True, help="Clips for each size and view.")
@click.option(
    "--session",
    "path",
    type=click.Path(path_type=Path),
    help="Another session to be read, such as the one from `make demo`.",
)
def main(films: int, path: Path | None) -> None:
    """Measure a tag that tips in rendered images, by this project and by OpenCV; print errors and times."""
    cv2.setNumThreads(1)
    console = Console(width=185)
    cells = [(view, px) for view in (ALONG, ACROSS) for px in SIDES]
    errors = {cell: {name: Errors() for name in ("ours", *REFINE)} for cell in cells}
    for view, px in track(cells, console=Console(stderr=True), transient=True):
        for number in range(films):
            seen = render_clip(px, view, 100 * px + number)
            pixel_map(seen.camera)
            errors[view, px]["ours"].add(*_with_count(timed(lambda seen=seen: ours(seen))))
            for name, refinement in REFINE.items():
                if name == "APRILTAG" and number > 0:
                    continue  # a sixth of a second per frame
                result = timed(lambda seen=seen, refinement=refinement: opencvs(seen, refinement))
                errors[view, px][name].add(*_with_count(result))
    for view in (ALONG, ACROSS):
        table = Table(
            title=f"Camera {view}: tip angle errors per frame [deg]; flips, misses; CPU time per frame [ms]"
        )
        table.add_column("side", no_wrap=True)
        for name in ("ours", *REFINE):
            for heading in ("rms", "bias", "worst", "flips, missed", "ms"):
                table.add_column(
                    f"{name}: {heading}" if heading == "rms" else heading, justify="right", no_wrap=True
                )
        for px in SIDES:
            table.add_row(
                f"{px} px", *(each for name in ("ours", *REFINE) for each in errors[view, px][name].row())
            )
        console.print(table)
    speeds(console)
    for each in [FIRST_SAMPLE, *([path] if path else [])]:
        console.print(session(each), highlight=False)


def _with_count(result: tuple[Array, float]) -> tuple[Array, int, float]:
    # The frames at rest are measured too.
    return result[0], TIP, result[1] * TIP / (REST + TIP)


if __name__ == "__main__":
    main()
