"""Write a body's file and mesh: into a temporary folder, read back, compared, then put in place."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import numpy as np

from analyze.errors import ExportError
from analyze.export.body import ExportBody, Inertial
from analyze.export.formats import Format
from analyze.export.gazebo import refuse_other_folder, stage_model
from analyze.export.mesh import MeshFile, mesh_file
from analyze.export.mjcf import mjcf_text
from analyze.export.read_back import read_back
from analyze.export.ros import ros_text
from analyze.export.sdf import sdf_text
from analyze.export.urdf import urdf_text
from analyze.export.usd import write_usd
from schemas.output_file import OutputError, refuse_unwritable


def write_body(body: ExportBody, wanted: Format, output: Path) -> list[Path]:
    """Write a body for a simulator, and check the file by reading it back with another library.

    If the check fails, existing files stay as they were.

    Args:
        body: exported body.
        wanted: format of the file.
        output: the file, or the folder of a Gazebo model; the folder above it must exist.

    Returns:
        Files written: `output`, then the mesh unless the shape is a box or cylinder, or the format USD or a
        ROS message, which has no shape.

    Raises:
        ExportError: the library that reads the format is missing, cannot read the file, or does not find the
            same mass, centre of mass and inertia.
        OutputError: a file cannot be written.
    """
    if wanted is Format.GAZEBO:
        return _write_folder(body, output)
    refuse_unwritable(output)
    mesh = None if wanted in {Format.USD, Format.ROS} else mesh_file(body)
    try:
        # Below the output's folder, so that putting in place is a rename; in a folder of its own, so that the
        # mesh can have its final name.
        with tempfile.TemporaryDirectory(dir=output.parent, prefix=f".{output.name}.") as folder:
            staged = Path(folder) / f"body{output.suffix or wanted.suffixes[0]}"
            _write(body, wanted, staged, mesh)
            refuse_changed_parameters(body.inertial, read_back(staged, wanted), wanted)
            return _put_in_place(staged, output, mesh)
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error.strerror}: choose another place") from None


def refuse_changed_parameters(written: Inertial, found: Inertial, where: Format) -> None:
    """Raise ExportError if a file was read back with other inertial parameters than were written.

    The mass is compared relative to itself, the inertia tensor I relative to its largest entry, the centre of
    mass relative to its largest coordinate or to the radius of gyration sqrt(tr I / 2m), whichever is larger.

    Args:
        written: parameters that were written.
        found: parameters that were read back.
        where: format of the file, which gives the tolerance.

    Raises:
        ExportError: one of them differs by more than the format's tolerance, or is not a number.
    """
    arm = float(np.sqrt(np.trace(written.inertia) / (2 * written.mass)))
    pairs = (
        ("mass", np.array(written.mass), np.array(found.mass), written.mass),
        # A centre of mass near O's origin has small coordinates: compare with the body's own size.
        ("centre of mass", written.com, found.com, max(float(np.abs(written.com).max()), arm)),
        ("inertia", written.inertia, found.inertia, float(np.abs(written.inertia).max())),
    )
    for what, stated, read, size in pairs:
        off = float(np.abs(stated - read).max()) / size
        if not off <= where.tolerance:
            raise ExportError(
                f"the {where.value.upper()} file is read back with another {what}: off by {off:.2g} of it, "
                f"{where.tolerance:g} is allowed: nothing was written: report this with the object file"
            )


def _write_folder(body: ExportBody, output: Path) -> list[Path]:
    """Write a Gazebo model folder; existing files of the same names are replaced, others stay.

    Returns:
        The folder, then the mesh if there is one.

    Raises:
        ExportError: the library that reads the format is missing, cannot read the files, or does not find the
            same mass, centre of mass and inertia.
        OutputError: a file cannot be written, or the folder holds other files than a model's.
    """
    refuse_other_folder(output)
    try:
        with tempfile.TemporaryDirectory(dir=output.parent, prefix=f".{output.name}.") as folder:
            staged = Path(folder) / output.name
            files = stage_model(body, staged)
            refuse_changed_parameters(body.inertial, read_back(staged, Format.GAZEBO), Format.GAZEBO)
            for file in files:
                (output / file).parent.mkdir(parents=True, exist_ok=True)
                _move(staged / file, output / file)
            return [output, *(output / file for file in files if file.parent.name)]
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error.strerror}: choose another place") from None


def _write(body: ExportBody, wanted: Format, path: Path, mesh: MeshFile | None) -> None:
    if mesh is not None:
        (path.parent / mesh.name).write_bytes(mesh.data)
    if wanted is Format.USD:
        write_usd(body, path)
    elif wanted is Format.ROS:
        path.write_text(ros_text(body, as_json=path.suffix.lower() == ".json"), encoding="utf-8")
    else:
        texts = {Format.URDF: urdf_text, Format.SDF: sdf_text, Format.MJCF: mjcf_text}
        path.write_text(texts[wanted](body, mesh), encoding="utf-8")


def _put_in_place(staged: Path, output: Path, mesh: MeshFile | None) -> list[Path]:
    """Move the body's file and its mesh to their final folder, the mesh first.

    So no body's file is ever without its mesh. Existing files are replaced; the new ones are readable by all
    users.

    Args:
        staged: body's file in a folder on the same disk, with the mesh beside it.
        output: final path of the body's file.
        mesh: mesh file beside `staged`; None if there is none.

    Returns:
        Final paths: the body's file, then the mesh if there is one.

    Raises:
        OSError: a file cannot be moved.
    """
    moves = [] if mesh is None else [(staged.parent / mesh.name, output.parent / mesh.name)]
    moves.append((staged, output))
    for source, target in moves:
        _move(source, target)
    return [target for _, target in reversed(moves)]


def _move(source: Path, target: Path) -> None:
    with source.open("rb") as file:
        os.fsync(file.fileno())
    source.chmod(0o644)
    source.replace(target)
