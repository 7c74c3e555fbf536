"""Renders the files that how-to guides assume a user to have filmed, recorded or written before.

Each function writes what one page names into a folder that already holds the phone tutorial's files.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from tests.analyze.calibration import plumb_scenes
from tests.analyze.calibration.boards import TrueBoard, facing, photograph
from tests.docs.pages import DOCS, snippets

Image = np.ndarray
RIG_LENS = plumb_scenes.LENS
"""lens of a rig's camera, near the one that the page of the rig file states"""
LOOKING_DOWN = np.array([[1.0, 0, 0, 0.077], [0, -0.6, 0.8, -0.32], [0, -0.8, -0.6, 0.42], [0, 0, 0, 1]])
"""(4, 4) pose in W of a camera that sees a board on the table"""


def write_board_images(folder: Path) -> None:
    """Write `images/`, pictures of a printed board in 16 poses, and `table.png`, the board on the table."""
    rng, board = np.random.default_rng(11), TrueBoard()
    (folder / "images").mkdir()
    for number in range(16):
        x, y = [(-1, -1), (1, -1), (1, 1), (-1, 1), (0, 0)][number % 5]
        middle = [0.05 * x, 0.035 * y, rng.uniform(0.5, 0.6)]
        view = facing(board, middle, rng.uniform(0.35, 0.7), rng.uniform(0, 6.3), rng.uniform(-0.5, 0.5))
        _write_image(folder / "images" / f"{number:02}.png", photograph(RIG_LENS, board, *view, rng))
    R = LOOKING_DOWN[:3, :3].T
    _write_image(folder / "table.png", photograph(RIG_LENS, board, R, -R @ LOOKING_DOWN[:3, 3], rng))


def write_plumb_line(folder: Path) -> None:
    """Write `plumb.png`, a picture of a plumb line (hanging string) by the rig's camera."""
    image = plumb_scenes.photograph([(0.0, 0.02)], (0.001, 0.0), np.random.default_rng(13))
    _write_image(folder / "plumb.png", image)


def write_labelled_object(folder: Path) -> None:
    """Write the recording `hammer.mcap`, and `labelled.toml`, its object with layers of how-to/parts.md."""
    (folder / "hammer.mcap").write_bytes((folder / "teabox.mcap").read_bytes())
    layers = next(body for body in snippets(DOCS / "how-to" / "parts.md", "toml") if "between_m" in body)
    plain = (folder / "teabox.toml").read_text(encoding="utf-8")
    (folder / "labelled.toml").write_text(f"shell_thickness_m = 0.001\n{plain}\n{layers}", encoding="utf-8")


def _write_image(path: Path, image: Image) -> None:
    if not cv2.imwrite(str(path), image):
        raise OSError(f"{path}: not written")
