"""Videos that a phone would take on the phone road: a calibration board, and strikes of a plan.

A pinhole camera without distortion looks along the pivot edge. The box rolls on its edge's rounding
(Lagrange's equation, Runge-Kutta steps); of the box only its tags are drawn. What is not modelled: noise,
slip, the finger, shadows, the box's own faces, a rolling shutter.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

import av
import cv2
import numpy as np

from analyze.types import Array
from schemas.object_spec import MarkerSpec, ObjectSpec, read_object_spec
from schemas.strike_plan import PlannedStrike, StrikePlan
from tests.analyze.calibration.boards import TrueBoard, TrueLens, facing, photograph
from tests.analyze.estimation.bodies import GRAVITY, Body, box_body, tip

Image = np.ndarray
RATE = 120
"""frames per second"""
LENS = TrueLens(720, 480, 1000.0, 1000.0, 300.0, 260.0, (0.0,) * 5)
AWAY_M = 0.45
"""distance of the camera from the tag that faces it [m]"""
REST_S, LANDED_S = 0.6, 0.3
ENERGY = 1.08
"""kinetic energy after the impact over that needed to reach balance"""
FINE = 2
"""sub-pixels per pixel, along each axis"""
WHITE, GREY, BLACK = 225, 120, 25


def write_videos(folder: Path) -> Body:
    """Write `board.mp4` and `<id>.mp4` of each strike of `folder`'s plan; returns the box that was struck."""
    spec = read_object_spec(folder / "teabox.toml")
    plan = StrikePlan.model_validate(json.loads((folder / "plan.json").read_text(encoding="utf-8")))
    assert spec.shape.box is not None
    body = box_body(spec.shape.box.size_m, (0.04, 0.02, 0.122), 0.01, (0.5, 0.2, 0.8))
    _write_video(folder / "board.mp4", board_images(), 30)
    for strike in plan.strikes:
        _write_video(folder / f"{strike.id}.mp4", strike_images(body, spec, strike), RATE)
    return body


def board_images(views: int = 18, each: int = 12) -> Iterator[Image]:
    """Images of a printed board that is held still in `views` poses all over the image."""
    rng = np.random.default_rng(5)
    board = TrueBoard()
    for number in range(views):
        # The middle goes round the corners of the image.
        x, y = [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, 0)][number % 5]
        place = [0.03 + 0.13 * x, 0.075 * y - 0.01, rng.uniform(0.42, 0.55)]
        R, p = facing(board, place, rng.uniform(0.3, 0.65), rng.uniform(0, 2 * np.pi), rng.uniform(-0.5, 0.5))
        yield from [photograph(LENS, board, R, p, rng)] * each


def strike_images(body: Body, spec: ObjectSpec, strike: PlannedStrike) -> Iterator[Image]:
    """Images of one strike: rest, the tip, the box on its next face."""
    (tag,) = (marker for marker in spec.marker if marker.id == strike.visible_markers[0])
    for theta in angles(body, strike):
        yield _picture(strike, tag, theta)


def angles(body: Body, strike: PlannedStrike) -> Array:
    """Tipping angle theta (n,) [rad] of each frame."""
    phi, k = tip(body, strike)
    r = strike.pivot.radius_m
    turned = np.array(strike.R_world_object) @ (body.com - strike.pivot.point)
    R = float(np.hypot(turned[0], turned[2]))
    about_c = GRAVITY * R / k - (R + r) ** 2  # k is about the contact at balance, per mass

    def slope(theta: float, rate: float) -> Array:
        inertia = about_c + R**2 + r**2 + 2 * R * r * np.cos(theta - phi)
        return np.array([rate, (GRAVITY + r * rate**2) * R * np.sin(theta - phi) / inertia])

    at_rest = about_c + R**2 + r**2 + 2 * R * r * np.cos(phi)
    state = np.array([0.0, np.sqrt(2 * ENERGY * GRAVITY * R * (1 - np.cos(phi)) / at_rest)])
    found, step = [0.0] * round(REST_S * RATE), 1 / RATE / 8
    while state[0] < np.pi / 2:
        for _ in range(8):
            middle = state + step / 2 * slope(*state)
            state = state + step * slope(*middle)
        found.append(min(float(state[0]), np.pi / 2))
    return np.array(found + [np.pi / 2] * round(LANDED_S * RATE))


def _picture(strike: PlannedStrike, tag: MarkerSpec, theta: float) -> Image:
    """Image of the tag on its white card when the box has turned by theta [rad]."""
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    card = np.full((120, 120), WHITE, np.uint8)
    card[20:100, 20:100] = np.where(cv2.aruco.generateImageMarker(family, tag.id, 80) > 127, WHITE, BLACK)
    assert tag.T_object_marker is not None
    T = np.array(tag.T_object_marker)
    corners = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * tag.size_m / 2 * 120 / 80
    on_object = np.column_stack([corners, np.zeros(4)]) @ T[:3, :3].T + T[:3, 3]
    at_rest = on_object @ np.array(strike.R_world_object).T + strike.p_world_object
    r = strike.pivot.radius_m
    x, y, z = (at_rest - [0, 0, r]).T
    world = np.column_stack(
        [x * np.cos(theta) + z * np.sin(theta) + r * theta, y, z * np.cos(theta) - x * np.sin(theta) + r]
    )
    middle = at_rest.mean(0)
    # The camera's frame: x right, y down, z away from it; it stands on the tag's side.
    seen = np.column_stack([world[:, 0] - 0.03, 0.07 - world[:, 2], world[:, 1] - middle[1] + AWAY_M])
    drawn = FINE * (LENS.project(seen) + 0.5) - 0.5
    source = np.array([[-0.5, -0.5], [119.5, -0.5], [119.5, 119.5], [-0.5, 119.5]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(source, drawn.astype(np.float32))
    size = (LENS.width * FINE, LENS.height * FINE)
    large = cv2.warpPerspective(card, H, size, flags=cv2.INTER_LINEAR, borderValue=(GREY,))
    return cv2.GaussianBlur(
        cv2.resize(large, (LENS.width, LENS.height), interpolation=cv2.INTER_AREA), (0, 0), 0.6
    )


def _write_video(path: Path, images: Iterable[Image], rate: int) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"preset": "veryfast", "crf": "16"})
        stream.width, stream.height, stream.pix_fmt = LENS.width, LENS.height, "yuv420p"
        for image in images:
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
