"""Base of all documents (validated JSON or TOML files) that the packages exchange.

A document is validated when it is read; all its problems are reported in one line.

Frames: W world (z up, table z = 0), O object (the shape file's frame), C camera (OpenCV), M marker
(schemas/README.md defines them). SI units throughout.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar, cast

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    model_serializer,
)

from schemas import input_file
from schemas.document_problems import problems_in_one_line

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence
    from pathlib import Path

SCHEMA_VERSION = "1.0"
POSE_TOLERANCE = 1e-3
"""Largest error of a rotation's column products: numbers typed by people have four digits."""
MAX_TRANSLATION_M = 10.0
"""Largest component of a pose's translation [m]: no marker or camera of a table-top rig is farther away."""
MAX_NUMBER = 1e30
"""Largest size of a number in a document: far beyond every quantity, and its powers can be computed with."""

T = TypeVar("T", bound=BaseModel)

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix3 = Annotated[list[Vector3], Field(min_length=3, max_length=3)]
Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]
Matrix4 = Annotated[list[Row4], Field(min_length=4, max_length=4)]


class DocumentError(ValueError):
    """A document that cannot be used; the message is one line: file, problem and, where known, remedy."""


class Document(BaseModel):
    """Base class of all documents: immutable; refuses unknown keys and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    by_hand: ClassVar[bool] = False
    """True if people write such documents: messages then show how to add a missing entry."""


class SparseDocument(Document):
    """Base of documents that leave out some optional entries while they have their default value."""

    left_out: ClassVar[tuple[str, ...]] = ()
    """Names of entries that are not written if they equal their default."""

    @model_serializer(mode="wrap")
    def _without_defaults(self, write: SerializerFunctionWrapHandler) -> dict[str, Any]:
        written: dict[str, Any] = write(self)
        for name in self.left_out:
            if written[name] == type(self).model_fields[name].default:
                del written[name]
        return written


def check_rotation(R: Sequence[Sequence[float]], what: str = "it") -> None:
    """Check that the first three rows and columns of R are a rotation.

    Args:
        R: matrix.
        what: name of these rows and columns in the message.

    Raises:
        ValueError: they are not, to POSE_TOLERANCE.
    """
    columns = list(zip(*R[:3], strict=True))[:3]
    dots = [
        sum(a * b for a, b in zip(columns[i], columns[j], strict=True)) for i in range(3) for j in range(i, 3)
    ]
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in R[:3])
    right_handed = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    if (
        max(abs(dot - one) for dot, one in zip(dots, (1, 0, 0, 1, 0, 1), strict=True)) > POSE_TOLERANCE
        or not right_handed
    ):
        raise ValueError(
            f"{what} is not a rotation: its columns must have length 1, be perpendicular and right-handed"
        )


def _rotation(R: list[list[float]]) -> list[list[float]]:
    check_rotation(R)
    return R


Rotation3 = Annotated[Matrix3, AfterValidator(_rotation)]
"""Rotation: a 3 x 3 matrix as rows."""


def check_pose(T: list[list[float]]) -> None:
    """Check that T (4, 4) is a rigid transform with a plausible translation [m].

    Raises:
        ValueError: the upper left 3 x 3 is not a rotation (to POSE_TOLERANCE), the last row is not 0, 0, 0,
            1, or a component of the translation exceeds MAX_TRANSLATION_M.
    """
    check_rotation(T, "its upper left 3 x 3")
    if T[3] != [0, 0, 0, 1]:
        raise ValueError("its last row must be 0, 0, 0, 1")
    far = max(abs(row[3]) for row in T[:3])
    if far > MAX_TRANSLATION_M:
        raise ValueError(
            f"its translation is {far:g} m: translations are in metres ({far:g} mm would be {far / 1000:g})"
        )


def validate(model: type[T], data: object, name: str, remedy: str = "") -> T:
    """Validate `data` as a document of class `model`.

    Args:
        model: class of the expected document.
        data: content of the file as parsed from JSON or TOML.
        name: name of the file, with which the error message begins.
        remedy: advice that ends the error message; "" for none.

    Returns:
        The document.

    Raises:
        DocumentError: the data are not valid; one line with `name`, the problems and the `remedy`.
    """
    ending = f": {remedy}" if remedy else ""
    try:
        found = model.model_validate(data)
    except ValidationError as error:
        by_hand = issubclass(model, Document) and model.by_hand
        raise DocumentError(
            f"{name}: {problems_in_one_line(error, model, data, by_hand=by_hand)}{ending}"
        ) from None
    if (place := next(_numbers_beyond(data, MAX_NUMBER), None)) is not None:
        raise DocumentError(f"{name}: {place}: should be at most {MAX_NUMBER:g} in size{ending}")
    return found


def _numbers_beyond(data: object, most: float, place: str = "") -> Iterator[str]:
    """Yield the places of numbers in parsed JSON or TOML beyond `most` in size, as strikes.0.point.1."""
    entries: Iterable[tuple[object, object]] = ()
    if isinstance(data, dict):
        entries = cast("dict[object, object]", data).items()
    elif isinstance(data, list):
        entries = enumerate(cast("list[object]", data))
    elif isinstance(data, int | float) and abs(data) > most:
        yield place
    for key, value in entries:
        yield from _numbers_beyond(value, most, f"{place}.{key}" if place else str(key))


def refuse_other_major(data: object, name: str) -> None:
    """Raise DocumentError if a plan states another major schema version than this program's.

    A version that is missing, or is not text, is left to the validation.

    Args:
        data: content of the plan as parsed from JSON.
        name: name of the file for the message.
    """
    found = cast("dict[str, object]", data).get("schema_version") if isinstance(data, dict) else None
    ours = SCHEMA_VERSION.split(".", maxsplit=1)[0]
    if isinstance(found, str) and found.split(".", maxsplit=1)[0] != ours:
        raise DocumentError(
            f"{name}: has schema version {found}, this program reads {ours}.x: create it again with "
            "`analyze plan`"
        )


def sha256_text(text: str) -> str:
    """SHA-256 of a text in UTF-8, as 64 hexadecimal digits."""
    return hashlib.sha256(text.encode()).hexdigest()


def canonical_json(document: Document) -> str:
    """JSON of a document in one line with sorted keys and without spaces: equal documents give equal text."""
    return json.dumps(
        document.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False
    )


def read_text(path: Path) -> str:
    """Text of a document's file, which is UTF-8.

    Raises:
        DocumentError: the file is missing, is not UTF-8 text, or cannot be read.
    """
    try:
        return input_file.read_text(path)
    except FileNotFoundError:
        raise DocumentError(f"{path}: no such file: check the path") from None
    except UnicodeDecodeError:
        raise DocumentError(f"{path}: is not a text file in UTF-8: save it as UTF-8") from None
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from None
