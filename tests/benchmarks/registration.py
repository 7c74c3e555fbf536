"""Estimated tag places compared with ground truth: `make bench-registration` (ten minutes).

Boxes of 60 to 190 mm with a tag on each side, eight strikes over up to five edges, placed by hand: (1)
corners drawn with noise and a bias that depends on the pixel position, and once with all errors that the
solver allows for; and cans with eight cards on the flank, whose height over it is known or not, and eight
strikes over the rim; (2) corners from rendered images, through the tracker; (3) recordings of the virtual
rig, if any are named, compared with the places in their object files. (1) and (2) are made by tagged_boxes.py
and tagged_cans.py of tests/analyze/registration, which share no code with the solver.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

import click
import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table

from analyze.least_squares.intervals import SIGMAS_95
from analyze.registration.register import register
from analyze.registration.table import LAID_BOARD, UNKNOWN_TABLE
from tests.analyze.registration.tagged_boxes import ALLOWED, Draw, about, draw_box, errors, seen_strikes
from tests.analyze.registration.tagged_cans import draw_can, errors_but_turn, seen_tips

TARGET_TURN, TARGET_PLACE = math.radians(0.2), 3e-4


@dataclass
class Found:
    """Errors of estimated tag places in one row of the table: rotation [rad] and position [m] of each tag."""

    turn: list[float] = field(default_factory=list)
    place: list[float] = field(default_factory=list)
    by_sd: list[float] = field(default_factory=list)
    """each of the six errors (rotation, position) of each tag, over its sd"""
    undetermined: int = 0
    cases: int = 0

    def add(self, turn: np.ndarray, place: np.ndarray, covariance: np.ndarray) -> None:
        self.turn.append(float(np.linalg.norm(turn)))
        self.place.append(float(np.linalg.norm(place)))
        self.by_sd += (np.concatenate([turn, place]) / np.sqrt(np.diag(covariance))).tolist()

    def cells(self) -> list[str]:
        turn, place, by_sd = np.degrees(self.turn), 1000 * np.array(self.place), np.array(self.by_sd)
        within = np.mean((np.array(self.turn) <= TARGET_TURN) & (np.array(self.place) <= TARGET_PLACE))
        return [
            f"{self.cases}",
            f"{len(turn)}",
            f"{np.median(turn):.3f}, {np.percentile(turn, 95):.3f}, {turn.max():.3f}",
            f"{np.median(place):.3f}, {np.percentile(place, 95):.3f}, {place.max():.3f}",
            f"{100 * within:.0f} %",
            f"{math.sqrt(float(np.mean(by_sd**2))):.2f}",
            f"{100 * np.mean(np.abs(by_sd) < SIGMAS_95):.0f} %",
            f"{self.undetermined}",
        ]


def simulated(
    console: Console, cases: int, seed: int, rendered: bool, table: bool = False, draw: Draw | None = None
) -> tuple[Found, list[np.ndarray]]:
    """Errors of the tags, and for each case the table's error [rad, rad, m] and its sd."""
    found, tables = Found(cases=cases), []
    label = "rendered" if rendered else "table" if table else "drawn"
    for number in track(range(cases), console=Console(stderr=True), transient=True, description=label):
        rng = np.random.default_rng([seed, int(rendered), int(table), number])
        box = draw_box(rng)
        if table:
            box = replace(box, table=np.array([*rng.normal(0, math.radians(2.0), 2), rng.normal(0, 5e-3)]))
        views = seen_strikes(box, rng, draw=draw, rendered=rendered)
        answer = register(views, box.sizes, box.thickness, box.model, UNKNOWN_TABLE if table else LAID_BOARD)
        for left in answer.left_out:
            console.print(f"{label} {number}: left out: {left.strike_id}: {left.reason}")
        for place in answer.markers:
            if place.undetermined:
                found.undetermined += 1
            else:
                found.add(*errors(box, place), place.covariance)
        found_at = answer.tables[0]
        tables.append(np.stack([found_at.offset - box.table, found_at.sd]))
    return found, tables


def cans(console: Console, cases: int, seed: int, stands_off: float) -> Found:
    """Errors of the tags of cans whose cards stand off the flank by an unstated height [m], or touch it."""
    found, around = Found(cases=cases), range(0, 360, 45)
    for number in track(range(cases), console=Console(stderr=True), transient=True, description="cans"):
        rng = np.random.default_rng([seed, 5, round(1e6 * stands_off), number])
        can = draw_can(rng, around, stands_off, stated=0.0 if stands_off else None)
        answer = register(seen_tips(can, rng, around), can.sizes, can.thickness, can.model)
        for left in answer.left_out:
            console.print(f"can {number}: left out: {left.strike_id}: {left.reason}")
        known = [place for place in answer.markers if not place.undetermined]
        found.undetermined += len(answer.markers) - len(known)
        # The first one's turn about the axis defines O, and its error is 0.
        for place, turn, away in list(zip(known, *errors_but_turn(can, known), strict=True))[1:]:
            found.add(turn, away, place.covariance)
    return found


