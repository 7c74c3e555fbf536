"""The rounding that a shape itself has where the face that it stands on ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.motion.support_function import from_outline
from analyze.motion.rolling_choice import is_curved_to

if TYPE_CHECKING:
    from analyze.types import Array

_LIFTED, _UNSURE = math.radians(3.0), math.radians(5.0)
"""from where on, and to how far past phi, a rounding must be a circle"""
_CIRCLE = 0.1
"""of its radius, by which centre and radius may vary on the way"""
_STANDS = 0.5
"""of its radius, that the face is long at least: else it is a facet of something round"""


def moulded_radius(points: Array, phi: float) -> float | None:
    """Radius [m] of the rounding; its centre is straight above where the face ends. None: there is none, or one that is no circle.

    Args:
        points: (n, 2) m, x (the way it tips) and z of the hull's corners, from where the face ends.
        phi: rad, about where it balances.
    """
    try:
        section = from_outline(points, np.zeros(2))
    except EstimationError:
        return None
    behind, before = (float(section.at(np.array(theta))[1]) for theta in (-_LIFTED, _LIFTED))
    turned = np.linspace(_LIFTED, phi + _UNSURE, 9).tolist()
    if not is_curved_to(section, phi) or not all(section.of_shape(theta) for theta in turned):
        return None
    along, over, radius = np.array([section.centre(theta) for theta in turned]).T
    middle = float(np.median(radius))
    away = float(np.max(np.abs([along, over - middle, radius - middle])))
    return middle if away < _CIRCLE * middle and before - behind > _STANDS * middle else None
