"""Error of a round rim's strikes from the heading in which the object was put down on the table.

A straight edge turns with the object. A round rim touches the table wherever the striker pushes it, so that
an object put down turned by delta about the vertical tips over another point of the rim than planned. With c
the centre of mass, p the planned point, l the planned pivot direction, R the distance of c from the pivot
line and h its height over it at rest, the balance angle is then off by

    delta l.(c - p) h / R^2.

The hand's error is each strike's own. Where the hand follows markers that are turned on the object against
their stated pose, all strikes share that turn, and repeats do not average it out.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.joint import solve_joint
from analyze.estimation.joint_model import COM
from analyze.types import MARKER_TURN_SD

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.priors import ComPrior, SystematicErrors
    from analyze.pipeline.evidence import Evidence
    from analyze.types import Array, EquiPlane

CHECKED_HEADING_SD = math.radians(2.0)
"""standard deviation of the heading [rad] where markers with known places show the placement"""
HAND_HEADING_SD = math.radians(6.0)
"""standard deviation of the heading [rad] where no marker's place on the object is known: the hand alone
decides"""


def with_heading_errors(
    planes: Sequence[EquiPlane], evidence: Evidence, systematic: SystematicErrors, prior: ComPrior
) -> tuple[EquiPlane, ...]:
    """Equi-planes whose errors of the balance angle include those of the heading on round rims.

    An equi-plane is the plane through the pivot line and the centre of mass c; the heading is the object's
    rotation about the vertical. Its error by the hand is each strike's own and enlarges `sd_phi`; that by a
    turn of the markers on the object is shared by all strikes (`phi_by_turn`). How far c lies off the rim's
    middle follows from a first estimate by the balance angles; without strikes over rims nothing is estimated
    and the planes are returned as given.

    Args:
        planes: equi-planes of all strikes, in the object frame O.
        evidence: strikes with plan and object file.
        systematic: standard deviations of errors that strikes share.
        prior: prior of the centre of mass.
    """
    rims = {motion.strike_id for motion in evidence.motions if evidence.planned(motion).rolls} & {
        plane.strike_id for plane in planes if plane.rounded
    }
    if not rims:
        return tuple(planes)
    turn_sds = [
        MARKER_TURN_SD if marker.turn_sd_rad is None else marker.turn_sd_rad
        for marker in evidence.spec.marker
        if marker.T_object_marker is not None
    ]
    heading_sd = CHECKED_HEADING_SD if turn_sds else HAND_HEADING_SD
    turn_sd = max(turn_sds, default=0.0)
    first = solve_joint(planes, systematic, prior)
    com, covariance = first.x[COM], first.covariance[COM, COM]
    return tuple(
        _with_errors(plane, com, covariance, heading_sd, turn_sd) if plane.strike_id in rims else plane
        for plane in planes
    )


def _with_errors(
    plane: EquiPlane, com: Array, covariance: Array, heading_sd: float, turn_sd: float
) -> EquiPlane:
    """Equi-plane over a round rim whose errors of the balance angle include those of the heading.

    The heading is the object's rotation about the vertical before the strike.

    Args:
        plane: equi-plane of the strike: plane through its pivot line and the centre of mass.
        com: (3,) centre of mass [m], in the object frame O.
        covariance: (3, 3) its covariance [m^2].
        heading_sd: standard deviation [rad] of the heading that the hand gives, each strike's own.
        turn_sd: standard deviation [rad] of the markers' common turn on the object; 0 if none is placed.
    """
    arm, along = com - plane.point, plane.direction
    aside, aside_sd = float(arm @ along), math.sqrt(float(along @ covariance @ along))
    across = float(np.linalg.norm(np.cross(arm, along)))
    per_aside = float(arm @ plane.up) / max(across, 1e-3) ** 2
    return replace(
        plane,
        sd_phi=math.hypot(plane.sd_phi, heading_sd * per_aside * math.hypot(aside, aside_sd)),
        phi_by_turn=turn_sd * per_aside * aside * plane.up if turn_sd else None,
    )
