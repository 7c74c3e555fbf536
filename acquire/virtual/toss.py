"""Toss by the virtual operator's hand: what a person makes of a planned toss, good ones and bad ones.

Frames: W (world, z up, table at z = 0) and O (the object's shape file); c is the centre of mass.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.station import G_M_S2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.hidden import HiddenBody
    from acquire.virtual.objects import VirtualObject
    from schemas.planned_toss import PlannedToss

SPIN_SCATTER = 0.2
"""largest relative error of the spin by hand"""
FLIGHT_SCATTER = 0.1
"""largest relative error of the time in the air"""
AXIS_SD_RAD = np.radians(6.0)
"""standard deviation of the spin axis about each direction across it: rarely over 10 to 15 degrees"""
HOLD_SD_RAD = np.radians(6.0)
"""standard deviation of how the object is held, about each axis"""
PLACE_M = 0.03
"""largest error of the place of release, along each axis of W [m]"""
DRIFT_M_S = 0.1
"""standard deviation of the horizontal velocity, along x and y [m/s]"""
HOLD_S = 1.0
"""time for which the hand holds the object still before it throws [s]"""


class TossKind(enum.Enum):
    """Good toss, or the one thing that is wrong with it."""

    GOOD = "good"
    """as planned, with a person's scatter"""
    SLOW = "slow"
    """0.4 to 1.1 turns a second"""
    SHORT = "short"
    """0.12 to 0.22 s in the air"""
    PRINCIPAL = "principal"
    """spin about a principal axis of inertia, to 2 degrees"""
    EARLY = "early"
    """lands on something high after 0.55 to 0.65 of the flight"""
    AWAY = "away"
    """thrown sideways out of the camera's view"""


@dataclass(frozen=True)
class TossMotion:
    """State of the object when it leaves the hand, and the height of what it falls on."""

    R_world_object: NDArray[np.float64]
    """(3, 3) rotation from O to W"""
    p_world_com: NDArray[np.float64]
    """(3,) place of c in W [m]"""
    velocity_world: NDArray[np.float64]
    """(3,) velocity of c in W [m/s]"""
    rate_object: NDArray[np.float64]
    """(3,) angular velocity along the axes of O [rad/s]"""
    cushion_z: float
    """height of the cushion's top in W [m]"""


def hand_toss(
    planned: PlannedToss,
    virtual_object: VirtualObject,
    rng: np.random.Generator,
    kind: TossKind = TossKind.GOOD,
) -> TossMotion:
    """What a person makes of a planned toss.

    The cushion's top is so high that the object touches it, in its longest direction, when c is back at the
    height of its release.

    Args:
        planned: the toss of the plan.
        virtual_object: the object, of whose true principal axes only PRINCIPAL makes use.
        rng: generator of the scatter.
        kind: what is wrong with the toss.
    """
    axis = np.array(planned.spin_axis_object)
    turns = planned.turns_per_s.target * (1 + rng.uniform(-SPIN_SCATTER, SPIN_SCATTER))
    flight = planned.flight_s.target * (1 + rng.uniform(-FLIGHT_SCATTER, FLIGHT_SCATTER))
    axis = Rotation.from_rotvec(rng.normal(0.0, AXIS_SD_RAD, 3)).apply(axis)
    held = Rotation.from_rotvec(rng.normal(0.0, HOLD_SD_RAD, 3)).as_matrix()
    place = np.array(planned.p_world_apex) + rng.uniform(-PLACE_M, PLACE_M, 3)
    place[2] -= G_M_S2 * planned.flight_s.target**2 / 8
    drift = rng.normal(0.0, DRIFT_M_S, 2)
    body = virtual_object.body
    longest = float(np.linalg.norm(virtual_object.hull_vertices - body.com_object, axis=1).max())
    cushion_z = float(place[2]) - longest
    match kind:
        case TossKind.SLOW:
            turns = rng.uniform(0.4, 1.1)
        case TossKind.SHORT:
            flight = rng.uniform(0.12, 0.22)
        case TossKind.PRINCIPAL:
            axis = _near_principal_axis(body, axis, rng)
        case TossKind.EARLY:
            time = flight * rng.uniform(0.55, 0.65)
            cushion_z += 0.5 * G_M_S2 * time * (flight - time)
        case TossKind.AWAY:
            drift = np.array([rng.choice([-1.0, 1.0]) * rng.uniform(1.5, 2.5), drift[1]])
        case TossKind.GOOD:
            pass
    return TossMotion(
        R_world_object=held @ np.array(planned.R_world_object),
        p_world_com=place,
        velocity_world=np.array([*drift, G_M_S2 * flight / 2]),
        rate_object=2 * np.pi * turns * axis,
        cushion_z=cushion_z,
    )


def _near_principal_axis(
    body: HiddenBody, axis: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Unit vector (3,) in O within about 2 degrees of the principal axis of inertia nearest to `axis`."""
    directions = np.linalg.eigh(body.inertia_com)[1].T
    along = directions @ axis
    nearest = int(np.abs(along).argmax())
    turned = Rotation.from_rotvec(np.radians(1.0) * rng.uniform(-1, 1, 3)).apply(directions[nearest])
    return np.sign(along[nearest]) * turned
