"""Write a model folder for Gazebo: `model.config`, `model.sdf` and, below `meshes`, the mesh.

The mesh is addressed as `model://FOLDER/meshes/NAME`, which Gazebo resolves in the folders of
GZ_SIM_RESOURCE_PATH, or of GAZEBO_MODEL_PATH in the versions up to 11.
"""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from analyze.export.mesh import mesh_file
from analyze.export.provenance import printable
from analyze.export.sdf import VERSION, sdf_text
from analyze.export.xml_text import child
from schemas.output_file import OutputError, refuse_unwritable

if TYPE_CHECKING:
    from pathlib import Path

    from analyze.export.body import ExportBody

MODEL, CONFIG, MESHES = "model.sdf", "model.config", "meshes"


def refuse_other_folder(output: Path) -> None:
    """Raise OutputError unless a model folder can be made at `output`, or one of Gazebo is there already.

    Raises:
        OutputError: the folder above is missing or read-only, or at `output` is a file or a folder of other
            content.
    """
    refuse_unwritable(output / CONFIG if output.is_dir() else output)
    if output.is_file():
        raise OutputError(f"{output}: is a file: name a folder for the Gazebo model")
    if output.is_dir() and any(output.iterdir()) and not (output / CONFIG).is_file():
        raise OutputError(f"{output}: holds other files, and no {CONFIG}: name a new folder for the model")


def stage_model(body: ExportBody, folder: Path) -> list[Path]:
    """Write the files of a model into a new folder, whose name becomes the model's in all addresses.

    Args:
        body: exported body.
        folder: new folder; its name is that of the final one.

    Returns:
        Files relative to the folder, in the order in which they are to be put in place: each one after those
        that it names.
    """
    mesh = mesh_file(body)
    folder.mkdir()
    files = []
    if mesh is not None:
        (folder / MESHES).mkdir()
        (folder / MESHES / mesh.name).write_bytes(mesh.data)
        files.append(folder / MESHES / mesh.name)
    address = f"model://{folder.name}/{MESHES}/"
    (folder / MODEL).write_text(sdf_text(body, mesh, address), encoding="utf-8")
    (folder / CONFIG).write_text(_config_text(body), encoding="utf-8")
    return [each.relative_to(folder) for each in (*files, folder / MODEL, folder / CONFIG)]


def _config_text(body: ExportBody) -> str:
    root = ET.Element("model")
    child(root, "name", body.identifier)
    child(root, "version", "1.0")
    child(root, "sdf", MODEL, version=VERSION)
    written_by = body.provenance.get("written_by", "percuss")
    child(
        root, "description", f"{printable(body.name)}: {body.inertial.mass:.6g} kg, estimated by {written_by}"
    )
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
