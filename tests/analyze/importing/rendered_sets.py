"""Phone videos of a tea box, drawn by the independent renderer, and thirty shuffled sets of them.

Planned are strikes over twelve edges; one or two videos show each. Further ones show what goes wrong: the
box set down the wrong way round, an edge that is not planned, a phone in the hand, a box that nobody strikes.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from schemas.document import canonical_json
from schemas.object_spec import object_sha256, read_object_spec
from schemas.strike_plan import PlannedStrike, StrikePlan
from tests import make_phone_videos as renderer
from tests.analyze.estimation.bodies import box_body, planned_strike
from tests.places import ROOT

OBJECT = ROOT / "docs" / "examples" / "teabox.toml"
BODY = box_body((0.075, 0.065, 0.13), (0.03, 0.05, 0.02), -0.01, (0.3, 0.1, -0.9), edge_radius=0.001)
EDGES = [
    planned_strike(BODY, face, sign, along, side)
    for face, along in ((2, 1), (2, 0), (0, 1), (1, 0))
    for sign in (-1, 1)
    for side in (-1, 1)
]
PLANNED, REPEATED = 12, 4
"""numbers of edges, from the first, that the plan has, and that are filmed twice"""
LENS = f"""\
[camera.calibration]
width = {renderer.WIDTH}
height = {renderer.HEIGHT}
K = {renderer.K.tolist()}
distortion = [{renderer.K1}, 0, 0, 0, 0]
"""
RATE_HZ = 120
"""images per second: half those of the sample videos, to save time"""
KINDS = ("shuffled", "wrong end", "shuffled", "not planned", "names swapped", "hand-held", "no tip")


@dataclass(frozen=True)
class Pool:
    """Rendered videos from which sets are drawn."""

    files: dict[str, Path]
    """the option files: object, plan, camera"""
    planned: list[list[Path]]
    """one or two videos of each planned strike"""
    odd: dict[str, list[Path]]
    """videos that show no strike of the plan, by kind"""


@dataclass(frozen=True)
class VideoSet:
    """Set of videos in a folder, as a user would import it."""

    kind: str
    """one of `KINDS`"""
    paths: list[Path]
    """the videos, in the order in which they are given"""
    strikes: list[int]
    """index of the strike that each video shows; of the odd one's, the strike that it replaces"""
    odd: int | None
    """index in `paths` of the video that must be refused; None if all must be matched"""


def write_pool(folder: Path, *, placed: bool = True) -> Pool:
    """Render all videos into a folder; without places tags are glued on anywhere and a board was filmed."""
    random = np.random.default_rng(24)
    drawn = tomllib.loads(OBJECT.read_text(encoding="utf-8"))
    path, lens = OBJECT, LENS
    if not placed:
        text = re.sub(r"(?m)^T_object_marker.*\n", "", OBJECT.read_text(encoding="utf-8"))
        path, lens = folder / "teabox.toml", LENS + f"T_world_camera = {_by_board(random).tolist()}\n"
        path.write_text(text, encoding="utf-8")
        for marker in drawn["marker"]:
            marker["T_object_marker"] = _glued_anywhere(marker, drawn["shape"]["box"]["size_m"], random)
    spec = read_object_spec(path)
    strikes = [each.model_copy(update={"id": f"s{n + 1}"}) for n, each in enumerate(EDGES[:PLANNED])]
    plan = StrikePlan(object_name=spec.name, object_sha256=object_sha256(spec, None), strikes=strikes)
    files = {"object": path, "plan": folder / "plan.json", "camera": folder / "camera.toml"}
    files["plan"].write_text(canonical_json(plan), encoding="utf-8")
    files["camera"].write_text(lens, encoding="utf-8")
    sides = renderer.box_sides(drawn, random)

    def video(name: str, strike: PlannedStrike, turned_rad: float = 0.0) -> Path:
        """Video of one strike."""
        images = renderer.strike_images(sides, strike.model_dump(mode="json"), random, turned_rad, RATE_HZ)
        renderer.write_video(folder / f"{name}.mp4", images, RATE_HZ)
        return folder / f"{name}.mp4"

    def changed(name: str, images: Iterator[renderer.Image]) -> Path:
        renderer.write_video(folder / f"{name}.mp4", images, RATE_HZ)
        return folder / f"{name}.mp4"

    def first_strike() -> Iterator[renderer.Image]:
        return renderer.strike_images(sides, EDGES[0].model_dump(mode="json"), random, 0.0, RATE_HZ)

    planned = [
        [video(f"p{number}-{take}", EDGES[number]) for take in range(2 if number < REPEATED else 1)]
        for number in range(PLANNED)
    ]
    odd = {
        "wrong end": [video(f"w{number}", EDGES[number], np.pi) for number in range(0, PLANNED, 3)],
        "not planned": [video(f"u{number}", EDGES[number]) for number in range(PLANNED, len(EDGES))],
        "hand-held": [changed("held", _swinging(first_strike()))],
        "no tip": [changed("still", _standing(first_strike()))],
    }
    return Pool(files, planned, odd)


