"""Exported body: exterior and ten inertial parameters, in O (the shape file's frame) and SI units."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.errors import ExportError
from analyze.geometry.object_model import ObjectModel
from analyze.result.urdf_inertial import is_possible
from analyze.types import Array
from schemas.result import Result

AXIS_ORDERS = np.stack([np.eye(3)[list(order)] for order in permutations(range(3))])
"""(6, 3, 3) permutation matrices of the three principal axes"""
RESERVED_NAMES = {"world", "base", "root", "default", "main"}
"""names that SDF, MJCF or their users reserve"""


@dataclass(frozen=True)
class Inertial:
    """Mass [kg], centre of mass [m] and inertia tensor [kg m^2] of a rigid body, in the frame O.

    The tensor is about the centre of mass, along the axes of O, the frame of the object's shape file.
    """

    mass: float
    """mass [kg]"""
    com: Array
    """(3,) centre of mass [m], in O"""
    inertia: Array
    """(3, 3) inertia tensor [kg m^2], about the centre of mass, axes of O"""

    def principal_quaternion(self) -> tuple[Array, Array]:
        """Principal moments (3,) [kg m^2], and the orientation of their axes in O as quaternion (4,).

        O is the frame of the object's shape file. The unit quaternion, in the order w, x, y, z with w at
        least 0, rotates the axes of O into the principal axes. Moments and axes are ordered, and the axes
        signed, so that the rotation is near the identity: a diagonal tensor keeps its order of moments.
        """
        values, axes = np.linalg.eigh(self.inertia)
        order = max(AXIS_ORDERS, key=lambda each: float(np.abs(np.diag(axes @ each)).sum()))
        values, axes = values @ order, axes @ order
        axes = axes * np.where(np.diag(axes) < 0, -1.0, 1.0)
        if np.linalg.det(axes) < 0:
            least = int(np.argmin(np.abs(np.diag(axes))))
            axes[:, least] *= -1
        wxyz = Rotation.from_matrix(axes).as_quat(canonical=True, scalar_first=True)
        return values, np.asarray(wxyz, dtype=np.float64)


@dataclass(frozen=True)
class ExportBody:
    """Content of an exported file: one rigid body with its shape and the origin of its numbers."""

    name: str
    """object name from the object file, any text"""
    model: ObjectModel
    """exterior of the object"""
    inertial: Inertial
    """inertial parameters in O"""
    provenance: Mapping[str, object]
    """origin of the numbers, as JSON values"""
    friction: float | None = None
    """coefficient of friction against the table, measured or as the session's rig file states it; None if
    unknown"""
    restitution: float | None = None
    """measured coefficient of restitution against the table; None if not measured"""
    friction_measured: bool = False
    """True if `friction` is measured, not stated"""

    @property
    def identifier(self) -> str:
        """Name of the object as an ASCII identifier that is valid in all formats."""
        return identifier(self.name)


def identifier(name: str) -> str:
    """ASCII identifier made from a name, valid in URDF, SDF, MJCF and USD.

    The identifier is a letter, then letters, digits and single underscores. Accents are dropped, as are other
    characters outside ASCII; blanks, hyphens and other ASCII characters become underscores. "object_" is put
    before a digit and before `RESERVED_NAMES`; "object" stands for a name of which nothing is left. SDF
    reserves `world` and names between double underscores, MJCF reserves `world`; USD allows letters, digits
    and underscores only.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_")
    if not word:
        return "object"
    return word if word[0].isalpha() and word.lower() not in RESERVED_NAMES else f"object_{word}"


def inertial_of(result: Result, name: str) -> Inertial:
    """Ten inertial parameters of a result, including those from a prior (assumed, not measured).

    Args:
        result: Result document of an estimate.
        name: name of the object, for messages.

    Raises:
        ExportError: mass, centre of mass or inertia tensor is missing or of the wrong shape, the tensor is
            not symmetric, or the parameters are not physically possible.
    """
    mass, com, inertia = result.mass.value, result.centre_of_mass.value, result.inertia.value
    if mass is None or com is None or inertia is None:
        missing = "mass" if mass is None else "centre of mass" if com is None else "inertia"
        raise ExportError(
            f"{name}: the result contains no {missing}: strike the object over more edges, and estimate again"
        )
    found = Inertial(
        float(np.asarray(mass)), np.array(com, dtype=np.float64), np.array(inertia, dtype=np.float64)
    )
    if (
        found.com.shape != (3,)
        or found.inertia.shape != (3, 3)
        or not np.array_equal(found.inertia, found.inertia.T)
    ):
        raise ExportError(
            f"{name}: its centre of mass is not three numbers, or its inertia not symmetric: estimate again"
        )
    refuse_impossible(found, name)
    return found


def refuse_impossible(inertial: Inertial, name: str) -> None:
    """Raise ExportError for parameters that no rigid body can have, which simulators refuse.

    Args:
        inertial: inertial parameters.
        name: name of the object, for the message.

    Raises:
        ExportError: mass or a principal moment is not above 0, or a moment exceeds the sum of the other two.
    """
    if not is_possible(inertial.mass, inertial.inertia):
        least, middle, most = np.linalg.eigvalsh(inertial.inertia)
        raise ExportError(
            f"{name}: {inertial.mass:g} kg with principal moments {least:.4g}, {middle:.4g}, {most:.4g} kg "
            "m2 is not physically possible: mass and moments must be above 0 and no moment above the sum of "
            "the others: estimate again"
        )
