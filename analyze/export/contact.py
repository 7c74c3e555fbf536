"""Contact of an exported body with its table: friction and restitution as simulators take them.

Values are those of one pair, this object on this table: simulators give them to the object, so that any
table it meets is taken for that one. A lower bound of friction is no value: it is written as a bound into the
provenance, and the simulator's own default (1) stays where it is not below the bound.

MuJoCo has no coefficient of restitution. Its contact is a damped oscillator that only pushes; one with the
damping ratio z gives back (Schwager and Poeschel 2007, eq. 21)

    e = exp(-z / sqrt(1 - z^2) (pi - atan2(2 z sqrt(1 - z^2), 1 - 2 z^2)))        z < 1
    e = exp(-z / q ln((z + q) / (z - q))),    q = sqrt(z^2 - 1)                   z > 1
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.result.urdf_inertial import numbers

if TYPE_CHECKING:
    from analyze.export.body import ExportBody
    from schemas.result import Result

DEFAULT_FRICTION = 1.0
"""coefficient of friction of MuJoCo, SDFormat (ODE) and Gazebo where a file gives none"""
CONTACT_RATE = 2000.0
"""natural frequency [rad/s] of an exported contact: it lasts about 1.5 ms"""
LONGEST_STEP_S = 2.5e-4
"""time step up to which that contact keeps its restitution"""
LEAST_RESTITUTION, MOST_RESTITUTION = 0.01, 0.95
"""range in which a restitution is exported"""
_HALVINGS = 60
"""halvings of the range of damping ratios"""
BOUNCE_SPEED = 0.05
"""speed [m/s] below which Gazebo takes no restitution, so that bodies come to rest"""


@dataclass(frozen=True)
class ExportContact:
    """Friction and restitution to be written, and what a reader of the file should know of them."""

    friction: float | None
    """coefficient of friction; None for the simulator's default"""
    restitution: float | None
    """coefficient of restitution; None if not measured"""
    measured: bool
    """True if the friction is measured; False if the rig file states it, or none is written"""
    notes: dict[str, object]
    """entries of the provenance"""


@dataclass(frozen=True)
class MjcfContact:
    """Contact of a body in MuJoCo."""

    friction: float | None
    """coefficient of friction; None for MuJoCo's default"""
    restitution: float | None
    """coefficient of restitution; None for a contact that gives back little"""

    def attributes(self) -> dict[str, str]:
        """Attributes of a `<geom>`; those of the body hold against any table's (`priority`)."""
        found = {"priority": "1"}
        if self.friction is not None:
            found["friction"] = numbers([self.friction])
        damping = 1.0 if self.restitution is None else damping_ratio(self.restitution)
        # Constant impedance: otherwise the oscillator is not linear.
        found["solref"] = numbers([1.0 / (CONTACT_RATE * damping), damping])
        found["solimp"] = numbers([0.999, 0.999, 0.001])
        return found


def restitution_of(damping: float) -> float:
    """Coefficient of restitution of a damped oscillator that only pushes, by its damping ratio."""
    z = damping
    if abs(z - 1.0) < 1e-6:
        return math.exp(-2.0)
    if z < 1.0:
        root = math.sqrt(1.0 - z * z)
        return math.exp(-z / root * (math.pi - math.atan2(2 * z * root, 1 - 2 * z * z)))
    root = math.sqrt(z * z - 1.0)
    return math.exp(-z / root * math.log((z + root) / (z - root)))


def damping_ratio(restitution: float) -> float:
    """Damping ratio of a contact with a coefficient of restitution, the reverse of `restitution_of`.

    Args:
        restitution: coefficient, taken into `LEAST_RESTITUTION` to `MOST_RESTITUTION`.
    """
    wanted = min(max(restitution, LEAST_RESTITUTION), MOST_RESTITUTION)
    low, high = 1e-3, 20.0
    for _ in range(_HALVINGS):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if restitution_of(middle) > wanted else (low, middle)
    return math.sqrt(low * high)


def export_contact(result: Result, stated: float | None) -> ExportContact:
    """Friction and restitution of a result as they are written to a simulator's file.

    A measured friction is written. Where only a bound is measured, the friction that the rig file states is
    written if it is not below the bound, otherwise none: the simulator's default holds.

    Args:
        result: result of an estimate.
        stated: coefficient of friction that the rig file states; None for none.
    """
    contact, notes = result.contact_properties, dict[str, object]()
    friction, measured = stated, False
    if stated is not None:
        notes["friction"] = {"value": stated, "source": "rig file: least on its table, not measured"}
    if contact is None:
        return ExportContact(friction, None, measured, notes)
    pair = f"{contact.object} on {contact.table}"
    if (found := contact.friction) is not None and found.coefficient.observed:
        friction, measured = found.coefficient.as_scalar(), True
        notes["friction"] = {
            "value": friction,
            "interval95": found.coefficient.interval95,
            "source": f"measured: {pair}",
        }
    elif found is not None:
        if stated is None or stated < found.at_least:
            friction = found.at_least if found.at_least > DEFAULT_FRICTION else None
            notes.pop("friction", None)
        notes["friction_bound"] = {"at_least": found.at_least, "source": f"bound, no value: {pair}"}
    restitution = None
    if contact.restitution is not None:
        restitution = contact.restitution.mean.as_scalar()
        notes["restitution"] = {
            "value": restitution,
            "interval95": contact.restitution.mean.interval95,
            "scatter": contact.restitution.scatter,
            "source": f"measured: {pair}, where it lands at {contact.restitution.speed_m_s:.2g} m/s",
        }
    return ExportContact(friction, restitution, measured, notes)


def contact_notes(body: ExportBody, result: Result) -> list[str]:
    """Sentences on the friction and restitution that a file states; empty for a format without them."""
    notes: list[str] = []
    contact = result.contact_properties
    if body.friction is not None and not body.friction_measured:
        notes.append(f"friction {body.friction:g} is the rig file's table_friction, not measured")
    if contact is None or not {"friction", "friction_bound", "restitution"} & set(body.provenance):
        return notes
    pair = f"{contact.object} on {contact.table}"
    if body.friction_measured and body.friction is not None:
        notes.append(f"friction {body.friction:.3g} is measured for {pair} only")
    elif contact.friction is not None and "friction_bound" in body.provenance:
        notes.append(
            f"friction of {pair} is at least {contact.friction.at_least:.2f}: a bound, stated as such"
        )
    if body.restitution is not None:
        notes.append(
            f"restitution {body.restitution:.3g} is measured for {pair} only; in MuJoCo take time steps of up"
            f" to {1e3 * LONGEST_STEP_S:g} ms"
        )
    return notes
