"""Renders the files that how-to guides assume a user to have filmed, recorded or written before.

Each function writes what one page names into a folder that already holds the phone tutorial's files.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import av
import cv2
import numpy as np

from analyze.types import CameraModel
from tests import make_phone_videos as renderer
from tests.analyze.batch.months_of_sessions import write_sessions
from tests.analyze.calibration import plumb_scenes
from tests.analyze.calibration.boards import TrueBoard, facing, photograph
from tests.analyze.fixture_objects import made, write_object_file
from tests.analyze.importing.foreign_files import write_bag, write_foxglove
from tests.analyze.motion.falling import Drop, pose
from tests.analyze.tracking.rendering import render
from tests.docs.pages import DOCS, snippets

Image = np.ndarray
PHONE = CameraModel(
    renderer.WIDTH, renderer.HEIGHT, renderer.K, np.array([renderer.K1, 0.0, 0.0, 0.0, 0.0]), np.eye(4)
)
DROP = Drop(
    fps=renderer.CAPTURE_HZ,
    fall=0.3,
    distance=0.75,
    spin=(0.4, -0.5, 0.6),
    bounces=False,
    down=(0.02, 1, 0.03),
)
"""fall of a tag of 40 mm before the tutorial's phone"""
RIG_LENS = plumb_scenes.LENS
"""lens of a rig's camera, near the one that the page of the rig file states"""
SLOWER = 2
"""ratio of the phone's frame rate to that of recorded topics"""
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


def write_drop(folder: Path) -> None:
    """Write `drop.mp4`: a tag falls freely before the phone, 240 images a second played as 30."""
    rng, images = np.random.default_rng(12), []
    for time in np.arange(-24, 66) / DROP.fps + 0.002:
        R, p = pose(DROP, np.array([time]))
        images.append(render(PHONE, [(7, DROP.size, R[0], p[0])], rng, noise=2.0))
    renderer.write_video(folder / "drop.mp4", images)


def write_one_video(folder: Path) -> None:
    """Write `session.mp4`: all strikes, one after the other."""
    renderer.write_video(folder / "session.mp4", _all_strikes(folder))


def write_months_of_results(folder: Path) -> None:
    """Write `results/`: half a year of weekly sessions."""
    write_sessions(folder / "results", 26)


def write_topics(folder: Path) -> None:
    """Write `s1.mcap` to `s3.mcap`, the bag `bag/` of all strikes, `camera.yaml` and `object.toml`."""
    (folder / "object.toml").write_bytes((folder / "teabox.toml").read_bytes())
    lens = {"image_width": PHONE.width, "image_height": PHONE.height, "camera_matrix": PHONE.K.tolist()}
    text = json.dumps(lens | {"distortion_coefficients": PHONE.distortion.tolist()})
    (folder / "camera.yaml").write_text(text, encoding="utf-8")
    stated = [*PHONE.K.ravel().tolist(), *PHONE.distortion.tolist()]
    for number in (1, 2, 3):
        frames = list(_frames(folder / f"s{number}.mp4"))[::SLOWER]
        write_foxglove(folder / f"s{number}.mcap", frames, "jpeg", intrinsics=stated)
    frames = list(_all_strikes(folder))[::SLOWER]
    write_bag(folder / "bag", frames, "jpeg", topic="/camera/image_raw", intrinsics=stated)


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


def write_objects_for_fixtures(folder: Path) -> None:
    """Write the object files of scissors, a spoon and a mug, each with its mesh."""
    for name in ("scissors", "spoon", "mug"):
        write_object_file(folder, made(name))


def write_corrected_object(folder: Path) -> None:
    """Write `FIXED.toml`, the tutorial's object weighed again: 1.5 g heavier."""
    recorded = (folder / "teabox.toml").read_text(encoding="utf-8")
    corrected = recorded.replace("mass_kg = 0.182", "mass_kg = 0.1835")
    if corrected == recorded:
        raise ValueError("teabox.toml does not state the mass that the page prints")
    (folder / "FIXED.toml").write_text(corrected, encoding="utf-8")


def _all_strikes(folder: Path) -> Iterator[Image]:
    for path in sorted(folder.glob("s?.mp4")):
        yield from _frames(path)


def _frames(path: Path) -> Iterator[Image]:
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield frame.to_ndarray(format="gray")


def _write_image(path: Path, image: Image) -> None:
    if not cv2.imwrite(str(path), image):
        raise OSError(f"{path}: not written")


def write_block_and_rig(folder: Path) -> None:
    """Write `rig.toml` as on the page on the rig file, and `block.toml` as in the build guide."""
    for page, name, word in (("rig", "rig.toml", "[camera]"), ("hardware", "block.toml", '"block"')):
        found = [body for body in snippets(DOCS / "how-to" / f"{page}.md", "toml") if word in body]
        (folder / name).write_text(found[0], encoding="utf-8")
