"""Videos of virtual sessions without their plan: edges found, centre of mass beside that with the plan.

`make bench-unplanned` renders 20 sessions of five objects (box, cylinder, frustum, L, wedge): six strikes
each in two headings, the object up to 50 mm off the line along and across it, put down by hand, the line up
to 8 degrees off the camera's direction, files shuffled and named as a phone names them. Each is imported with
its plan, which has the mean heading of each edge as made, and without; every second time the camera's pose is
not given either. At last the true edge is taken from the possible ones: the strike must then be refused.
"""

from __future__ import annotations

import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from click.testing import CliRunner

from analyze.cli import main as analyze
from analyze.errors import ImportRefused
from analyze.geometry.rotations import inverse_transform
from analyze.importing.edge_matches import match_edges
from analyze.importing.matching import TipInView
from analyze.importing.options import ImportOptions
from analyze.importing.prepare import prepare
from analyze.importing.write_recording import write_recording
from analyze.planning.possible_tips import PossibleTips
from tests.analyze.importing.unplanned_sessions import (
    SHAPES,
    Session,
    seen_view,
    session,
    turned_by,
    without,
    write_files,
    write_videos,
)

SESSIONS = 20
MAX_DIFFERENCE_MM = 0.02
"""largest difference of the centre of mass with and without the plan [mm]"""


@dataclass(frozen=True)
class Outcome:
    """What came out of one session."""

    right: int
    """strikes assigned to their edge"""
    wrong: int
    """strikes assigned to another edge"""
    refusal: str
    """line with which the import was refused; "" if it was not"""
    difference_mm: float | None
    """distance of the centres of mass with and without the plan [mm]; None if refused"""
    error_mm: float | None
    """distance of the one without the plan from the true one [mm]"""


def run(one: Session, seed: int, folder: Path) -> Outcome:
    """Import and estimate the videos of a session with its plan, and without."""
    paths, order = write_videos(one, folder, seed)
    files = write_files(one, folder, placed=True)
    named = tuple(one.plan.strikes[number].id for number in order)
    with prepare(
        ImportOptions(tuple(paths), files["object"], files["plan"], files["camera"], named)
    ) as prepared:
        write_recording(prepared, folder / "with.mcap")
    if seed % 2:
        files = write_files(one, folder, placed=False)
    axes = [one.plan.strikes[number].axis_id for number in order]
    try:
        with prepare(ImportOptions(tuple(paths), files["object"], None, files["camera"])) as prepared:
            found = [strike.axis_id for strike in prepared.plan.strikes]
            write_recording(prepared, folder / "without.mcap")
    except ImportRefused as refused:
        return Outcome(0, 0, str(refused), None, None)
    planned, free = (estimated_com(folder / f"{name}.mcap") for name in ("with", "without"))
    right = sum(a == b for a, b in zip(axes, found, strict=True))
    difference, error = (1000 * float(np.linalg.norm(free - com)) for com in (planned, one.com))
    return Outcome(right, len(axes) - right, "", difference, error)


def estimated_com(path: Path) -> np.ndarray:
    """Centre of mass (3,) [m] by `analyze estimate` for a recording."""
    done = CliRunner().invoke(
        analyze, ["estimate", str(path), "--json", "--no-cache"], catch_exceptions=False
    )
    return np.array(json.loads(done.stdout)["centre_of_mass"]["value"])


def wrong_edges(one: Session, seed: int) -> tuple[int, int]:
    """Strikes that are refused after their edge was taken from the possible ones, and all strikes."""
    random, refused = np.random.default_rng(seed), 0
    possible = PossibleTips(one.model, one.spec)
    up = one.camera.T_world_camera[2, :3]
    for number, strike in enumerate(one.plan.strikes):
        T = inverse_transform(one.camera.T_world_camera) @ one.placed[number] @ turned_by(strike, 0.0)
        view = seen_view(T, np.array(strike.pivot.direction), np.array(strike.pivot.point), random)
        seen = TipInView("a.mp4", view)
        try:
            match_edges([seen], [None], without(possible, strike.axis_id), one.spec, up)
        except ImportRefused:
            refused += 1
    return refused, len(one.plan.strikes)


def main(sessions: int) -> int:
    """Print a line per session; exit code 1 if an edge is wrong, or c differs from that with the plan."""
    bad = 0
    click.echo(f"{'object':9} seed  right wrong  c: with - without, error  refused of wrong edges")
    for number in range(sessions):
        shape, seed = SHAPES[number % len(SHAPES)], number + 1
        one = session(shape, seed)
        with tempfile.TemporaryDirectory() as folder:
            found = run(one, seed, Path(folder))
        refused, all_of = wrong_edges(one, seed)
        shown = found.refusal
        if found.difference_mm is not None:
            shown = f"{found.difference_mm:.4f} mm, {found.error_mm:.2f} mm"
        counts = f"{found.right:6} {found.wrong:5}"
        click.echo(f"{shape:9} {seed:4} {counts}  {shown:24} {refused} of {all_of}")
        apart = (found.difference_mm or 0.0) > MAX_DIFFERENCE_MM
        bad += bool(found.wrong or refused < all_of or apart)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else SESSIONS))
