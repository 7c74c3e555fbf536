"""An object's files: the specification (TOML) and the shape file beside it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from analyze.errors import ShapeError
from schemas.document import DocumentError
from schemas.object_spec import ObjectSpec, object_sha256, read_object_spec


@dataclass(frozen=True)
class ObjectFiles:
    """An object as its files give it."""

    spec: ObjectSpec
    shape_bytes: bytes | None
    """None: a primitive"""
    shape_name: str
    sha256: str


def object_spec(spec_path: Path) -> ObjectSpec:
    """Read an ObjectSpec (TOML) alone: its shape file need not be there yet.

    Raises:
        ShapeError: it is missing or cannot be read, or holds an entry that cannot be used.
    """
    try:
        return read_object_spec(spec_path)
    except DocumentError as error:
        raise ShapeError(str(error)) from None


def object_files(spec_path: Path) -> ObjectFiles:
    """Read an ObjectSpec (TOML) and the shape file beside it.

    Raises:
        ShapeError: either is missing or cannot be read, or the specification holds an entry that cannot be used.
    """
    spec = object_spec(spec_path)
    if spec.shape.file is None:
        return ObjectFiles(spec, None, spec_path.name, object_sha256(spec, None))
    shape_path = spec_path.parent / spec.shape.file
    try:
        data = shape_path.read_bytes()
    except FileNotFoundError:
        raise ShapeError(f"{shape_path}: no such shape file: {spec_path.name} names it, put it beside it") from None
    except OSError as error:
        raise ShapeError(f"{shape_path}: cannot be read: {error.strerror}") from None
    return ObjectFiles(spec, data, shape_path.name, object_sha256(spec, data))
