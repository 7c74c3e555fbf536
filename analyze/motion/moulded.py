"""Rounding that the object's shape itself has at the end of its resting face, as moulded parts have."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.rolling_choice import is_curved
from analyze.motion.support_function import support_of_outline

if TYPE_CHECKING:
    from analyze.types import Array

_FIRST_ANGLE, _PAST_PHI = math.radians(3.0), math.radians(5.0)
"""a rounding must be a circle from the first of these angles after rest to the second past phi [rad]"""
_MAX_VARIATION = 0.1
"""largest variation of centre and radius in that range, over the radius"""
_MIN_FACE_RATIO = 0.5
"""least length of the resting face over the radius; a shorter face is a facet of a round body"""


def moulded_radius(points: Array, phi: float) -> float | None:
    """Radius [m] of a rounding that belongs to the shape itself at the edge it tips over; None if none.

    Moulded parts have such roundings. There is one if the contact rolls on one circle while the object tips
    from 3 deg after rest to 5 deg past the balance angle: the circle's centre stays above the end of the flat
    resting face, and its radius stays constant, both within 10 % of the radius. Besides, from 1 deg after
    rest to 25 deg past the balance angle, curves of more than 0.5 mm radius must touch the table over more
    than 15 deg, and no flat face of 0.5 mm or more may come to lie on it: above a balance angle of 65 deg the
    next face of a square corner does. The resting face must be longer than half the radius; otherwise it is a
    facet of a round body. None also if the points span no area.

    Args:
        points: (n, 2) the shape's hull corners projected along the pivot edge [m], relative to the end of the
            resting face: x in the direction of tipping, z up.
        phi: expected balance angle [rad], at which the centre of mass stands above the contact.
    """
    try:
        section = support_of_outline(points, np.zeros(2))
    except EstimationError:
        return None
    behind, before = (float(section.evaluate(np.array(theta))[1]) for theta in (-_FIRST_ANGLE, _FIRST_ANGLE))
    turned = np.linspace(_FIRST_ANGLE, phi + _PAST_PHI, 9).tolist()
    if not is_curved(section, phi) or not all(section.touches_curve(theta) for theta in turned):
        return None
    along, over, radius = np.array([section.centre(theta) for theta in turned]).T
    middle = float(np.median(radius))
    away = float(np.max(np.abs([along, over - middle, radius - middle])))
    return middle if away < _MAX_VARIATION * middle and before - behind > _MIN_FACE_RATIO * middle else None
