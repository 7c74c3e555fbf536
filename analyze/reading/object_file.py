"""Reads an object's files: the specification (TOML) and the shape file beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ShapeError
from schemas.document import DocumentError
from schemas.input_file import read_bytes
from schemas.object_spec import ObjectSpec, object_sha256, read_object_spec

SHAPE_SUFFIXES = frozenset(
    {".stl", ".obj", ".ply", ".glb", ".gltf", ".3mf", ".pcd", ".xyz", ".las", ".laz", ".step", ".stp"}
)
"""endings of shape files, and of CAD files that people give in their place"""


@dataclass(frozen=True)
class ObjectFiles:
    """Specification (mass, shape, markers) and shape file of an object, with the hash of both."""

    spec: ObjectSpec
    """object specification: mass, shape, markers"""
    shape_bytes: bytes | None
    """content of the shape file; None for a primitive (box, cylinder)"""
    shape_name: str
    """file name of the shape file; for a primitive that of the specification"""
    sha256: str
    """identity of the object: hash of specification and shape (schemas.object_spec.object_sha256)"""


def read_spec(spec_path: Path) -> ObjectSpec:
    """Read an object specification (TOML: mass, shape, markers); return it without the shape file.

    The shape file need not exist yet.

    Raises:
        ShapeError: the specification is missing, cannot be read, or holds an entry that cannot be used.
    """
    _refuse_shape_file(spec_path)
    try:
        return read_object_spec(spec_path)
    except DocumentError as error:
        raise ShapeError(str(error)) from None


def read_object_files(spec_path: Path) -> ObjectFiles:
    """Read an object specification (TOML) and the shape file that it names, in the same folder.

    Returns:
        The specification; content and name of the shape file (None and the specification's file name for a
        primitive such as a box); and the hash of specification and shape.

    Raises:
        ShapeError: either file is missing or cannot be read, or the specification holds an entry that cannot
            be used.
    """
    return _with_shape(read_spec(spec_path), spec_path)


def _refuse_shape_file(path: Path) -> None:
    """Refuse a mesh or point cloud in place of the object file.

    Raises:
        ShapeError: the path exists and ends like a shape file.
    """
    if path.suffix.lower() in SHAPE_SUFFIXES and path.is_file():
        raise ShapeError(
            f"{path}: is a shape file, not an object file: write an object file (.toml, see "
            f'docs/how-to/object-file.md) with [shape], file = "{path.name}" and its unit'
        )


def _with_shape(spec: ObjectSpec, spec_path: Path) -> ObjectFiles:
    """Specification with the content of the shape file that it names, in the folder of `spec_path`.

    Raises:
        ShapeError: the shape file is missing or cannot be read.
    """
    if spec.shape.file is None:
        return ObjectFiles(spec, None, spec_path.name, object_sha256(spec, None))
    shape_path = spec_path.parent / spec.shape.file
    try:
        data = read_bytes(shape_path)
    except FileNotFoundError:
        raise ShapeError(
            f"{shape_path}: no such shape file: {spec_path.name} names it: put it in the same folder"
        ) from None
    except OSError as error:
        raise ShapeError(f"{shape_path}: cannot be read: {error.strerror}") from None
    return ObjectFiles(spec, data, shape_path.name, object_sha256(spec, data))
