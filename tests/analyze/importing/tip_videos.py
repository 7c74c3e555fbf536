"""Rendered videos of a tip: a box with one tag that turns about its edge, as a small camera records it.

The images are also written in other kinds of files that cameras produce.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import cv2
import numpy as np

from analyze.types import Array
from schemas.document import canonical_json
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range, StrikePlan
from tests.analyze.simulated_session import tipping

Image = np.ndarray
WIDTH, HEIGHT, FOCAL = 320, 240, 300.0
PIVOT_PX = (160.0, 215.0)
FAR_M = 0.225
RATE = 120
PHI, K = 0.44, 110.0
REST = 30
"""frames before the tip"""
MICROSECONDS = Fraction(1, 1_000_000)
OBJECT = """\
name = "box"
mass_kg = 0.1
mass_sd_kg = 0.0001
shell_thickness_m = 0.0025

[shape]
box = { size_m = [0.07, 0.06, 0.15] }

[[marker]]
id = 3
size_m = 0.03
T_object_marker = [[1, 0, 0, 0], [0, 0, -1, -0.03], [0, 1, 0, -0.01], [0, 0, 0, 1]]
"""
T_WORLD_CAMERA = np.array(
    [
        [1.0, 0, 0, (159.5 - PIVOT_PX[0]) * FAR_M / FOCAL],
        [0, 0, 1, -0.03 - FAR_M],
        [0, -1, 0, (PIVOT_PX[1] - 119.5) * FAR_M / FOCAL],
        [0, 0, 0, 1],
    ]
)


def angles() -> Array:
    """Tipping angle theta (n,) [rad] of each frame: rest, tip, the box on its side."""
    truth, _ = tipping(PHI, K)
    return np.array(truth[30 - REST :] + [np.pi / 2] * 10)


@cache
def tip() -> tuple[Image, ...]:
    """Images of one tip, one per frame."""
    return tuple(picture(theta) for theta in angles())


def picture(theta: float, shift: tuple[float, float] = (0.0, 0.0), fine: int = 4) -> Image:
    """(HEIGHT, WIDTH) image of the box turned by theta about its edge, drawn `fine` times as large."""
    tag = cv2.aruco.generateImageMarker(
        cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 3, 80
    )
    card = np.full((120, 120), 225, np.uint8)
    card[20:100, 20:100] = np.where(tag > 127, 225, 25)
    # Corners of the tag's card about the pivot [m, x right, y down], and where they are drawn.
    side = 0.03 * 120 / 80
    low = np.array([-0.035, -0.065])
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * side / 2 + low
    turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
    drawn = (corners @ turn.T * FOCAL / FAR_M + PIVOT_PX + shift + 0.5) * fine - 0.5
    source = np.array([[-0.5, -0.5], [119.5, -0.5], [119.5, 119.5], [-0.5, 119.5]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(source, drawn.astype(np.float32))
    large = cv2.warpPerspective(
        card, H, (WIDTH * fine, HEIGHT * fine), flags=cv2.INTER_LINEAR, borderValue=(120,)
    )
    return cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


def write_video(
    path: Path,
    images: Sequence[Image],
    times_us: Iterable[int] | None = None,
    codec: str = "libx264",
    pixels: str = "yuv420p",
    turned: int = 0,
    captured: str | None = None,
    **options: str,
) -> Path:
    """Encode images with their times; `captured` is the capture rate that an Android phone would state."""
    times = range(0, len(images) * 10**6 // RATE + 1, 10**6 // RATE) if times_us is None else times_us
    more = (
        {"video_track_timescale": "1000000", "movflags": "use_metadata_tags"} if path.suffix == ".mp4" else {}
    )
    with av.open(str(path), "w", options=more) as container:
        if captured is not None:
            container.metadata["com.android.capture.fps"] = captured
        # One thread: with more, pictures differ from run to run.
        quick = {"preset": "veryfast", "threads": "1"} if codec == "libx264" else {}
        stream = container.add_stream(codec, rate=RATE, options=quick | options)
        stream.height, stream.width = images[0].shape
        stream.pix_fmt = pixels
        stream.codec_context.time_base = MICROSECONDS
        if turned:
            stream.set_display_rotation(turned)
        for image, time_us in zip(images, times, strict=False):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format=pixels)
            frame.pts, frame.time_base = time_us, MICROSECONDS
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def setting(
    folder: Path, strikes: Sequence[str] = ("s1",), *, placed: bool = True
) -> tuple[Path, Path, Path]:
    """Object, plan and camera file of that video."""
    spec = parse_object_spec(OBJECT, "object.toml")
    plan = StrikePlan(
        object_name="box",
        object_sha256=object_sha256(spec, None),
        strikes=[_planned(name) for name in strikes],
    )
    camera = [
        f"width = {WIDTH}",
        f"height = {HEIGHT}",
        f"K = [[{FOCAL}, 0, 159.5], [0, {FOCAL}, 119.5], [0, 0, 1]]",
    ]
    camera += [f"T_world_camera = {T_WORLD_CAMERA.tolist()}"] if placed else []
    paths = folder / "object.toml", folder / "plan.json", folder / "camera.toml"
    for path, text in zip(
        paths, (OBJECT, canonical_json(plan), "\n".join(["[camera.calibration]", *camera])), strict=True
    ):
        path.write_text(text + "\n", encoding="utf-8")
    return paths


def _planned(name: str) -> PlannedStrike:
    return PlannedStrike(
        id=name,
        plane_id="z-",
        axis_id="z-/x+",
        R_world_object=np.eye(3).tolist(),
        p_world_object=[-0.035, 0.0, 0.075],
        pivot=Pivot(point=[0.035, 0.0, -0.075], direction=[0.0, 1.0, 0.0], radius_m=0.0, sd_m=2e-4),
        impact=Impact(point=[-0.035, 0.0, 0.05], direction=[1.0, 0.0, 0.0]),
        impact_height_m=0.125,
        impulse_n_s=Range(min=0.01, target=0.02, max=0.03),
        tip_speed_m_s=Range(min=0.1, target=0.2, max=0.3),
        energy_ratio=1.05,
        phi_predicted_rad=PHI,
        phi_predicted_sd_rad=0.1,
        i_edge_predicted_kg_m2=3e-4,
        visible_markers=[3],
        camera_pose=np.eye(4).tolist(),
        friction_needed=0.2,
    )
