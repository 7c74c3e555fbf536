"""`analyze shape`: the exterior of an object as all other commands take it, with its repairs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.options import one_line, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.geometry.object_model import ObjectModel
    from schemas.object_spec import ObjectSpec

_STL_RECORD = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
_MILLI, _CUBIC_CM = 1e3, 1e6


@click.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@path_option("-o", "--output", help="Also write the exterior as a binary STL file, in millimetres.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def shape(object_file: Path, output: Path | None, as_json: bool) -> None:
    """Check the shape of OBJECT (TOML): size, volume, density, and what was repaired in its shape file."""
    from analyze.geometry.object_model import load_object_model
    from analyze.planning.view import refuse_off_surface
    from analyze.reading.object_file import read_object_files
    from schemas.output_file import write_bytes
    from schemas.wording import counted

    refuse_outputs([output], inputs=[object_file])
    files = read_object_files(object_file)
    if files.spec.shape.file is not None:
        refuse_outputs([output], inputs=[object_file.parent / files.spec.shape.file])
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    refuse_off_surface(model, files.spec)
    if output is not None:
        write_bytes(output, exterior_stl(model))
    found = describe_shape(model, files.spec)
    if as_json:
        echo(json.dumps(found, allow_nan=False))
        return
    size = " x ".join(f"{_MILLI * length:.1f}" for length in found["size_m"])
    echo(f"{found['name']}: {size} mm, {_CUBIC_CM * found['volume_m3']:.4g} cm³")
    faces = counted(found["faces"], "face")
    echo(f"mean density {found['density_kg_m3']:.0f} kg/m³, {faces}, {found['form']}")
    for note in found["notes"]:
        echo(f"note: {note}")


def describe_shape(model: ObjectModel, spec: ObjectSpec) -> dict[str, Any]:
    """Size, volume, mean density and notes of an object's exterior, as JSON values in SI units.

    Args:
        model: exterior of the object, in the object frame O.
        spec: content of the object file, for the mass.
    """
    return {
        "name": spec.name,
        "size_m": model.extent.tolist(),
        "volume_m3": model.volume,
        "centroid_m": model.centroid.tolist(),
        "density_kg_m3": spec.mass_kg / model.volume,
        "faces": len(model.faces),
        "form": "convex" if model.is_convex else "with hollows",
        "notes": list(model.warnings),
    }


def exterior_stl(model: ObjectModel) -> bytes:
    """Exterior of an object as a binary STL file in millimetres, in the object frame O, normals outward."""
    import numpy as np

    corners = model.vertices[model.faces] * _MILLI
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    records = np.zeros(len(corners), dtype=_STL_RECORD)
    records["corners"] = corners
    records["normal"] = normals / np.where(lengths > 0, lengths, 1.0)
    return bytes(80) + len(corners).to_bytes(4, "little") + records.tobytes()
