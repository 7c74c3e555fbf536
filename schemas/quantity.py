"""A quantity with its uncertainty, and the base of result documents whose keys were renamed."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, Literal, cast

from pydantic import model_validator

from schemas.document import Document


def json_entries(data: object) -> dict[str, Any] | None:
    """Entries of a JSON object as a dict; None if `data` are not a JSON object."""
    return cast("dict[str, Any]", data) if isinstance(data, dict) else None


def _read_renamed() -> dict[str, dict[str, str]]:
    renamed: dict[str, dict[str, str]] = {}
    with Path(__file__).with_name("renamed_keys.csv").open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            renamed.setdefault(row["document"], {})[row["schema 1"]] = row["schema 2.0"]
    return renamed


RENAMED = _read_renamed()
"""New name by old name, by the document or kind of name; renamed_keys.csv, which the documentation shows."""


class RenamedDocument(Document):
    """Base of result documents with renamed keys: old and new keys are read, new ones are written.

    The names are in RENAMED (renamed_keys.csv), under the name of the document's class.
    """

    @model_validator(mode="before")
    @classmethod
    def _take_new_names(cls, data: Any) -> Any:
        entries, renamed = json_entries(data), RENAMED[cls.__name__]
        return data if entries is None else {renamed.get(key, key): value for key, value in entries.items()}


class Quantity(Document):
    """A number, vector or matrix with unit, standard deviation and 95 % interval.

    `value`, `sd` and `interval95` may be null if the strikes do not determine the quantity.
    """

    value: float | list[float] | list[list[float]] | None
    """number, vector (3,) or matrix (3, 3), in `unit`; null if not observed"""
    unit: str
    """unit of value, sd and interval"""
    sd: float | list[float] | None = None
    """1 sigma of each component, in `unit`; nine numbers row by row for a matrix"""
    covariance: list[list[float]] | None = None
    """(3, 3) covariance of a vector, in `unit` squared; null if none is stated"""
    interval95: list[float] | list[list[float]] | None = None
    """lower and upper end of the 95 % interval, in `unit`; one such pair per component of a vector"""
    frame: str | None = None
    """frame of a vector or matrix, such as O; null for a scalar"""
    observed: bool = True
    """false if no strike determines the quantity, or one of its directions"""
    unobserved_direction: list[float] | None = None
    """unit direction (3,), in `frame`, in which a vector is not observed; null if there is none"""
    source: Literal["measured", "prior", "given"] = "measured"
    """origin of the number: the strikes (measured), an assumption (prior) or an input (given); prior as soon
    as one of several numbers is (`inertia_measured` has it entry by entry)"""

    def as_scalar(self) -> float:
        """Value of a scalar quantity, in its unit.

        Raises:
            TypeError: the quantity is a vector or matrix, or has no value.
        """
        if not isinstance(self.value, float):
            raise TypeError(f"no scalar value: {self.value!r}")
        return self.value

    def interval_ends(self) -> tuple[float, float]:
        """Lower and upper end of a scalar quantity's 95 % interval, in its unit.

        Raises:
            TypeError: the quantity is a vector or matrix, or has no interval.
        """
        match self.interval95:
            case [float(low), float(high)]:
                return low, high
            case _:
                raise TypeError(f"no interval of a scalar: {self.interval95!r}")
