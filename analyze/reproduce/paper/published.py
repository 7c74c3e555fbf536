"""The paper's Tables 1 and 2, with errors recomputed from its coordinates and masses.

Some printed errors do not follow from these values.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np

from analyze.types import Array

OBJECTS = {
    "carton": "square carton box",
    "spray": "spray bottle",
    "juice": "juice bottle",
    "salt": "salt cylinder",
}
"""The paper's four objects by the names of their virtual counterparts; the paper's tables have no rows for
the box."""
VOLUME_MM3 = {"spray": 812_592.0, "juice": 862_704.0, "salt": 596_590.0}
"""Volumes of the objects [mm^3]; the salt cylinder's follows from its err % column, because the published
one is the juice bottle's."""


@dataclass(frozen=True)
class PublishedCentre:
    """One result of the paper's Table 1: error of a centre of mass."""

    object: str
    """Name of its virtual counterpart."""
    distance_m: float
    """Distance [m] from the reference, computed from the coordinates."""
    volume_ratio: float
    """Volume of the sphere with radius `distance_m`, over the object's volume."""


@dataclass(frozen=True)
class PublishedMasses:
    """One result of Table 2 of the paper (VISAPP 2013): errors of the masses of shell and two inner parts.

    `metric` is the mean of the three absolute errors over the total mass; `misplaced` is their sum over twice
    the total mass.
    """

    object: str
    """Name of its virtual counterpart."""
    metric: float
    """Mean over the regions of the absolute error of the mass, over the total mass."""
    misplaced: float
    """Sum over the regions of the absolute error of the mass, over twice the total mass."""


def published_centres() -> list[PublishedCentre]:
    """Errors of the nine results in the paper's Table 1 (centre of mass), in its order.

    Each holds the distance from the reference [m] and the paper's measure of error: the volume of the sphere
    with that radius over the object's volume.
    """
    found: list[PublishedCentre] = []
    for name, error, _ in _errors("table1_centre_of_mass.csv", ("x_mm", "y_mm", "z_mm")):
        distance = float(np.linalg.norm(error))
        found.append(PublishedCentre(name, distance / 1000, volume_ratio(distance, VOLUME_MM3[name])))
    return found


def published_masses() -> list[PublishedMasses]:
    """Errors of the nine results in the paper's Table 2 (region masses), over the object's mass.

    The order is the table's.
    """
    found: list[PublishedMasses] = []
    for name, error, row in _errors("table2_mass_distribution.csv", ("surface_g", "top_g", "bottom_g")):
        off, total = np.abs(error), float(row["total_mass_g"])
        found.append(PublishedMasses(name, float(off.mean() / total), float(off.sum() / 2 / total)))
    return found


def volume_ratio(distance: float, volume: float) -> float:
    """The paper's error of a centre of mass: volume of an error sphere over that of the object.

    Args:
        distance: radius of the error sphere: distance of the estimate from the reference.
        volume: volume of the object, in the cube of the unit of `distance`.
    """
    return 4 / 3 * np.pi * distance**3 / volume


def _errors(file: str, columns: Sequence[str]) -> Iterator[tuple[str, Array, dict[str, str]]]:
    """Yield each result of one of the paper's tables as (name of the object, error, row of the CSV file).

    The name is the one that this package uses. The error (len(columns),) is the result minus the reference,
    which is the last row marked "reference" before it in the file.

    Args:
        file: name of the table's CSV file.
        columns: columns that hold the result; the error is in their unit.
    """
    names = {printed: name for name, printed in OBJECTS.items()}
    text = (resources.files("analyze.reproduce.paper") / "published" / file).read_text(encoding="utf-8")
    reference = np.zeros(len(columns))
    for row in csv.DictReader(io.StringIO(text)):
        values = np.array([float(row[column]) for column in columns])
        if row["row"] == "reference":
            reference = values
        else:
            yield names[row["object"]], values - reference, row
