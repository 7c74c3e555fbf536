"""Base of all documents that the packages exchange.

A document is validated when it is read; all its problems are reported in one line.

Frames: W world (z up, table z = 0), O object (the shape file's frame), C camera (OpenCV), M marker. See
schemas/README.md. SI units throughout.
"""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeVar, cast

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from schemas.document_problems import problems_in_one_line

if TYPE_CHECKING:
    from pathlib import Path

SCHEMA_VERSION = "1.0"
POSE_TOLERANCE = 1e-3
"""Largest error of a rotation's column products: numbers typed by people have four digits."""
MAX_TRANSLATION_M = 10.0
"""Largest translation of a pose: no marker or camera of a table-top rig is farther away."""

T = TypeVar("T", bound=BaseModel)

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Matrix3 = Annotated[list[Vector3], Field(min_length=3, max_length=3)]
Row4 = Annotated[list[float], Field(min_length=4, max_length=4)]
Matrix4 = Annotated[list[Row4], Field(min_length=4, max_length=4)]


class DocumentError(ValueError):
    """A document that cannot be used; the message names the file, the entry and the remedy in one line."""


class Document(BaseModel):
    """Base of all documents; it refuses unknown keys and non-finite numbers."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    by_hand: ClassVar[bool] = False
    """True if people write such documents: messages then show how to add a missing entry."""


def check_pose(T: list[list[float]]) -> None:
    """Raise ValueError unless T (4, 4) is a rigid transform with a plausible translation in metres."""
    columns = list(zip(*T[:3], strict=True))[:3]
    dots = [
        sum(a * b for a, b in zip(columns[i], columns[j], strict=True)) for i in range(3) for j in range(i, 3)
    ]
    (a, b, c), (d, e, f), (g, h, i) = (row[:3] for row in T[:3])
    right_handed = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) > 0
    if (
        max(abs(dot - one) for dot, one in zip(dots, (1, 0, 0, 1, 0, 1), strict=True)) > POSE_TOLERANCE
        or not right_handed
    ):
        raise ValueError(
            "its upper left 3 x 3 is not a rotation: its columns must have length 1, be perpendicular and "
            "right-handed"
        )
    if T[3] != [0, 0, 0, 1]:
        raise ValueError("its last row must be 0, 0, 0, 1")
    far = max(abs(row[3]) for row in T[:3])
    if far > MAX_TRANSLATION_M:
        raise ValueError(
            f"its translation is {far:g} m: translations are in metres ({far:g} mm would be {far / 1000:g})"
        )


def validate(model: type[T], data: object, name: str, remedy: str = "") -> T:
    """Validate `data` as `model`.

    Raises:
        DocumentError: it is not valid; one line with `name`, all problems and the `remedy`.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        by_hand = issubclass(model, Document) and model.by_hand
        raise DocumentError(
            f"{name}: "
            f"{problems_in_one_line(error, model, data, by_hand=by_hand)}{f': {remedy}' if remedy else ''}"
        ) from None


def refuse_other_major(data: object, name: str) -> None:
    """Raise DocumentError if the document has another major schema version."""
    found = cast("dict[str, object]", data).get("schema_version") if isinstance(data, dict) else None
    ours = SCHEMA_VERSION.split(".", maxsplit=1)[0]
    if isinstance(found, str) and found.split(".", maxsplit=1)[0] != ours:
        raise DocumentError(
            f"{name}: has schema version {found}, this program reads {ours}.x: create it again with "
            "`analyze plan`"
        )


def sha256_text(text: str) -> str:
    """SHA-256 of a text in UTF-8, hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()


def canonical_json(document: Document) -> str:
    """JSON of a document in one line with sorted keys: equal documents give equal bytes."""
    return json.dumps(
        document.model_dump(mode="json"), sort_keys=True, separators=(",", ":"), allow_nan=False
    )


def read_text(path: Path) -> str:
    """Read a document's text.

    Raises:
        DocumentError: the file is missing, is not UTF-8 text, or cannot be read.
    """
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise DocumentError(f"{path}: no such file: check the path") from None
    except UnicodeDecodeError:
        raise DocumentError(f"{path}: is not a text file") from None
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from None
