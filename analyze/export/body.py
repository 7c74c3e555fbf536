"""What is written, whatever the format: the exterior and the ten inertial parameters, in the object's frame O, SI units."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from analyze.errors import ExportError
from analyze.geometry.object_model import ObjectModel
from analyze.types import Array
from schemas.result import Result

PROPER = np.stack(
    [np.eye(3)[list(order)] for order in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0))]
)
"""the ways to name three principal axes"""
TAKEN = {"world", "base", "root", "default", "main"}
"""names that SDF, MJCF or their users keep for something else"""


@dataclass(frozen=True)
class Inertial:
    """The ten parameters of a rigid body."""

    mass: float
    """kg"""
    com: Array
    """(3,) m, in O"""
    inertia: Array
    """(3, 3) kg m^2, about the centre of mass, axes of O"""

    def principal(self) -> tuple[Array, Array]:
        """Principal moments (3,) [kg m^2] and the rotation R (3, 3) whose columns are their axes in O: I = R diag R^T.

        Of the ways to name the axes that which turns least, so that a tensor that is diagonal already stays as it is.
        """
        values, axes = np.linalg.eigh(self.inertia)
        order = max(PROPER, key=lambda each: float(np.abs(np.diag(axes @ each)).sum()))
        values, axes = values @ order, axes @ order
        axes = axes * np.where(np.diag(axes) < 0, -1.0, 1.0)
        if np.linalg.det(axes) < 0:
            least = int(np.argmin(np.abs(np.diag(axes))))
            axes[:, least] *= -1
        return values, axes

    def principal_quaternion(self) -> tuple[Array, Array]:
        """As `principal`, the rotation as a unit quaternion (4,) wxyz, w >= 0."""
        values, axes = self.principal()
        wxyz = Rotation.from_matrix(axes).as_quat(canonical=True, scalar_first=True)
        return values, np.asarray(wxyz, dtype=np.float64)


@dataclass(frozen=True)
class Body:
    """All that a file says."""

    name: str
    """as its owner calls it: any text"""
    model: ObjectModel
    inertial: Inertial
    provenance: Mapping[str, object]
    """what it rests on, as JSON values"""

    @property
    def identifier(self) -> str:
        """The name as every format allows it."""
        return identifier(self.name)


def identifier(name: str) -> str:
    """`name` as an identifier in ASCII: letters, digits and single underscores, a letter first; valid in URDF, SDF, MJCF and USD.

    SDF keeps names between double underscores and `world` for itself, MJCF `world`, USD allows letters, digits and underscores only.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    word = re.sub(r"[^A-Za-z0-9]+", "_", plain).strip("_")
    if not word:
        return "object"
    return word if word[0].isalpha() and word.lower() not in TAKEN else f"object_{word}"


def inertial_of(result: Result, name: str) -> Inertial:
    """The ten parameters that a Result states, a prior's ones included.

    Raises:
        ExportError: it states none, or such as no body can have.
    """
    mass, com, inertia = result.mass.value, result.centre_of_mass.value, result.inertia.value
    if mass is None or com is None or inertia is None:
        missing = "mass" if mass is None else "centre of mass" if com is None else "inertia"
        raise ExportError(
            f"{name}: the result states no {missing}: strike the object over more edges, and estimate anew"
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
            f"{name}: holds no centre of mass of three numbers and no symmetric inertia: estimate anew"
        )
    refuse_impossible(found, name)
    return found


def refuse_impossible(inertial: Inertial, name: str) -> None:
    """No simulator takes a body without mass, or one whose second moments are negative somewhere.

    Raises:
        ExportError: it is such a body.
    """
    least, middle, most = np.linalg.eigvalsh(inertial.inertia)
    if not (inertial.mass > 0 and least > 0 and least + middle >= most):
        raise ExportError(
            f"{name}: {inertial.mass:g} kg with principal moments {least:.4g}, {middle:.4g}, {most:.4g} kg m2 is no body: "
            "mass and moments must be above 0 and no moment above the sum of the others: estimate anew"
        )
