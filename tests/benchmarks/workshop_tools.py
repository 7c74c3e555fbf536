"""Masses of the parts of real tools from their moments: `make bench-tools TOOLS=folder` (two minutes).

The true masses of a tool's parts are their volumes times their materials' densities, if these reproduce the
mass and centre of mass in the tool's own file within 1 % (of the mass; of the longest edge). The tool's mass,
centre of mass and six moments are drawn with errors (0.1 g, 0.5 mm along each axis, 1 % each), and the parts'
masses are estimated from them, many times. The masses for one common density are given for comparison. Tools
of one material, and those whose file is not reproduced, are listed with the reason.
"""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from analyze.errors import AnalyzeError
from analyze.estimation.labelled_parts import parts_of_bodies
from analyze.estimation.part_masses import MeasuredMoments, PartMasses, part_masses
from analyze.geometry.bodies import Body, bodies_of
from analyze.geometry.polyhedron import MassProperties
from schemas.object_spec import LengthUnit, MarkerSpec, ObjectSpec, Shape
from schemas.part_label import PartLabel

TABLE = Path(__file__).with_suffix(".toml")
MASS_SD_KG, COM_SD_M, MOMENT_SD = 1e-4, 5e-4, 0.01
MAX_FILE_DIFFERENCE = 0.01
AXES = np.vstack([np.eye(3), np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1]]) / math.sqrt(2)])
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Tool:
    """Tool with the true masses of its parts, and the mass and centre of mass in its own file."""

    name: str
    parts: list[tuple[str, MassProperties]]
    masses: Array
    """(n,) true masses [kg]"""
    file_mass: float
    file_com: Array
    """(3,) centre of mass in the file [m]"""
    size: float
    """length of the longest edge [m]"""
    open_edges: int

    @property
    def com(self) -> Array:
        return np.asarray(
            self.masses @ np.array([part.centroid for _, part in self.parts]) / self.masses.sum()
        )

    @property
    def file_difference(self) -> tuple[float, float]:
        """Differences from the tool's file: of mass (relative), and of centre of mass over the size."""
        return abs(self.masses.sum() / self.file_mass - 1), float(
            np.linalg.norm(self.com - self.file_com)
        ) / self.size

    def tensor(self) -> Array:
        tensor = np.zeros((3, 3))
        for mass, (_, part) in zip(self.masses, self.parts, strict=True):
            arm = part.centroid - self.com
            tensor += mass * (part.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm))
        return tensor


def read_tool(folder: Path, rows: dict[str, dict[str, object]], density: dict[str, float]) -> Tool:
    """Read one folder of the set with its rows of the table."""
    text = (folder / "inertia.yaml").read_text(encoding="utf-8")
    mass = float(re.search(r"MASS:\s*(\S+)", text)[1])  # type: ignore[index] - the set's own files have it
    numbers = re.search(r"COM_WRT_MESH:\s*\[(.*)\]", text)[1]  # type: ignore[index]
    com = np.array([float(value) for value in numbers.split(",")])
    labels = [PartLabel.model_validate({"name": name, "bodies": row["bodies"]}) for name, row in rows.items()]
    spec = ObjectSpec(
        name=folder.name,
        mass_kg=mass,
        mass_sd_kg=MASS_SD_KG,
        shape=Shape(file="mesh.ply", unit=LengthUnit.MILLIMETRE),
        marker=[MarkerSpec(id=0, size_m=0.02)],
    )
    bodies = bodies_of(spec, (folder / "mesh.ply").read_bytes(), "mesh.ply")
    parts = parts_of_bodies(labels, bodies, folder.name)
    masses = np.array([density[str(rows[name]["material"])] * solid.volume for name, solid in parts])
    return Tool(
        folder.name, parts, masses, mass, com, _longest(bodies), sum(body.open_edges for body in bodies)
    )


def _longest(bodies: list[Body]) -> float:
    corners = np.concatenate([body.vertices[body.faces].reshape(-1, 3) for body in bodies])
    return float(np.ptp(corners, axis=0).max())


def drawn(tool: Tool, rng: np.random.Generator) -> MeasuredMoments:
    """Moments of a tool with random errors."""
    about = np.einsum("ai,ij,aj->a", AXES, tool.tensor(), AXES)
    sd = np.concatenate([[MASS_SD_KG], np.full(3, COM_SD_M), MOMENT_SD * about])
    error = rng.normal(0, sd)
    return MeasuredMoments(
        float(tool.masses.sum() + error[0]), tool.com + error[1:4], AXES, about + error[4:], np.diag(sd**2)
    )


