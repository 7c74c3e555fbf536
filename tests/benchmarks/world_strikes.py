"""Whether strikes that a plan refuses truly fail: `make bench-world-strikes`.

For the clean mesh of each shape of `tests/world` the pivot axes that `analyze plan` refuses are struck in the
virtual rig's physics, with the object's true mass distribution, at the friction that the plan assumes: at the
place and with the energies that the planner would use. A strike succeeds if the object passes balance over
this edge, and the edge neither slides nor leaves the table before. Axes that the planner uses are struck too.
"""

from __future__ import annotations

import csv
import os
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from rich.console import Console
from rich.progress import track

from acquire.virtual.convex_parts import ConvexParts
from acquire.virtual.hidden import HiddenBody
from acquire.virtual.objects import VirtualObject
from analyze.errors import AnalyzeError
from analyze.geometry.object_model import load_object_model
from analyze.planning import impact
from analyze.planning.feasibility import strike_case
from analyze.planning.pivots import PivotAxis, pivot_axes, swing
from analyze.planning.prepared import PreparedObject, prepare_object
from analyze.reading.object_file import read_object_files
from analyze.verbs.plan.rig import planned_rig
from tests.analyze.planning.simulated_strikes import Bench, G, Trial, strike
from tests.places import ROOT
from tests.world.catalogue import make, names
from tests.world.object_files import write_object
from tests.world.pieces import convex_pieces
from tests.world.shapes import WorldShape

TABLE = ROOT / "docs" / "reference" / "world-strikes.csv"
ENERGIES = (1.15, 1.3)
TRIED = frozenset({"slips", "lifts", "too_steep", "no_balance", "next_edge", "impact_unreachable"})
"""codes of rejected axes that are struck"""
PER_CODE = 3
"""largest number of axes per shape and code"""
EDGE_RADIUS_M = 5e-4
"""rounding of the edges in the simulation [m], as the planner expects where none is stated"""


@dataclass(frozen=True)
class Outcome:
    """Result of the strikes over one pivot axis of a shape: a row of the table."""

    shape: str
    household: bool
    axis: str
    code: str
    """reason of the rejection, or "usable" """
    phi_deg: float
    """balance angle of the true centre of mass"""
    outcome: str
    """tips (over this edge, past balance), slips, lifts, rocks back, or "not struck" if nothing can be met"""


def virtual_object(shape: WorldShape, path: Path, friction: float) -> VirtualObject:
    """Object of the virtual rig with a world shape's true mass distribution, its mesh and convex pieces."""
    files = read_object_files(path)
    mass, com, inertia = shape.mass_properties()
    body = HiddenBody(mass, com, inertia, (mass, 0.0, 0.0), (np.array([0.0, 0, 1]), 0.0), 1e-3)
    vertices = 1e-3 * shape.vertices
    parts = tuple(
        1e-3 * np.asarray(piece.to_mesh().vert_properties[:, :3], float) for piece in convex_pieces(shape)
    )
    return VirtualObject(
        spec=files.spec,
        spec_toml="",
        shape_file=None,
        mesh_vertices=vertices,
        mesh_faces=shape.faces,
        hull_vertices=vertices,
        convex_parts=parts,
        edge_radius_m=EDGE_RADIUS_M,
        friction=friction,
        body=body,
        drawn_parts=ConvexParts(parts, np.zeros((0, 4))),
    )


def try_shape(name: str, seed: int) -> list[Outcome]:
    """Strike the refused axes of a shape, and some of those that are used; empty if it cannot be read."""
    shape = make(name, seed)
    rng = np.random.default_rng([seed, 9, *name.encode()])
    with TemporaryDirectory() as folder:
        path = write_object(shape, "cad", Path(folder))
        files = read_object_files(path)
        try:
            model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
            rig = planned_rig(None)
            prepared = prepare_object(model, files.spec, rig.bench, rig.errors)
        except AnalyzeError:
            return []
        thing = virtual_object(shape, path, rig.bench.friction)
    codes = {each.axis_id: each.code for each in prepared.rejected if each.code in TRIED}
    codes |= {each.candidate.axis.id: "usable" for each in prepared.usable}
    axes = [
        axis for axis in pivot_axes(model, files.spec, prepared.planes, prepared.believed) if axis.id in codes
    ]
    rng.shuffle(axes)  # type: ignore[arg-type]
    found, done = list[Outcome](), Counter[str]()
    on = Bench(thing, model, tuple(axes))
    for axis in axes:
        code = codes[axis.id]
        if done[code] == PER_CODE or axis.plane.margin(thing.body.com_object[None]) < 0.001:
            continue
        done[code] += 1
        phi, outcome = _outcome(on, axis, prepared)
        found.append(
            Outcome(name, shape.is_household, axis.id, code, round(float(np.degrees(phi)), 1), outcome)
        )
    return found


def _outcome(on: Bench, axis: PivotAxis, prepared: PreparedObject) -> tuple[float, str]:
    """Balance angle of the true centre of mass [rad], and the best outcome over the energies."""
    body = on.thing.body
    unit = body.inertia_com / body.mass_kg
    expected = swing(axis, body.com_object, body.mass_kg, unit, G)
    if (axis.point - body.com_object) @ axis.plane.up >= 0:
        return expected.phi, "rocks back"
    bench = prepared.bench
    points = impact.impact_points(on.model, axis, [expected], [], bench.striker)
    point = impact.best_impact(points, bench.friction)
    if point is None:
        return expected.phi, "not struck"
    outcome = "not struck"
    for energy in ENERGIES:
        impulse = impact.impulse_for(expected, point.height, energy)
        case = strike_case(axis, expected, body.com_object, unit, point.height, impulse, bench.friction)
        trial = Trial(axis, expected, point, energy, bench.friction, True, case)
        try:
            seen = strike(on, trial)
        except (ValueError, RuntimeError):  # the arm cannot reach so high or so low
            continue
        if seen is None:
            continue
        outcome = "tips" if seen.outcome == "holds" and seen.over else seen.outcome
        if outcome == "holds":
            outcome = "rocks back"
        if outcome == "tips":
            break
    return expected.phi, outcome


@click.command()
@click.option("--shapes", default="", help="Comma-separated names; every third shape if left out.")
@click.option("--seed", default=1, show_default=True)
@click.option("--workers", default=os.cpu_count() or 1, show_default=True)
@click.option("-o", "--output", type=click.Path(path_type=Path), default=TABLE, show_default=True)
def main(shapes: str, seed: int, workers: int, output: Path) -> None:
    """Strike refused axes in the virtual rig's physics, and print how many fail."""
    console = Console(width=120)
    chosen = [each for each in names() if each in shapes.split(",")] if shapes else names()[::3]
    with ProcessPoolExecutor(workers) as pool:
        futures = [pool.submit(try_shape, name, seed) for name in chosen]
        rows = [
            row
            for each in track(futures, console=Console(stderr=True), transient=True)
            for row in each.result()
        ]
    with output.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Outcome)], lineterminator="\n")
        writer.writeheader()
        writer.writerows({**asdict(row), "household": int(row.household)} for row in rows)
    counts = Counter((row.code, row.outcome) for row in rows)
    for code in sorted({row.code for row in rows}):
        struck = {outcome: many for (each, outcome), many in counts.most_common() if each == code}
        tried = sum(many for outcome, many in struck.items() if outcome != "not struck")
        fail = tried - struck.get("tips", 0)
        console.print(f"{code:18s} {fail} of {tried} fail; {struck}", highlight=False)


if __name__ == "__main__":
    main()
