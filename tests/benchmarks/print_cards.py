"""Strikes of untagged objects that were put down by another card: `make bench-print-cards`.

A strike is filmed once for each way in which the plan puts the object down, and analysed as if it had been
put down by each of the others. theta does not depend on the card, so that only the outline can tell, or,
where both cards show one outline, the print of other strikes.
"""

from __future__ import annotations

import math
from concurrent.futures import ProcessPoolExecutor

import click
import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from acquire.virtual.world import World
from analyze.geometry.station import turned_camera
from analyze.tracking.camera_model import project_ideal, world_to_camera
from schemas.strike_plan import PlannedStrike
from tests.benchmarks.print_sessions import Scene, analyse, chosen, renderer_of, scene
from tests.benchmarks.print_strikes import Filming, Placement, film, struck

PUT_DOWN = Placement(math.radians(0.6), 1e-3, -1e-3)
SAME_OUTLINE = 0.02
"""difference of two outlines in the image, over their area, up to which they count as the same"""


def judged(case: tuple[str, int]) -> list[tuple[str, str, bool, bool, bool]]:
    """Object, strike and card, whether the card is the right one, the outline the same, the strike good."""
    name, seed = case
    cv2.setNumThreads(1)
    rng = np.random.default_rng((seed, 0xCA2D, *name.encode()))
    on = scene(name, seed, False, rng)
    world = World(on.thing, lambda *_: 0.0, table_tilt=(0.0, on.tilt), arm_angle=-2.5)
    renderer = renderer_of(on, "print", seed)
    cards = {
        tuple(np.round(np.ravel(each.R_world_object), 2)): each
        for each in reversed(chosen(on.plan, len(on.plan.strikes)))
    }
    rows: list[tuple[str, str, bool, bool, bool]] = []
    for filmed in cards.values():
        motion = struck(world, on.thing, filmed, PUT_DOWN, (1.15, 0.003))
        frames = film(renderer, motion, filmed.heading_rad, Filming(), np.random.default_rng(seed))
        for card in cards.values():
            row, _ = analyse(on, "print", card, motion, frames)
            alike = difference(on, filmed, card) < SAME_OUTLINE
            rows.append((name, f"{filmed.id} as {card.id}", filmed is card, alike, row.usable))
    return rows


def difference(on: Scene, one: PlannedStrike, other: PlannedStrike) -> float:
    """Area in the image that one planned outline covers and the other does not, over the first one's."""
    masks: list[np.ndarray] = []
    for planned in (one, other):
        camera = turned_camera(on.camera, planned.heading_rad)
        R, t = world_to_camera(camera)
        placed = on.model.vertices @ np.array(planned.R_world_object).T + planned.p_world_object
        pixels = np.rint(project_ideal(camera, placed @ R.T + t)).astype(np.int32)
        mask = np.zeros((camera.height, camera.width), np.uint8)
        for triangle in on.model.faces:
            cv2.fillConvexPoly(mask, pixels[triangle], 1)
        masks.append(mask)
    return float(np.sum(masks[0] != masks[1])) / float(masks[0].sum())


@click.command()
@click.option("--objects", default="carton,parcel,juice", show_default=True, help="Comma-separated.")
@click.option("--seeds", default=1, show_default=True)
@click.option("--workers", default=2, show_default=True)
def main(objects: str, seeds: int, workers: int) -> None:
    """Print how many strikes by each kind of card are called good."""
    cases = [(name, seed) for seed in range(1, seeds + 1) for name in objects.split(",")]
    with ProcessPoolExecutor(workers) as pool:
        rows = [row for part in pool.map(judged, cases) for row in part]
    table = Table("object", "card", "strikes", "good", title="strikes of untagged objects, by card")
    for name in objects.split(","):
        for title, right, alike in (
            ("right", True, True),
            ("same outline", False, True),
            ("other", False, False),
        ):
            mine = [row for row in rows if row[0] == name and row[2] is right and row[3] is alike]
            table.add_row(name, title, f"{len(mine)}", f"{sum(row[4] for row in mine)}")
    console = Console(width=100, highlight=False)
    console.print(table)
    for row in rows:
        if row[4] is not (row[2] or row[3]):
            console.print(f"{row[0]}, {row[1]}: {'good' if row[4] else 'refused'}")


if __name__ == "__main__":
    main()