def _by_board(random: np.random.Generator) -> np.ndarray:
    """Pose of the phone (4, 4) as a board shows it that was laid on the table by hand."""
    R, eye = renderer.camera()
    turn = cv2.Rodrigues(np.array([0.0, 0.0, random.normal(0, renderer.BOARD_RAD)]))[0]
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = turn @ R.T, turn @ eye + random.normal(0, renderer.BOARD_M, 3) * [1, 1, 0]
    return T


def _glued_anywhere(marker: dict, size: Sequence[float], random: np.random.Generator) -> list[list[float]]:
    """Place of a tag that is turned and shifted on its side as far as its white card allows."""
    T = np.array(marker["T_object_marker"])
    spin, reach = random.uniform(0, 2 * np.pi), 0.5 * np.sqrt(2) * 1.3 * marker["size_m"]
    shift = [random.uniform(-1, 1) * max(0.0, float(np.abs(T[:3, i]) @ size) / 2 - reach) for i in (0, 1)]
    T[:3, 3] += T[:3, :2] @ shift
    T[:3, :3] = cv2.Rodrigues(spin * T[:3, 2])[0] @ T[:3, :3]
    return T.tolist()


def _swinging(images: Iterator[renderer.Image]) -> Iterator[renderer.Image]:
    """Images of a phone in the hand: it sways by some hundredths of the image."""
    for number, image in enumerate(images):
        across, down = round(14 * np.sin(0.22 * number)), round(8 * np.sin(0.14 * number + 1))
        yield np.roll(image, (down, across), axis=(0, 1))


def _standing(images: Iterator[renderer.Image]) -> Iterator[renderer.Image]:
    """Images of the object at rest only."""
    for _, image in zip(range(35), images, strict=False):
        yield image


def video_set(pool: Pool, seed: int, folder: Path) -> VideoSet:
    """Set of 4 to 8 videos, shuffled and renamed; in most kinds one of them is odd."""
    random = np.random.default_rng(seed)
    kind = KINDS[seed % len(KINDS)]
    chosen = [int(each) for each in random.choice(PLANNED, size=random.integers(4, 9), replace=False)]
    if kind == "shuffled":
        chosen.append(int(random.integers(REPEATED)))
    odd = None if kind in ("shuffled", "names swapped") else int(random.integers(len(chosen)))
    takes = [pool.planned[each] for each in chosen]
    if odd is not None:
        takes[odd] = pool.odd[kind]
    taken = [videos[random.integers(len(videos))] for videos in takes]
    names = _names(kind, chosen, random)
    paths = [Path(shutil.copy(path, folder / name)) for path, name in zip(taken, names, strict=True)]
    return VideoSet(kind, paths, chosen, odd)


def _names(kind: str, chosen: Sequence[int], random: np.random.Generator) -> list[str]:
    """File names of a set: as a phone names them, or the plan's with the first two swapped."""
    if kind == "names swapped":
        stated = [chosen[1], chosen[0], *chosen[2:]]
        return [f"s{number + 1}.mp4" for number in stated]
    numbers = random.choice(9000, size=len(chosen), replace=False)
    return [f"IMG_{1000 + number}.mp4" for number in numbers]