def rows_of(tool: Tool, found: list[PartMasses]) -> list[list[str]]:
    """Table rows of a tool, one per part."""
    masses = np.array([one.masses for one in found])
    intervals = np.array([one.intervals for one in found])
    covered = (intervals[..., 0] <= tool.masses) & (tool.masses <= intervals[..., 1])
    rows = []
    for i, (name, solid) in enumerate(tool.parts):
        rms = float(np.sqrt(np.mean((masses[:, i] - tool.masses[i]) ** 2)))
        observed = float(np.mean([one.observed[i] for one in found]))
        rows.append(
            [
                tool.name if i == 0 else "",
                name,
                f"{1e6 * solid.volume:.2f}",
                f"{1e3 * tool.masses[i]:.1f}",
                f"{1e3 * found[0].uniform[i]:.1f}",
                f"{1e3 * masses[:, i].mean():.1f}",
                f"{1e3 * rms:.1f}",
                f"{500 * float(np.median(intervals[:, i, 1] - intervals[:, i, 0])):.1f}",
                f"{np.mean(covered[:, i]):.0%}",
                f"{observed:.0%}",
            ]
        )
    return rows


def misplaced(masses: Array, truth: Array) -> float:
    """Fraction of the mass that is attributed to a wrong part."""
    return float(0.5 * np.abs(masses - truth).sum() / truth.sum())


@click.command()
@click.option(
    "--tools",
    type=click.Path(path_type=Path, exists=True, file_okay=False),
    required=True,
    help="Folder that contains a folder for each tool.",
)
@click.option("--draws", default=100, show_default=True, help="Number of draws of the errors.")
@click.option("--seed", default=1, show_default=True)
def main(tools: Path, draws: int, seed: int) -> None:
    """Estimate the parts of all tools and print the table."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    density = table.pop("density")
    console, left_out, summary = Console(width=150), list[str](), list[tuple[str, float, float, int]]()
    held, alarms, off_file = list[NDArray[np.bool_]](), list[float](), list[tuple[float, float]]()
    shown = Table(
        title=f"Masses of parts, {draws} draws of 0.1 g, 0.5 mm and 1 % (seed {seed})", box=SIMPLE_HEAD
    )
    for name in (
        "tool",
        "part",
        "cm3",
        "ground truth (g)",
        "one density",
        "estimate",
        "rms error",
        "half-width",
        "in 95 %",
        "observable",
    ):
        shown.add_column(name, justify="left" if name in {"tool", "part"} else "right")
    for number, (name, rows) in enumerate(sorted(table.items())):
        console.print(f"{name} ...", end="\r")
        try:
            tool = read_tool(tools / name, rows, density)
        except (OSError, AnalyzeError) as error:
            left_out.append(f"{name}: {error}")
            continue
        by_mass, by_com = tool.file_difference
        if max(by_mass, by_com) > MAX_FILE_DIFFERENCE:
            left_out.append(
                f"{name}: its file differs by {by_mass:.1%} of the mass, and by {by_com:.1%} of the size in "
                "the centre of mass"
            )
            continue
        if len({row["material"] for row in rows.values()}) < 2:
            left_out.append(f"{name}: only one material (reproduced to {by_mass:.1%}, {by_com:.1%})")
            continue
        rng = np.random.default_rng([seed, number])
        names, solids = [part for part, _ in tool.parts], [solid for _, solid in tool.parts]
        found = [part_masses(drawn(tool, rng), names, solids, rng) for _ in range(draws)]
        for row in rows_of(tool, found):
            shown.add_row(*row)
        wrong = float(np.median([misplaced(one.masses, tool.masses) for one in found]))
        summary.append((name, wrong, misplaced(found[0].uniform, tool.masses), tool.open_edges))
        intervals = np.array([one.intervals for one in found])
        held.append((intervals[..., 0] <= tool.masses) & (tool.masses <= intervals[..., 1]))
        alarms.append(float(np.mean([not one.explained for one in found])))
        off_file.append((by_mass, by_com))
    console.print(shown)
    console.print(
        f"all tools: intervals hold {np.concatenate([each.ravel() for each in held]).mean():.1%}; mass in the"
        f" wrong part {np.median([ours for _, ours, _, _ in summary]):.1%} (median; worst"
        f" {max(ours for _, ours, _, _ in summary):.1%}); unexplained in {np.mean(alarms):.1%} of draws;"
        f" file's mass within {max(by_mass for by_mass, _ in off_file):.1%}, its centre of mass within"
        f" {max(by_com for _, by_com in off_file):.1%} of the size"
    )
    for name, ours, uniform, open_edges in summary:
        seams = f" (mesh open at {open_edges} edges)" if open_edges else ""
        console.print(f"{name}: mass in the wrong part {ours:.1%}, of one density {uniform:.1%}{seams}")
    for line in left_out:
        console.print(f"left out: {line}")


if __name__ == "__main__":
    main()
