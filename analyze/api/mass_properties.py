"""Quantities of an `ObjectEstimate`: centre of mass, inertia tensor, masses of parts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import TENSOR_ENTRIES, tensor_entry_name

if TYPE_CHECKING:
    from analyze.types import Array


@dataclass(frozen=True, eq=False)
class CentreOfMass:
    """Centre of mass c of the object without its markers, in O, the frame of the object's shape file.

    If a marker (printed tag) that has a mass has no known pose, none is subtracted: all are included.
    """

    position: Array
    """(3,) centre of mass [m] in O"""
    covariance: Array
    """(3, 3) covariance of `position` [m²]"""
    observed: bool
    """True if the strikes determine all three directions"""
    unobserved_direction: Array | None
    """(3,) unit vector in O along which c comes only from the assumption that it lies within the shape (the
    prior); None if `observed`"""

    @property
    def sd(self) -> Array:
        """Standard deviations (3,) [m] of the centre of mass along x, y, z of the shape file's frame."""
        return np.sqrt(np.diag(self.covariance)).astype(np.float64)

    @property
    def interval95(self) -> Array:
        """95 % intervals (3, 2) [m] of the centre of mass: lower and upper end for x, y, z."""
        half = SIGMAS_95 * self.sd
        return np.stack([self.position - half, self.position + half], axis=-1)

    def __repr__(self) -> str:
        """Centre of mass in mm with half widths of 95 % intervals; marked if a direction is not observed."""
        pairs = zip("xyz", 1e3 * self.position, 1e3 * SIGMAS_95 * self.sd, strict=True)
        text = ", ".join(f"{axis} {value:z.2f} ± {half:.2f}" for axis, value, half in pairs)
        return f"CentreOfMass({text} mm, 95 %{'' if self.observed else ', one direction not observed'})"


@dataclass(frozen=True, eq=False)
class InertiaTensor:
    """Inertia tensor [kg m²] about the centre of mass, with standard deviations, in the axes of O.

    O is the object frame, that of the shape file.
    """

    tensor: Array
    """(3, 3) inertia tensor [kg m²]"""
    sd: Array
    """(3, 3) standard deviations [kg m²]"""
    measured: np.ndarray[Any, np.dtype[np.bool_]]
    """(3, 3) True for entries that strikes measured, False for those from the prior (plausible fillings of
    the shape)"""

    @property
    def principal_moments(self) -> Array:
        """Principal moments of inertia (3,) about the centre of mass [kg m²], ascending."""
        return np.asarray(np.linalg.eigvalsh(self.tensor), dtype=np.float64)

    @property
    def principal_axes(self) -> Array:
        """Principal axes of inertia (3, 3): unit vectors in O as columns, in order of ascending moments."""
        return np.linalg.eigh(self.tensor)[1]

    def __repr__(self) -> str:
        """Six entries of the tensor with half widths of 95 % intervals, in one unit, 10^n kg m².

        Entries that only the prior (assumption before any strike) determines are marked "(prior)".
        """
        entries = ", ".join(
            f"{name} {text}" + ("" if source == "measured" else " (prior)")
            for name, text, source in self.rows()
        )
        return f"InertiaTensor({entries}; 10^{self.power_of_ten} kg m², 95 %)"

    @property
    def power_of_ten(self) -> int:
        """Exponent n of the unit 10^n kg m² for printing the inertia tensor: that of its largest entry."""
        return int(np.floor(np.log10(np.abs(self.tensor).max())))

    def rows(self) -> list[tuple[str, str, str]]:
        """Six entries as text, Ixx, Iyy, Izz, Ixy, Ixz, Iyz, for tables.

        Returns:
            One tuple per entry: name; value ± half width of its 95 % interval, in 10^power_of_ten kg m²; and
            "measured" if the strikes determine it, or "prior" if only the assumption before any strike does.
        """
        unit = 10.0**self.power_of_ten
        return [
            (
                tensor_entry_name((i, j)),
                f"{self.tensor[i, j] / unit:z.3f} ± {SIGMAS_95 * self.sd[i, j] / unit:.3f}",
                "measured" if self.measured[i, j] else "prior",
            )
            for i, j in TENSOR_ENTRIES
        ]


@dataclass(frozen=True)
class PartMass:
    """Mass [kg] of one part of the object, with its 95 % interval.

    The part is a region (the shell, or the interior on one side of a plane) or one that the object file
    labels.
    """

    name: str
    """name of the region or part"""
    mass: float
    """mass [kg]"""
    interval95: tuple[float, float]
    """ends of the 95 % interval [kg]; may be asymmetric"""
    observed: bool
    """False if the moments do not determine the mass; the interval then holds all possible masses"""
