"""The object specification (TOML), which the user writes: shape, mass and markers.

Frames: O is the object's frame, that of the shape file or with its origin at the centre of a box or cylinder;
M is a marker's.
"""

from __future__ import annotations

import enum
import hashlib
import json
import tomllib
from typing import TYPE_CHECKING, Any, ClassVar

from pydantic import Field, ValidationInfo, field_validator, model_validator

from schemas.document import Document, DocumentError, Matrix4, Vector3, check_pose, read_text, validate
from schemas.fixture import FIXTURE_KEYS, FixtureBody, HeldObject, check_fixture
from schemas.part_label import LABEL_KEYS_AFTER_1_0, PartLabel, check_labels
from schemas.tags import USUAL_FAMILY, TagFamily, marker_name
from schemas.toml_problem import quoted_line

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

MAX_THICKNESS_M = 0.1
"""Largest wall thickness, edge radius or surface error [m]: a larger value was probably given in
millimetres."""

MARKER_KEYS_AFTER_1_0 = ("place_sd_m", "turn_sd_rad")
"""Keys of a marker added after version 1.0: the object's hash includes them only if they are given."""


class LengthUnit(enum.Enum):
    """Unit of a shape file's coordinates.

    There is no default: a wrong guess would be wrong by a factor of 1000.
    """

    METRE = "m"
    CENTIMETRE = "cm"
    MILLIMETRE = "mm"
    INCH = "in"

    @property
    def metres(self) -> float:
        """Length [m] of this unit."""
        return {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}[self.value]


class Box(Document):
    """Cuboid centred on the origin of O (the object's frame), with its edges along O's axes."""

    size_m: Vector3 = Field(description="lengths of its edges along x, y, z, in metres")

    @field_validator("size_m")
    @classmethod
    def _positive(cls, value: list[float]) -> list[float]:
        if min(value) <= 0:
            raise ValueError("every edge must be longer than 0")
        return value


class Cylinder(Document):
    """Cylinder centred on the origin of O (the object's frame), with its axis along O's z."""

    radius_m: float = Field(gt=0, description="in metres")
    height_m: float = Field(gt=0, description="in metres")


