"""Sample strikes of the tea box, filmed on the mat by a phone that may be bumped between strikes."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from unittest.mock import patch

import cv2
import numpy as np

from analyze.tags.mat import mat
from analyze.tags.mat_pages import mat_pages
from analyze.tags.pdf import pdf_bytes
from tests import make_phone_videos as renderer
from tests.analyze.tags.painted import painted
from tests.places import ROOT

PHONE = ROOT / "docs" / "examples" / "phone"
LENS = f"""\
[camera.calibration]
width = {renderer.WIDTH}
height = {renderer.HEIGHT}
K = {renderer.K.tolist()}
distortion = [{renderer.K1}, 0, 0, 0, 0]
"""
RATE_HZ = 120


@cache
def mat_texture(paper: str = "A4") -> np.ndarray:
    """The mat as its PDF paints it, in the renderer's grey levels, 4 px per mm."""
    ((image, _),) = painted(pdf_bytes(mat_pages(mat(paper))))
    small = cv2.resize(image, None, fx=1 / 3, fy=1 / 3, interpolation=cv2.INTER_AREA).astype(float) / 255
    return np.rint(renderer.BLACK + (renderer.WHITE - renderer.BLACK) * small).astype(np.uint8)


@contextmanager
def filmed_on_mat(bump_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Iterator[np.ndarray]:
    """Let the renderer draw the mat on the table, and its camera stand elsewhere; yield the camera's pose."""
    plain = renderer.background

    def background(random: np.random.Generator) -> np.ndarray:
        large = plain(random)
        R, eye = renderer.camera()
        half = np.array([mat("A4").width, mat("A4").height, 0.0]) / 2000
        corners = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * half
        renderer.draw(large, mat_texture(), (corners - eye) @ R.T)
        return large

    with (
        patch.object(renderer, "background", background),
        patch.object(renderer, "EYE", renderer.EYE + bump_m),
    ):
        R, eye = renderer.camera()
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R.T, eye
        yield T


def write_strikes(
    folder: Path,
    numbers: list[int],
    bumps: dict[int, tuple[float, float, float]],
    rate_hz: int = RATE_HZ,
    *,
    tags: bool = True,
) -> dict[str, np.ndarray]:
    """Write camera file and videos of some of the sample plan's strikes; return each one's camera pose."""
    spec = tomllib.loads((PHONE / "teabox.toml").read_text(encoding="utf-8"))
    spec["marker"] = spec["marker"] if tags else []
    plan = json.loads((PHONE / "plan.json").read_text(encoding="utf-8"))
    random = np.random.default_rng(11)
    sides = renderer.box_sides(spec, random)
    (folder / "camera.toml").write_text(LENS, encoding="utf-8")
    poses: dict[str, np.ndarray] = {}
    for number in numbers:
        strike = plan["strikes"][number]
        with filmed_on_mat(bumps.get(number, (0.0, 0.0, 0.0))) as T:
            images = renderer.strike_images(sides, strike, random, rate_hz=rate_hz)
            renderer.write_video(folder / f"{strike['id']}.mp4", images, rate_hz)
        poses[strike["id"]] = T
    return poses