def recorded(paths: tuple[Path, ...]) -> Found:
    """Errors on recordings of the virtual rig, whose object files contain the true places of the tags."""
    found = Found(cases=len(paths))
    for path in paths:
        done = subprocess.run(
            [sys.executable, "-m", "analyze", "register", str(path), "--json"],
            capture_output=True,
            text=True,
            check=True,
        )
        from analyze.pipeline.read_evidence import read_head

        truth = {m.name: np.array(m.T_object_marker) for m in read_head(path).manifest.object.marker}
        for entry in json.loads(done.stdout)["markers"]:
            if not entry["observed"]:
                found.undetermined += 1
                continue
            T = np.array(entry["T_object_marker"])
            D = T[:3, :3] @ truth[entry["marker"]][:3, :3].T
            turn = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
            found.add(turn, T[:3, 3] - truth[entry["marker"]][:3, 3], np.array(entry["covariance"]))
    return found


def wrong_placements(cases: int, seed: int) -> tuple[int, int]:
    """Sessions in which a strike placed turned by 180 degrees is left out, and other strikes left out."""
    named = others = 0
    for number in track(
        range(cases), console=Console(stderr=True), transient=True, description="wrong placements"
    ):
        rng = np.random.default_rng([seed, 77, number])
        box = draw_box(rng, edges=2)
        views = seen_strikes(box, rng)
        wrong = int(rng.integers(len(views)))
        views[wrong] = replace(
            views[wrong], R_world_object=about([0, 0, 1], math.pi) @ views[wrong].R_world_object
        )
        left = {each.strike_id for each in register(views, box.sizes, box.thickness, box.model).left_out}
        named += views[wrong].strike_id in left
        others += len(left - {views[wrong].strike_id})
    return named, others


@click.command()
@click.argument("recordings", nargs=-1, type=click.Path(path_type=Path))
@click.option("--cases", default=40, show_default=True, help="Number of boxes with drawn corners.")
@click.option("--rendered", default=4, show_default=True, help="Number of boxes with rendered images.")
@click.option("--seed", default=1, show_default=True)
def main(recordings: tuple[Path, ...], cases: int, rendered: int, seed: int) -> None:
    """Register tags of simulated sessions and of named recordings, and print the errors of their places."""
    console = Console(width=170)
    table = Table(title="errors of the tags' places: median, 95 %, worst")
    for heading in (
        "",
        "cases",
        "tags",
        "rotation (deg)",
        "position (mm)",
        "within 0.2°, 0.3 mm",
        "rms of error / sd",
        "in 95 %",
        "undetermined",
    ):
        table.add_column(heading, justify="left" if not heading else "right")
    drawn, _ = simulated(console, cases, seed, rendered=False)
    table.add_row("drawn corners", *drawn.cells())
    free, tables = simulated(console, cases, seed, rendered=False, table=True)
    table.add_row("drawn corners, table unknown", *free.cells())
    worst, worst_tables = simulated(console, cases, seed, rendered=False, draw=ALLOWED)
    table.add_row("drawn corners, all errors allowed for", *worst.cells())
    table.add_row("cans, cards on the flank", *cans(console, cases // 2, seed, 0.0).cells())
    table.add_row("cans, cards 4 mm off", *cans(console, cases // 4, seed, 4e-3).cells())
    if rendered:
        table.add_row("rendered images", *simulated(console, rendered, seed, rendered=True)[0].cells())
    if recordings:
        table.add_row("virtual rig", *recorded(recordings).cells())
    console.print(table)
    off, sd = np.array(tables).transpose(1, 0, 2)
    tilt, height = np.degrees(np.abs(off[:, :2])), 1000 * np.abs(off[:, 2])
    console.print(
        f"table without a board in view (drawn: 2 deg, 5 mm): tilt error {np.median(tilt):.3f} deg (worst "
        f"{tilt.max():.3f}), height error {np.median(height):.3f} mm (worst {height.max():.3f}); rms of "
        f"error / sd {math.sqrt(float(np.mean((off / sd) ** 2))):.2f}, in 95 % intervals "
        f"{100 * np.mean(np.abs(off / sd) < SIGMAS_95):.0f} %"
    )
    off, sd = np.array(worst_tables).transpose(1, 0, 2)
    console.print(
        "all errors allowed for: the table's rms of error / sd "
        f"{math.sqrt(float(np.mean((off / sd) ** 2))):.2f}"
    )
    named, others = wrong_placements(20, seed)
    console.print(
        f"one of eight strikes placed turned by 180 deg: detected in {named} of 20 sessions; {others} other "
        "strikes left out"
    )


if __name__ == "__main__":
    main()
