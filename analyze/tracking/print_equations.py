"""Equations of a frame's pose by its grey values; the light on each face is fitted and drops out."""

# numpy is only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from analyze.types import Array, IntArray

LEAST_NOISE = 0.6
"""least robust scale of the residuals [grey]"""
_TUKEY = 5.0
"""residual over its robust scale at which a pixel loses its weight"""
_WAVE_PX, _MOST_WAVES = 90.0, 4
"""least half wavelength of the light over a face [px], and most terms along and across"""
_RIDGE = 1e-9
"""share of the mean that is added to the normal equations of the light"""


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
    def of(design: Array, light: Light, unit: float, prior: Array) -> PrintEquations | None:
        """Equations of one frame; None if they are singular.

        Args:
            design: (n, 9) derivatives of the grey values.
            light: the light, with the points' weights.
            unit: information of a point of weight 1 [1/grey^2].
            prior: (6,) information of the priors about 0.
        """
        try:
            free = design - light.terms @ light.fit(design)
            normal = unit * (free * light.weight[:, None]).T @ free
            information = normal[:6, :6] + np.diag(prior)
            by_rest = np.asarray(-np.linalg.solve(information, normal[:6, 6:]), dtype=np.float64)
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


class Light:
    """Light on the faces, fitted to grey values by weighted least squares.

    Args:
        terms: (n, l) terms of the light at the points.
        weight: (n,) weights of the points.
    """

    def __init__(self, terms: Array, weight: Array) -> None:
        """Factor the normal equations."""
        self.terms, self.weight = terms, weight
        self._weighted = terms * weight[:, None]
        normal = self._weighted.T @ terms
        normal[np.diag_indices_from(normal)] += _RIDGE * np.trace(normal) / max(len(normal), 1)
        self._inverse = np.linalg.inv(normal)

    def fit(self, values: Array) -> Array:
        """Coefficients (l, ...) of the light that fit values (n, ...)."""
        return np.asarray(self._inverse @ (self._weighted.T @ values), dtype=np.float64)

    def residual(self, grey: Array) -> Array:
        """Light that fits grey values (n,), minus these."""
        return np.asarray(self.terms @ self.fit(grey) - grey, dtype=np.float64)


def robust_scale(off: Array) -> float:
    """Robust scale of residuals (n,) of zero mean [grey], at least `LEAST_NOISE`."""
    return max(1.4826 * float(np.median(np.abs(off))), LEAST_NOISE)


def tukey_weights(off: Array, scale: float) -> Array:
    """Weights (n,) of residuals: 1 at 0, 0 from `_TUKEY` scales on (Beaton & Tukey 1974)."""
    return np.clip(1.0 - (off / (_TUKEY * scale)) ** 2, 0.0, None) ** 2


def light_waves(pixels: Array, face: IntArray) -> Array:
    """Waves (m, w) of the light over each point's face, 0 for those that the face has not.

    A face has products of cosines over its extent at rest, the shortest of half a wavelength `_WAVE_PX`.

    Args:
        pixels: (m, 2) places in the image at rest.
        face: (m,) number of each point's face.
    """
    waves = np.zeros((len(pixels), _MOST_WAVES**2))
    for name in range(int(face.max(initial=-1)) + 1):
        here = face == name
        low, extent = pixels[here].min(axis=0), np.maximum(np.ptp(pixels[here], axis=0), 1.0)
        counts = np.clip(np.rint(extent / _WAVE_PX).astype(int) + 1, 2, _MOST_WAVES)
        turn = math.pi * (pixels[here] - low) / extent
        across, down = (np.cos(turn[:, [axis]] * np.arange(counts[axis])) for axis in (0, 1))
        waves[here, : counts.prod()] = (across[:, :, None] * down[:, None, :]).reshape(len(turn), -1)
    return waves


def light_terms(grey: Array, waves: Array, face: IntArray) -> Array:
    """Terms (m, l) of the light: each face's waves, by themselves and times the grey values at rest.

    The first are highlights, the others light on print.

    Args:
        grey: (m,) grey values at rest.
        waves: (m, w) waves of the light.
        face: (m,) number of each point's face.
    """
    terms: list[Array] = [np.zeros((len(grey), 0))]
    for name in range(int(face.max(initial=-1)) + 1):
        own = np.where((face == name)[:, None], waves, 0.0)
        own = own[:, np.any(own != 0.0, axis=0)]
        terms += [own, 0.01 * grey[:, None] * own]
    return np.concatenate(terms, axis=1)


def contrast(grey: Array, waves: Array, face: IntArray) -> Array:
    """Grey values (m,) without what light alone would explain [grey].

    Args:
        grey: (m,) grey values at rest.
        waves: (m, w) waves of the light.
        face: (m,) number of each point's face.
    """
    light = Light(light_terms(np.zeros(len(grey)), waves, face), np.ones(len(grey)))
    return -light.residual(grey)
