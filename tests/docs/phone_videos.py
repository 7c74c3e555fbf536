"""Videos that a user of the phone road films: board, board on the table, and the strikes of a plan."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np

from tests import make_phone_videos as renderer
from tests.places import ROOT

TEABOX = ROOT / "docs" / "examples" / "teabox.toml"


def write_boards(folder: Path) -> None:
    """Write `board.mp4`, and `table.mp4` with the board that stands on the table."""
    random = np.random.default_rng(5)
    renderer.write_video(folder / "board.mp4", renderer.board_images(random))
    renderer.write_video(folder / "table.mp4", renderer.table_images(random))


def write_strikes(folder: Path) -> None:
    """Write `<id>.mp4` of each strike of `folder`'s plan; the tags are where the example's file has them."""
    random = np.random.default_rng(6)
    sides = renderer.box_sides(tomllib.loads(TEABOX.read_text(encoding="utf-8")), random)
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    for strike in plan["strikes"]:
        images = renderer.strike_images(sides, strike, random)
        renderer.write_video(folder / f"{strike['id']}.mp4", images)
