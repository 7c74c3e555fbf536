"""Rendered videos of a box with hidden masses that tips over several parallel edges, at any frame rate.

They are captured at one frame rate and state another.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from analyze.types import Array
from schemas.document import canonical_json
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.strike_plan import PlannedStrike, StrikePlan
from tests.analyze.estimation.bodies import GRAVITY, box_body, planned_strike
from tests.analyze.estimation.bodies import tip as phi_and_k
from tests.analyze.importing.tip_videos import (
    FAR_M,
    FOCAL,
    HEIGHT,
    OBJECT,
    PIVOT_PX,
    WIDTH,
    Image,
    setting,
    write_video,
)

BODY = box_body((0.07, 0.06, 0.15), (0.03, 0.05, 0.02), -0.01, (0.3, 0.1, -0.9), edge_radius=0.0)
AXES = ((2, -1, 1, 1), (0, 1, 1, 1), (2, 1, 1, -1), (0, -1, 1, -1))
"""edges along O's y, with the tag towards the camera"""
REST_S, AFTER_S, ENERGY = 0.15, 0.05, 1.05
TAG = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), 3, 80)


def strikes(count: int = 4) -> list[PlannedStrike]:
    """Planned strikes, whose predictions are for a slightly different box."""
    found = []
    for number, axis in enumerate(AXES[:count]):
        strike = planned_strike(BODY, *axis)
        phi, k = phi_and_k(BODY, strike)
        R = float(np.linalg.norm((BODY.com - np.array(strike.pivot.point)) * [1, 0, 1]))
        planned = {"id": f"s{number + 1}", "visible_markers": [3], "phi_predicted_rad": phi + 0.03}
        found.append(
            strike.model_copy(update={**planned, "i_edge_predicted_kg_m2": 0.9 * BODY.mass * GRAVITY * R / k})
        )
    return found


def angles(strike: PlannedStrike, rate: float) -> Array:
    """Tipping angle theta (n,) [rad] of each frame: rest, tip, the box on its side."""
    phi, k = phi_and_k(BODY, strike)
    theta, turn, step = 0.0, float(np.sqrt(2 * k * (1 - np.cos(phi)) * ENERGY)), 1 / rate / 20
    found = [0.0] * round(REST_S * rate)
    while theta < np.pi / 2:
        for _ in range(20):
            middle = turn + step / 2 * -k * np.sin(phi - theta)
            theta, turn = theta + step * middle, turn - step * k * np.sin(phi - theta - step / 2 * turn)
        found.append(min(theta, np.pi / 2))
    return np.array(found + [np.pi / 2] * round(AFTER_S * rate))


def picture(strike: PlannedStrike, theta: float) -> Image:
    """(HEIGHT, WIDTH) image of the tag on the box turned by theta, drawn at double size, slightly blurred."""
    card = np.full((120, 120), 225, np.uint8)
    card[20:100, 20:100] = np.where(TAG > 127, 225, 25)
    side = np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * 0.0225
    on_object = np.column_stack([side[:, 0], np.full(4, -0.03), side[:, 1] - 0.01])
    x, _, z = (on_object @ np.array(strike.R_world_object).T + strike.p_world_object).T
    x, z = x * np.cos(theta) + z * np.sin(theta), -x * np.sin(theta) + z * np.cos(theta)
    drawn = 2 * (np.column_stack([x, -z]) * FOCAL / FAR_M + PIVOT_PX + 0.5) - 0.5
    source = np.array([[-0.5, -0.5], [119.5, -0.5], [119.5, 119.5], [-0.5, 119.5]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(source, drawn.astype(np.float32))
    large = cv2.warpPerspective(card, H, (WIDTH * 2, HEIGHT * 2), flags=cv2.INTER_LINEAR, borderValue=(120,))
    return cv2.GaussianBlur(cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), (0, 0), 0.6)


def images(planned: Sequence[PlannedStrike], rate: float) -> list[list[Image]]:
    """Images of each strike."""
    return [[picture(strike, theta) for theta in angles(strike, rate)] for strike in planned]


def write_videos(
    folder: Path, planned: Sequence[PlannedStrike], drawn: Sequence[Sequence[Image]], stated: float
) -> tuple[list[Path], list[str]]:
    """A video of each strike, and the command line's options of object, plan and camera."""
    _, plan_path, camera_path = setting(folder)
    object_path = folder / "box.toml"
    text = OBJECT.replace("mass_kg = 0.1\n", f"mass_kg = {BODY.mass:.6f}\n")
    object_path.write_text(text, encoding="utf-8")
    sha256 = object_sha256(parse_object_spec(text, "box.toml"), None)
    plan_path.write_text(
        canonical_json(StrikePlan(object_name="box", object_sha256=sha256, strikes=list(planned))) + "\n"
    )
    paths = [
        write_video(
            folder / f"{strike.id}.mp4",
            each,
            [round(i * 1e6 / stated) for i in range(len(each))],
            preset="veryfast",
            crf="14",
        )
        for strike, each in zip(planned, drawn, strict=True)
    ]
    return paths, ["--object", str(object_path), "--plan", str(plan_path), "--camera", str(camera_path)]
