"""Bodies that a strike is simulated with: as estimated, of uniform density, and as a thin shell.

The last two are what a simulator's user has without a measurement: the shape and the mass.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from analyze.export.body import Inertial

if TYPE_CHECKING:
    from analyze.estimation.mass_properties import InertialParameters
    from analyze.geometry.object_model import ObjectModel

ESTIMATED, UNIFORM, SHELL = "estimated", "uniform", "shell"
"""names of the assets"""


@dataclass(frozen=True)
class Asset:
    """Inertial parameters to simulate with, under a name."""

    name: str
    """estimated, uniform or shell"""
    inertial: Inertial
    """mass, centre of mass and inertia"""


def strike_assets(model: ObjectModel, struck: InertialParameters) -> tuple[Asset, Asset, Asset]:
    """Estimated, uniform and shell body of one mass.

    Args:
        model: exterior of the body that tips.
        struck: its estimated inertial parameters.
    """
    mass = struck.mass
    return (
        Asset(ESTIMATED, Inertial(mass, struck.com.position, struck.inertia)),
        Asset(UNIFORM, Inertial(mass, model.centroid, mass * model.unit_inertia)),
        Asset(SHELL, shell_inertial(model, mass)),
    )


def shell_inertial(model: ObjectModel, mass: float) -> Inertial:
    """Inertial parameters of a mass [kg] spread evenly over a body's surface."""
    corners = model.vertices[model.faces]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    share, centre = area / area.sum(), corners.mean(axis=1)
    com = share @ centre
    arms, middle = corners - com, centre - com
    # Second moments of a triangle: (sum of its corners' + 9 times its centroid's) / 12.
    second = np.einsum("f,fki,fkj->ij", share, arms, arms) / 12
    second += 0.75 * np.einsum("f,fi,fj->ij", share, middle, middle)
    inertia = mass * (np.trace(second) * np.eye(3) - second)
    return Inertial(mass, com, 0.5 * (inertia + inertia.T))
