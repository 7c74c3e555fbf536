"""Rounding of the shape itself at the end of its resting face."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.rolling_choice import is_curved_to
from analyze.motion.support_function import support_of_outline

if TYPE_CHECKING:
    from analyze.types import Array

_FIRST_ANGLE, _PAST_PHI = math.radians(3.0), math.radians(5.0)
"""angles [rad] from rest and past phi between which a rounding must be a circle"""
_MAX_VARIATION = 0.1
"""largest variation of centre and radius on the way, over the radius"""
_MIN_FACE_RATIO = 0.5
"""least length of the resting face over the radius; a shorter one is a facet of something round"""


def moulded_radius(points: Array, phi: float) -> float | None:
    """Radius [m] of the rounding, whose centre is straight above the end of the face.

    None if there is no circular rounding.

    Args:
        points: (n, 2) x (towards where it tips) and z of the hull's corners from the end of the face [m].
        phi: expected balance angle [rad].
    """
    try:
        section = support_of_outline(points, np.zeros(2))
    except EstimationError:
        return None
    behind, before = (float(section.evaluate(np.array(theta))[1]) for theta in (-_FIRST_ANGLE, _FIRST_ANGLE))
    turned = np.linspace(_FIRST_ANGLE, phi + _PAST_PHI, 9).tolist()
    if not is_curved_to(section, phi) or not all(section.of_shape(theta) for theta in turned):
        return None
    along, over, radius = np.array([section.centre(theta) for theta in turned]).T
    middle = float(np.median(radius))
    away = float(np.max(np.abs([along, over - middle, radius - middle])))
    return middle if away < _MAX_VARIATION * middle and before - behind > _MIN_FACE_RATIO * middle else None
