"""`analyze parts`: list the bodies of an object's mesh, with the numbers that its labels use.

A label ([[labels]] in the object file) names a part of the object and the bodies that it consists of.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.errors import ShapeError
from analyze.verbs.options import one_line
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.geometry.bodies import Body
    from analyze.reading.object_file import ObjectFiles
    from schemas.terminal import Terminal

_MILLI, _CUBIC_CM = 1e3, 1e6


@click.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def parts(object_file: Path, as_json: bool) -> None:
    """List the bodies in an object's mesh, with the numbers by which its [[labels]] name them."""
    files, bodies = read_bodies(object_file)
    if as_json:
        echo(json.dumps(bodies_json(files, bodies), allow_nan=False))
    else:
        render_bodies(files, bodies)


def read_bodies(path: Path) -> tuple[ObjectFiles, list[Body]]:
    """Read an object file and find the bodies (connected parts) of its mesh.

    Args:
        path: the object file (TOML).

    Returns:
        The object file with its shape, and the bodies, largest first, which labels number from 1; a body need
        not be closed (`open_edges`).

    Raises:
        ShapeError: the object file or its shape cannot be used, the shape is no mesh, or a label names a body
            that does not exist.
    """
    from analyze.geometry.bodies import bodies_of
    from analyze.reading.object_file import read_object_files

    files = read_object_files(path)
    bodies = bodies_of(files.spec, files.shape_bytes, files.shape_name)
    for label in files.spec.labels or []:
        if beyond := [number for number in label.bodies if number > len(bodies)]:
            raise ShapeError(
                f"{path}: part {label.name!r} names body {beyond[0]}, but {files.shape_name} has "
                f"{len(bodies)}"
            )
    return files, bodies


def render_bodies(files: ObjectFiles, bodies: list[Body], console: Terminal | None = None) -> None:
    """Print the bodies as a table: number, volume [cm^3], centroid and size [mm], and the labelled part.

    Bodies that overlap are named below it. A hint on labels follows if there is one body, or if no body is
    labelled.

    Args:
        files: the object file with its shape.
        bodies: bodies of the mesh, largest first.
        console: where to print; None for standard output.
    """
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from analyze.geometry.bodies import overlaps_of
    from schemas.terminal import Terminal

    console = console or Terminal()
    part_of = _part_of_body(files)
    table = Table(title=f"Bodies of {files.shape_name}", title_justify="left", box=SIMPLE_HEAD)
    for name in ("body", "volume (cm³)", "middle x, y, z (mm)", "size (mm)", "part"):
        table.add_column(name, justify="left" if name == "part" else "right", no_wrap=True)
    for number, body in enumerate(bodies, 1):
        corners = body.vertices[body.faces].reshape(-1, 3)
        size = corners.max(axis=0) - corners.min(axis=0)
        table.add_row(
            str(number),
            f"{_CUBIC_CM * body.properties.volume:.3f}",
            ", ".join(f"{_MILLI * value:.1f}" for value in body.properties.centroid),
            " x ".join(f"{_MILLI * value:.0f}" for value in size),
            part_of.get(number, "–") + _repair_text(body),
        )
    console.print(table)
    for one in overlaps_of(bodies):
        share = one.volume / min(bodies[number - 1].properties.volume for number in one[:2])
        console.print(
            f"bodies {one.first} and {one.second} overlap by about {_CUBIC_CM * one.volume:.2g} cm³"
            f" ({100 * share:.2g} % of the smaller one): it counts in both"
        )
    if len(bodies) < 2:
        console.print(
            "one body: its parts can only be the wall and layers (`wall = true`, `between_m` in the object "
            "file's labels)"
        )
    elif not part_of:
        console.print("label them in the object file, bodies of one material together:")
        console.print('  [[labels]]\n  name = "handle"\n  bodies = [1]')


def _repair_text(body: Body) -> str:
    """Remark on a body that is not closed, or whose holes were closed; empty if there is none."""
    if body.open_edges:
        return f" (not closed: {counted(body.open_edges, 'open edge')}; it cannot be a part)"
    return f" (holes of {counted(body.filled_edges, 'edge')} closed)" if body.filled_edges else ""


def bodies_json(files: ObjectFiles, bodies: list[Body]) -> list[dict[str, object]]:
    """Bodies as JSON values, one entry each, in SI units and the object frame O.

    `unit_inertia_m2` is the inertia (3, 3) about the centroid per kilogram; `part` is None for a body without
    a label.

    Args:
        files: the object file with its shape.
        bodies: bodies of the mesh, largest first.
    """
    part_of = _part_of_body(files)
    return [
        {
            "body": number,
            "volume_m3": body.properties.volume,
            "centroid_m": body.properties.centroid.tolist(),
            "unit_inertia_m2": body.properties.unit_inertia.tolist(),
            "open_edges": body.open_edges,
            "part": part_of.get(number),
        }
        for number, body in enumerate(bodies, 1)
    ]


def _part_of_body(files: ObjectFiles) -> dict[int, str]:
    """Name of the part that each labelled body belongs to, by the body's number (from 1)."""
    return {number: label.name for label in files.spec.labels or [] for number in label.bodies}
