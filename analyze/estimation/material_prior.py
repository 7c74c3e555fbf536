"""Prior of the densities of an object's parts: a part may be of the same material as another one.

Assemblies are made of few materials. Where moments do not distinguish two parts (a sleeve around a core), a
uniform prior of both densities puts the estimate in the middle of what the bounds leave open, at densities
that no part nearby has.
"""

from __future__ import annotations

import math

import numpy as np

from analyze.types import Array

LIKE_PROBABILITY = 0.5
"""Prior probability that a part is of a material like that of a larger part."""
LIKE_DENSITY_SD = 400.0
"""Standard deviation [kg/m^3] of the density difference of like materials (kinds of wood, of plastic, steel
and brass)."""


def log_material_prior(masses: Array, volumes: Array, highest: float) -> Array:
    """Log prior density (m,) of m sets of n parts' masses, over that of independent uniform densities.

    The density of the largest part is uniform from 0 to `highest`. That of each other part is so with
    probability 1 - `LIKE_PROBABILITY`; otherwise it is normal about the density of a larger part, each of
    which is equally probable, with the standard deviation `LIKE_DENSITY_SD`.

    Args:
        masses: (m, n) masses of the parts [kg].
        volumes: (n,) their volumes [m^3].
        highest: Largest possible density [kg/m^3].
    """
    largest_first = np.argsort(-volumes, kind="stable")
    densities = (masses / volumes)[:, largest_first]
    peak = highest / (LIKE_DENSITY_SD * math.sqrt(2.0 * math.pi))
    total = np.zeros(len(masses))
    for part in range(1, len(volumes)):
        apart = (densities[:, part, None] - densities[:, :part]) / LIKE_DENSITY_SD
        like = peak * np.exp(-0.5 * apart**2).mean(axis=1)
        total += np.log(1.0 - LIKE_PROBABILITY + LIKE_PROBABILITY * like)
    return total
