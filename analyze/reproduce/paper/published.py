"""What the paper printed: Tables 1 and 2, scored by what is printed, not by its own columns (those do not all follow from it)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources

import numpy as np

OBJECTS = {"carton": "square carton box", "spray": "spray bottle", "juice": "juice bottle", "salt": "salt cylinder"}
"""the paper's four by the names of their likenesses; its tables have no rows for the box"""
VOLUME_MM3 = {"spray": 812_592.0, "juice": 862_704.0, "salt": 596_590.0}
"""the last as its err % column implies: the printed one is the juice bottle's"""


@dataclass(frozen=True)
class PublishedCentre:
    """A result of Table 1."""

    object: str
    distance_m: float
    """from its coordinates"""
    volume_ratio: float
    """sphere of that radius over the object's volume"""


@dataclass(frozen=True)
class PublishedMasses:
    """A result of Table 2."""

    object: str
    metric: float
    """mean over the regions of |dm| / M"""
    misplaced: float
    """sum of |dm| / 2M"""


def published_centres() -> list[PublishedCentre]:
    """The nine results of Table 1."""
    found: list[PublishedCentre] = []
    reference = np.zeros(3)
    for row in _rows("table1_centre_of_mass.csv"):
        place = np.array([float(row[name]) for name in ("x_mm", "y_mm", "z_mm")])
        if row["row"] == "reference":
            reference = place
            continue
        name = _ours(row["object"])
        distance = float(np.linalg.norm(place - reference))
        found.append(PublishedCentre(name, distance / 1000, volume_ratio(distance, VOLUME_MM3[name])))
    return found


def published_masses() -> list[PublishedMasses]:
    """The nine results of Table 2."""
    found: list[PublishedMasses] = []
    reference = np.zeros(3)
    for row in _rows("table2_mass_distribution.csv"):
        masses, total = np.array([float(row[name]) for name in ("surface_g", "top_g", "bottom_g")]), float(row["total_mass_g"])
        if row["row"] == "reference":
            reference = masses
            continue
        off = np.abs(masses - reference)
        found.append(PublishedMasses(_ours(row["object"]), float(off.mean() / total), float(off.sum() / 2 / total)))
    return found


def volume_ratio(distance: float, volume: float) -> float:
    """The paper's metric of c: sphere of radius `distance` over the object's `volume`, in the same unit of length."""
    return 4 / 3 * np.pi * distance**3 / volume


def _ours(name: str) -> str:
    return next(key for key, printed in OBJECTS.items() if printed == name)


def _rows(file: str) -> Iterator[dict[str, str]]:
    text = (resources.files("analyze.reproduce.paper") / "published" / file).read_text(encoding="utf-8")
    return iter(csv.DictReader(io.StringIO(text)))