class Shape(Document):
    """Exterior of the object: a shape file with its unit, or a box, or a cylinder.

    Exactly one of `file`, `box` and `cylinder` is given.
    """

    file: str | None = Field(
        default=None, description="name of the shape file, in the folder of this specification"
    )
    unit: LengthUnit | None = Field(
        default=None, description="unit of the file's coordinates: m, cm, mm or in"
    )
    scale_sd: float = Field(default=0.0, ge=0, description="1 sigma of the shape's scale, relative")
    surface_sd_m: float | None = Field(
        default=None,
        ge=0,
        description="1 sigma of the offset of each face of the surface, in metres: a scanner's bias, which "
        "more points do not reduce; 0 for an exact shape; if left out, it is estimated from the strikes, "
        "beginning with 0.3 mm for a mesh, 0.1 mm for a box or cylinder, and the noise of a point cloud",
    )
    box: Box | None = None
    cylinder: Cylinder | None = None

    @model_validator(mode="after")
    def _one_shape(self) -> Shape:
        given = [name for name in ("file", "box", "cylinder") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of file, box, cylinder (found {', '.join(given) or 'none'})")
        if self.file is not None and self.unit is None:
            raise ValueError('a shape file needs its unit: unit = "mm" (or "m", "cm", "in")')
        if self.surface_sd_m is not None and self.surface_sd_m > MAX_THICKNESS_M:
            raise ValueError(
                f"surface_sd_m = {self.surface_sd_m:g} m is too large for a scanner's error: it is in metres"
            )
        if self.file is None and self.unit is not None:
            raise ValueError("unit belongs to a shape file; box and cylinder are in metres")
        return self


class MarkerSpec(Document):
    """One square marker on the object.

    `T_object_marker` maps M, the marker's frame (x right, y up, z out of its face, origin at its centre), to
    O, the object's frame.
    """

    family: TagFamily = Field(default=USUAL_FAMILY, description="tag family")
    id: int = Field(ge=0, description="number of the tag in its family, from 0")
    size_m: float = Field(gt=0.002, lt=0.5, description="edge of the black square, in metres")
    mass_kg: float = Field(default=0.0, ge=0, description="mass of the marker, in kilograms")
    thickness_m: float = Field(default=0.0, ge=0, description="thickness of the marker, in metres")
    T_object_marker: Matrix4 | None = Field(
        default=None,
        description="pose of the marker in O, 4 x 4, in metres; if left out, `analyze register` finds it",
    )
    place_sd_m: float | None = Field(
        default=None,
        gt=0,
        le=MAX_THICKNESS_M,
        description="1 sigma of the position in `T_object_marker`, in its least certain direction, in "
        "metres; `analyze register` writes it; if left out, 0.3 mm",
    )
    turn_sd_rad: float | None = Field(
        default=None,
        gt=0,
        le=1.0,
        description="1 sigma of the rotation in `T_object_marker` about its least certain axis, in radians, "
        "as an error that all markers share; `analyze register` writes it; if left out, 0.3 deg",
    )

    @property
    def name(self) -> int | str:
        """Name of the marker in all documents.

        It is the marker's id in the family 36h11, otherwise family and id, for example "25h9-3".
        """
        return marker_name(self.family, self.id)

    @field_validator("family", mode="before")
    @classmethod
    def _family(cls, value: object) -> object:
        try:
            return TagFamily(value)
        except ValueError:
            raise ValueError(f"{value!r} is not a tag family: choose {', '.join(TagFamily)}") from None

    @field_validator("id")
    @classmethod
    def _in_family(cls, value: int, info: ValidationInfo) -> int:
        family = info.data.get("family")
        if isinstance(family, TagFamily) and value >= family.size:
            raise ValueError(f"{family} has no tag {value}: its ids are 0 to {family.size - 1}")
        return value

    @field_validator("T_object_marker")
    @classmethod
    def _pose(cls, value: list[list[float]] | None) -> list[list[float]] | None:
        if value is not None:
            check_pose(value)
        return value


class EdgeRadius(Document):
    """Radius [m] of the rounding of one edge, which replaces the object's `edge_radius_m` there."""

    id: str = Field(min_length=1, description="name of the edge in the plan, for example p4e0")
    radius_m: float = Field(ge=0, description="radius of the rounded edge, in metres")
    radius_sd_m: float | None = Field(
        default=None,
        ge=0,
        description="1 sigma of radius_m, in metres; if left out or 0, 0.1 mm and a fifth of the radius",
    )

    @field_validator("radius_m")
    @classmethod
    def _metres(cls, value: float) -> float:
        return _in_metres(value)


class ObjectSpec(Document):
    """The object as the user describes it (TOML), without masses of inner parts: they are the result.

    Lengths are in metres and masses in kilograms; a shape file has a unit of its own. Poses and directions
    are in O, the frame of the shape file or, for a box or cylinder, of its centre.
    """

    by_hand: ClassVar[bool] = True

    name: str = Field(min_length=1, description="name of the object")
    mass_kg: float = Field(gt=0, description="mass of the object, in kilograms")
    mass_sd_kg: float = Field(gt=0, description="1 sigma of the mass, in kilograms: the scale's error")
    mass_includes_markers: bool = Field(default=True, description="true: it was weighed with its markers")
    shape: Shape = Field(
        description="file and unit, or [shape.box] with size_m, or [shape.cylinder] with radius_m and "
        "height_m"
    )
    edge_radius_m: float | None = Field(
        default=None,
        ge=0,
        description="radius of the rounded edges, in metres; if left out, 0 to 1.5 mm are taken as equally "
        "likely",
    )
    edge_radius_sd_m: float | None = Field(
        default=None,
        ge=0,
        description="1 sigma of edge_radius_m, in metres; if left out or 0, 0.1 mm and a fifth of the radius",
    )
    edge: list[EdgeRadius] | None = Field(
        default=None,
        min_length=1,
        description="edges whose radius differs from edge_radius_m: id in the plan, radius_m, radius_sd_m",
    )
    shell_thickness_m: float | None = Field(
        default=None, gt=0, description="thickness of the wall, in metres, if known"
    )
    labels: list[PartLabel] | None = Field(
        default=None,
        min_length=2,
        description="parts whose masses are estimated, if the object has known parts",
    )
    fixture: list[FixtureBody] | None = Field(
        default=None,
        min_length=1,
        description="bodies that hold the object and are struck with it: mass_kg and shape include them, the "
        "answer is that of the object alone; `analyze fixture` writes them",
    )
    held: HeldObject | None = Field(default=None, description="how closely the object sits in its fixture")
    marker: list[MarkerSpec] = Field(
        default_factory=list,
        description="for each tag on the object: id, size_m, and T_object_marker if its place is known; none "
        "if the object is followed by its own print",
    )

    @field_validator("shell_thickness_m", "edge_radius_m")
    @classmethod
    def _metres(cls, value: float | None) -> float | None:
        return None if value is None else _in_metres(value)

    @field_validator("mass_kg")
    @classmethod
    def _grams(cls, value: float) -> float:
        if value > 20.0:
            raise ValueError(
                f"{value:g} kg is too heavy for a striker: mass_kg is in kilograms ({value:g} g would be "
                f"{value / 1000:g})"
            )
        return value

    @model_validator(mode="after")
    def _consistent(self) -> ObjectSpec:
        names = [marker.name for marker in self.marker]
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            raise ValueError(
                f"marker id {twice[0]} is listed twice: every marker on an object needs its own id"
            )
        alike = {marker.family.codes: marker.family for marker in self.marker}
        for marker in self.marker:
            if marker.family is not alike[marker.family.codes]:
                raise ValueError(
                    f"marker families {marker.family} and {alike[marker.family.codes]} share their codes: "
                    "use one of the two for all such tags"
                )
        check_labels(self.labels or [])
        check_fixture(self.fixture, self.held, self.mass_kg)
        if self.fixture is not None and self.shape.file is None:
            raise ValueError("a fixture needs a shape file, with object and fixture as separate bodies")
        fixed = {number for body in self.fixture or [] for number in body.bodies}
        for label in self.labels or []:
            if common := fixed.intersection(label.bodies):
                raise ValueError(f"part {label.name!r}: body {min(common)} belongs to the fixture")
        edges = [edge.id for edge in self.edge or []]
        if named := [name for name in edges if edges.count(name) > 1]:
            raise ValueError(f"edge {named[0]!r} is listed twice: give each edge one radius")
        if self.mass_sd_kg >= self.mass_kg:
            raise ValueError("mass_sd_kg must be below mass_kg: it is the scale's 1 sigma, in kilograms")
        return self


def _in_metres(length: float) -> float:
    """Length [m] of a wall's thickness or an edge's radius, unchanged.

    Raises:
        ValueError: it is above `MAX_THICKNESS_M`, so that it was probably given in millimetres.
    """
    if length > MAX_THICKNESS_M:
        raise ValueError(
            f"{length:g} m is too thick for a wall or an edge: it is in metres ({length:g} mm would be "
            f"{length / 1000:g})"
        )
    return length


def read_object_spec(path: Path) -> ObjectSpec:
    """Read and validate an object file (TOML).

    Returns:
        Shape, mass, markers and labelled parts of the object, as given in the file.

    Raises:
        DocumentError: the file is missing, is not TOML, or holds an entry that cannot be used.
    """
    return parse_object_spec(read_text(path), str(path))


def parse_object_spec(text: str, name: str) -> ObjectSpec:
    """Validate an object specification given as TOML text.

    Args:
        text: content of an object file.
        name: name of the file, with which error messages begin.

    Returns:
        Shape, mass, markers and labelled parts of the object.

    Raises:
        DocumentError: the text is not TOML, or holds an entry that cannot be used.
    """
    return validate(ObjectSpec, _toml_table(text, name), name)


def _toml_table(text: str, name: str) -> dict[str, Any]:
    """Tables and values of an object file's text.

    Raises:
        DocumentError: the text is not TOML; the message quotes the line.
    """
    try:
        return tomllib.loads(text)
    except ValueError as error:  # tomllib.TOMLDecodeError, and int's refusal of thousands of digits
        raise DocumentError(f"{name}: not valid TOML: {error}{quoted_line(text, str(error))}") from None
    except RecursionError:
        raise DocumentError(f"{name}: not an object file: its brackets are nested too deeply") from None


def object_sha256(spec: ObjectSpec, shape_bytes: bytes | None) -> str:
    """Identity of an object: SHA-256 (hexadecimal) of its specification and its shape file's bytes.

    A plan states the identity of the object that it was made for. Entries added after version 1.0 count only
    if they are given, so that older recordings keep their identity.

    Args:
        spec: specification of the object; it is hashed as JSON, so that the TOML file's layout has no
            influence.
        shape_bytes: content of the shape file; None if the shape is a box or a cylinder.
    """
    known = spec.model_dump(mode="json")
    # Before it could be left open, an error of the surface that was left out counted as 0.
    if not spec.shape.surface_sd_m:
        del known["shape"]["surface_sd_m"]
    # Before a radius could be left open, one that was left out was hashed as 0.
    known["edge_radius_m"] = known["edge_radius_m"] or 0.0
    known["edge_radius_sd_m"] = known["edge_radius_sd_m"] or 0.0
    _drop_unset(known, ("edge", *FIXTURE_KEYS))
    for marker in known["marker"]:
        _drop_unset(marker, MARKER_KEYS_AFTER_1_0)
    labels: list[dict[str, Any]] = known["labels"] or []
    for label in labels:
        _drop_unset(label, LABEL_KEYS_AFTER_1_0)
    digest = hashlib.sha256(
        json.dumps(known, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    )
    if shape_bytes is not None:
        digest.update(hashlib.sha256(shape_bytes).digest())
    return digest.hexdigest()


def _drop_unset(entries: dict[str, Any], names: Iterable[str]) -> None:
    """Remove those of the named entries from a document that are None, False or empty."""
    for name in names:
        if not entries[name]:
            del entries[name]
