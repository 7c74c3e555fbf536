"""Impact of the striker's tip on an object that pivots about an edge, for planner and session.

The tip (effective mass m_s, speed v) meets the object at height h over the pivot edge, about which the
object's moment of inertia is I. At the impact point the object resists like a free mass I/h^2, so with
restitution e the impulse is

    J = (1 + e)*v / (1/m_s + h^2/I)

and the object starts to tip with the angular velocity J*h/I (docs/explanation/method.md, section 1.5: the
VISAPP 2013 paper's eq. 2 as an impulse; the two-body impact is W. J. Stronge, Impact Mechanics, 2000, chapter
2).

The simulator (`acquire.virtual`) does not use this module: it integrates contact forces.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Real = TypeVar("Real", float, "NDArray[np.float64]")


def inverse_impact_mass(inverse_striker_mass: Real, height: float | Real, i_edge: Real) -> Real:
    """Inverse of the reduced mass of striker and object at the impact point, 1/m_s + h^2/I [1/kg].

    Args:
        inverse_striker_mass: 1/m_s [1/kg], inverse of the striker's effective mass at its tip, a number or
            (n,).
        height: h [m], height of the impact point over the pivot edge, a number or (n,).
        i_edge: I [kg m^2], the object's moment of inertia about the pivot edge, a number or (n,).

    Returns:
        A number, or (n,) if an argument is an array.
    """
    return inverse_striker_mass + height**2 / i_edge


def tip_speed_for_impulse(impulse: float, restitution: float, inverse_mass: float) -> float:
    """Tip speed v [m/s] that gives the impulse J [N s] on the object: v = J*(1/m_s + h^2/I) / (1 + e).

    m_s is the striker's effective mass at its tip, h the height of the impact point over the pivot edge, I
    the object's moment of inertia about that edge. All arguments and the result are single numbers.

    Args:
        impulse: J [N s].
        restitution: e, coefficient of restitution of tip and object, from 0 to 1.
        inverse_mass: 1/m_s + h^2/I [1/kg], inverse of the reduced mass, from `inverse_impact_mass`.
    """
    return impulse * inverse_mass / (1 + restitution)
