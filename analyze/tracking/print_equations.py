"""Equations of a frame's pose by its grey values; the light on each face is fitted and drops out."""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array, IntArray

LEAST_NOISE = 0.6
"""least robust scale of the residuals [grey]"""


@dataclass(frozen=True)
class PrintEquations:
    """Normal equations of one frame, with the light fitted."""

    design: Array
    """(n, 9) derivatives of the grey values, without what the light explains"""
    information: Array
    """(6, 6) information about the frame's unknowns, priors included"""
    cross: Array
    """(6, 3) with the pose at rest"""
    shared: Array
    """(3, 3) information about the pose at rest, with the frame's own unknowns fitted"""
    by_rest: Array
    """(6, 3) change of the frame's unknowns by the pose at rest"""
    prior: Array
    """(6,) information of the priors about 0"""

    @staticmethod
    def of(design: Array, light: Array, rows: Array, prior: Array) -> PrintEquations | None:
        """Equations of one frame; None if they are singular.

        Args:
            design: (n, 9) derivatives of the grey values.
            light: (n, l) terms of the light.
            rows: (n,) weights.
            prior: (6,) information of the priors about 0.
        """
        weighted = light * rows[:, None]
        inner = weighted.T @ light
        inner += 1e-9 * np.trace(inner) * np.eye(len(inner))
        try:
            free = design - light @ np.linalg.solve(inner, weighted.T @ design)
            normal = (free * rows[:, None]).T @ free
            information = normal[:6, :6] + np.diag(prior)
            by_rest = -np.linalg.solve(information, normal[:6, 6:])
        except np.linalg.LinAlgError:
            return None
        shared = normal[6:, 6:] + normal[6:, :6] @ by_rest
        return PrintEquations(free, information, normal[:6, 6:], shared, by_rest, prior)

    def step(self, weighted: Array, x: Array) -> tuple[Array, Array]:
        """Step (6,) of the unknowns `x` and gradient (3,) about the pose at rest, from weighted residuals."""
        gradient = self.design.T @ weighted
        own = np.linalg.solve(self.information, gradient[:6] - self.prior * x)
        return np.asarray(own, dtype=np.float64), gradient[6:] - self.cross.T @ own

    @property
    def covariance(self) -> Array:
        """Covariance (6, 6) of the frame's unknowns."""
        return np.asarray(np.linalg.inv(self.information), dtype=np.float64)


def light_terms(grey: Array, shading: Array, face: IntArray) -> Array:
    """Terms (m, 4 f) of the light on f faces: gain on the grey values at rest, and the shading."""
    faces = int(face.max(initial=-1)) + 1
    light = np.zeros((len(grey), faces, 4))
    light[np.arange(len(grey)), face, 0] = grey
    light[np.arange(len(grey)), face, 1:] = shading
    return light.reshape(len(grey), 4 * faces)


def contrast(grey: Array, shading: Array, face: IntArray) -> float:
    """Standard deviation of grey values (m,) about the shading of their faces [grey].

    Args:
        grey: (m,) grey values at rest.
        shading: (m, 3) terms of the shading.
        face: (m,) number of each point's face.
    """
    left = [
        grey[here] - shading[here] @ np.linalg.lstsq(shading[here], grey[here], rcond=None)[0]
        for here in (face == name for name in np.unique(face))
    ]
    return float(np.std(np.concatenate(left))) if left else 0.0


def without_light(light: Array, grey: Array, weight: Array) -> tuple[Array, float]:
    """Residuals (n,) of grey values with the light fitted, and their robust scale [grey]."""
    weighted = light * weight[:, None]
    normal = weighted.T @ light
    normal += 1e-9 * np.trace(normal) * np.eye(len(normal))
    off: Array = light @ np.linalg.solve(normal, weighted.T @ grey) - grey
    return off, max(1.4826 * float(np.median(np.abs(off))), LEAST_NOISE)
