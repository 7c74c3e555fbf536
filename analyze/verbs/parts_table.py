"""`analyze parts`: the closed bodies of an object's mesh, numbered as its labels name them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from analyze.errors import ShapeError
from analyze.geometry.bodies import Body, bodies_of
from analyze.reading.object_file import ObjectFiles, object_files

if TYPE_CHECKING:
    from pathlib import Path

_MILLI, _CUBIC_CM = 1e3, 1e6


def bodies_in(path: Path) -> tuple[ObjectFiles, list[Body]]:
    """The bodies of the object file's mesh, largest first.

    Raises:
        ShapeError: the object file or its shape cannot be used, or a label names a body that is not there.
    """
    files = object_files(path)
    bodies = bodies_of(files.spec, files.shape_bytes, files.shape_name)
    for label in files.spec.labels or []:
        if beyond := [number for number in label.bodies if number > len(bodies)]:
            raise ShapeError(f"{path}: part {label.name!r} names body {beyond[0]}, but {files.shape_name} has {len(bodies)}")
    return files, bodies


def render_bodies(files: ObjectFiles, bodies: list[Body], console: Console | None = None) -> None:
    """Print them with volume, centroid, size and the part that they are labelled as."""
    console = console or Console(highlight=False)
    named = {number: label.name for label in files.spec.labels or [] for number in label.bodies}
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
            named.get(number, "–") + (f" (open at {body.open_edges} edges)" if body.open_edges else ""),
        )
    console.print(table)
    if len(bodies) < 2:
        console.print("one body: its parts can be the wall and layers only (`wall = true`, `between_m` in the object file's labels)")
    elif not named:
        console.print("label them in the object file, bodies of one material together:")
        console.print('  [[labels]]\n  name = "handle"\n  bodies = [1]', markup=False)


def bodies_json(files: ObjectFiles, bodies: list[Body]) -> list[dict[str, object]]:
    """The same for scripts; SI, in O."""
    named = {number: label.name for label in files.spec.labels or [] for number in label.bodies}
    return [
        {
            "body": number,
            "volume_m3": body.properties.volume,
            "centroid_m": body.properties.centroid.tolist(),
            "unit_inertia_m2": body.properties.unit_inertia.tolist(),
            "open_edges": body.open_edges,
            "part": named.get(number),
        }
        for number, body in enumerate(bodies, 1)
    ]
