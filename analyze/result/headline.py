"""The answer in numbers, the same in terminal, report and replay: mass, centre of mass, inertia tensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analyze.least_squares.intervals import SIGMAS_95
from analyze.result.digits import ScaledUnit, inertia_unit, number, value_text, with_interval
from analyze.result.urdf_inertial import inertial_block
from analyze.types import TENSOR_ENTRIES, Array
from schemas.result import Result, ResultWarning, WarningCode

AXIS_SHARE = 0.1
"""component of a principal axis (unit vector) along an axis of O up to which both count as perpendicular"""
DIRECTION_DIGITS = 2
PRIOR_NOTE = "In brackets: not measured, but from the shape, or dependent on an entry that is."
"""sentence below a tensor of which no strike measured some entries"""


@dataclass(frozen=True)
class ShownEntry:
    """Value with its 95 % interval as text, and whether strikes measured it."""

    text: str
    """value and interval, as "1.109 ± 0.017" """
    measured: bool
    """True if strikes measured the value; False if it comes from the shape"""

    @property
    def marked(self) -> str:
        """Value with its 95 % interval as text, in brackets if it comes from the shape, not from strikes."""
        return self.text if self.measured else f"[{self.text}]"


@dataclass(frozen=True)
class PrincipalAxis:
    """Principal axis of the inertia tensor with its moment, as text."""

    moment: ShownEntry
    """principal moment; counts as measured if strikes measured all entries of the tensor that give it"""
    direction: str
    """unit direction in O, as "(0.00, 0.00, 1.00)" """


@dataclass(frozen=True)
class Headline:
    """Mass, centre of mass and inertia tensor of a result as text, with one unit for all moments of inertia.

    The tensor is about the centre of mass, along the axes of O, the frame of the object's shape file.
    """

    mass: str
    """mass with its interval [g]"""
    com: tuple[ShownEntry, ...]
    """x, y and z of the centre of mass in O [mm]"""
    com_note: str
    """sentence on a direction of the centre of mass that strikes did not measure; "" if they measured all"""
    unit: ScaledUnit
    """unit of the tensor, of the principal moments, and of all other moments shown with this result"""
    tensor: tuple[tuple[ShownEntry, ...], ...]
    """three rows of three entries"""
    principal: tuple[PrincipalAxis, ...]
    """principal axes, the smallest moment first"""
    urdf: str | None
    """`<inertial>` element for a URDF file; None if no rigid body can have mass and tensor"""

    @property
    def tensor_note(self) -> str:
        """Sentence on the entries in brackets; "" if all are measured."""
        prior = [entry for row in self.tensor for entry in row if not entry.measured]
        return PRIOR_NOTE if prior else ""


def headline(result: Result) -> Headline:
    """Mass, centre of mass and inertia tensor of a result as text, ready to be shown.

    Args:
        result: Result document of an estimate, with centre of mass and tensor.
    """
    inertia = np.array(result.inertia.value, dtype=np.float64)
    measured = measured_entries(result)
    unit = inertia_unit(inertia)
    ends = result.inertia.interval95
    entry_ends = np.array(ends, dtype=np.float64).reshape(3, 3, 2) if isinstance(ends, list) else None
    tensor = tuple(
        tuple(
            ShownEntry(
                value_text(
                    unit.factor * inertia[i, j],
                    None if entry_ends is None else _scaled(entry_ends[i, j], unit.factor),
                ),
                bool(measured[i, j]),
            )
            for j in range(3)
        )
        for i in range(3)
    )
    return Headline(
        mass=with_interval(result.mass, 1e3, "g"),
        com=com_entries(result),
        com_note=_com_note(result),
        unit=unit,
        tensor=tensor,
        principal=_principal_axes(result, inertia, measured, unit),
        urdf=inertial_block(result),
    )


def com_entries(result: Result) -> tuple[ShownEntry, ...]:
    """Centre of mass x, y, z in O [mm], each with its 95 % interval."""
    com = result.centre_of_mass
    values = np.array(com.value, dtype=np.float64)
    ends = np.array(com.interval95, dtype=np.float64) if isinstance(com.interval95, list) else None
    return tuple(
        ShownEntry(value_text(1e3 * float(value), None if ends is None else _scaled(ends[i], 1e3)), True)
        for i, value in enumerate(values)
    )


def further_warnings(result: Result) -> list[ResultWarning]:
    """Warnings of a result that neither its verdict nor the marks of its tensor state already."""
    verdict = " ".join(result.verdict or [])
    return [
        warning
        for warning in result.warnings
        if warning.text not in verdict
        and not (warning.code is WarningCode.INERTIA_FROM_PRIOR and "of the tensor" in verdict)
    ]


def edge_labels(result: Result) -> dict[str, str]:
    """Names of the struck edges by axis id, with the id in brackets: "bottom edge, +x side (p4e0)"."""
    return {moment.axis_id: moment.axis_id for moment in result.moments} | {
        strike.axis_id: f"{strike.edge_name} ({strike.axis_id})" if strike.edge_name else strike.axis_id
        for strike in result.strikes
    }


def measured_entries(result: Result) -> np.ndarray:
    """(3, 3) True for entries of the inertia tensor that strikes measured, False for those from the shape."""
    return np.array(result.inertia_measured or [[result.inertia.observed] * 3] * 3, dtype=np.bool_)


def _com_note(result: Result) -> str:
    direction = result.centre_of_mass.unobserved_direction
    if result.centre_of_mass.observed or direction is None:
        return ""
    return f"Not measured along {_direction_text(np.array(direction))}: there it comes from the shape."


def _principal_axes(
    result: Result, inertia: Array, measured: np.ndarray, unit: ScaledUnit
) -> tuple[PrincipalAxis, ...]:
    """Principal axes with moments in `unit`, the smallest first.

    The standard deviation of a moment is v' dI v to first order, with the entries' joint covariance. A moment
    counts as measured if strikes measured all entries in the rows of the axes of O along which its own axis v
    has a component: those in I v = λ v.
    """
    moments, axes = np.linalg.eigh(inertia)
    covariance = None if result.parameters_covariance is None else np.array(result.parameters_covariance)
    found: list[PrincipalAxis] = []
    for moment, column in zip(moments, axes.T, strict=True):
        axis = column * np.sign(column[int(np.argmax(np.abs(column)))])
        ends = None
        if covariance is not None:
            row = np.array([axis[i] * axis[j] * (1 if i == j else 2) for i, j in TENSOR_ENTRIES])
            half = SIGMAS_95 * float(np.sqrt(max(row @ covariance[4:, 4:] @ row, 0.0)))
            ends = _scaled(np.array([moment - half, moment + half]), unit.factor)
        sure = bool(measured[:, np.abs(axis) > AXIS_SHARE].all())
        text = value_text(unit.factor * float(moment), ends)
        found.append(PrincipalAxis(ShownEntry(text, sure), _direction_text(axis)))
    return tuple(found)


def _scaled(ends: Array, factor: float) -> tuple[float, float]:
    return factor * float(ends[0]), factor * float(ends[1])


def _direction_text(direction: Array) -> str:
    return f"({', '.join(number(float(each), DIRECTION_DIGITS) for each in direction)})"
