"""Measured phi and ln k of the strikes with their own errors, and their standardised residuals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analyze.estimation.joint_model import JointModel
from analyze.types import Array, EquiPlane


@dataclass(frozen=True)
class StrikeData:
    """Measured ln k (strikes,) of all strikes, and matrices (strikes, 2, 2) that whiten their residuals.

    Residuals are those of (phi, ln k): phi is the balance angle [rad], k the rate constant [rad/s^2] of the
    motion theta'' = -k sin(phi - theta) of the tipping angle theta. Whitened residuals are independent and
    have unit sd.
    """

    log_k: Array
    """(strikes,) ln k, k in [rad/s^2]; 0 where it is not used."""
    uses_k: Array
    """(strikes,) 1 where k is used, else 0."""
    whiten: Array
    """(strikes, 2, 2) matrices W; W^T W is the inverse covariance of (phi, ln k)."""

    @property
    def parts(self) -> Array:
        """Number (strikes,) of measured quantities used of each strike: 1 (balance angle) or 2 (also k).

        k is the rate constant of the tipping motion.
        """
        return 1.0 + self.uses_k

    @property
    def precisions(self) -> Array:
        """Inverse covariances (strikes, 2, 2) of balance angle [rad] and ln k; 0 for a k that is not used.

        k is the rate constant [rad/s^2] of the tipping motion theta'' = -k sin(phi - theta).
        """
        return np.swapaxes(self.whiten, 1, 2) @ self.whiten


def strike_data(planes: Sequence[EquiPlane], scatter_sd: float, with_k: bool) -> StrikeData:
    """Measured ln k of the strikes, which of them use it, and matrices that whiten errors of (phi, ln k).

    These are ln k (strikes,), 1 or 0 (strikes,), and matrices (strikes, 2, 2), by which errors are multiplied
    to be independent and have unit sd. phi is the balance angle [rad]; k is the rate constant of the motion
    [rad/s^2], used only if `with_k` is True, and only of strikes that have a k with an sd. Where it is not
    used, ln k and the second row of the matrix (2, 2) are 0.

    Args:
        planes: one per strike, through its pivot line and the centre of mass, with measured phi and k.
        scatter_sd: 1 sigma [rad] of phi from strike to strike, beyond the error of the fit; 0 for the error
            of the fit alone.
        with_k: True to use k.
    """
    n = len(planes)
    covariance = np.tile(np.eye(2), (n, 1, 1))
    log_k, uses_k = np.zeros(n), np.zeros(n)
    for i, plane in enumerate(planes):
        covariance[i, 0, 0] = plane.sd_phi**2 + scatter_sd**2
        if with_k and plane.k is not None and plane.sd_k:
            log_k[i], uses_k[i] = np.log(plane.k), 1.0
            covariance[i, 1, 1] = (plane.sd_k / plane.k) ** 2
            covariance[i, 0, 1] = covariance[i, 1, 0] = plane.cov_phi_k / plane.k
    # Upper triangular: the first row is phi's error given that of k.
    whiten = np.swapaxes(np.asarray(np.linalg.cholesky(np.linalg.inv(covariance)), dtype=np.float64), 1, 2)
    whiten[uses_k == 0, 1] = 0.0
    return StrikeData(log_k, uses_k, whiten)


def whitened(model: JointModel, data: StrikeData, x: Array) -> tuple[Array, Array]:
    """Standardised residuals (strikes, 2) of (phi, ln k) and their derivatives (strikes, 2, count).

    phi is the balance angle, k the rate constant of the motion, count the number of unknowns. A residual is
    the modelled minus the measured value, at the unknowns `x` (count,); it is 0 for an ln k that is not used.
    """
    log_k, by_log_k = model.log_k(x)
    both = np.stack([model.residual(x), (log_k - data.log_k) * data.uses_k], axis=1)
    rows = np.stack([model.design(x), by_log_k * data.uses_k[:, None]], axis=1)
    return np.einsum("sij,sj->si", data.whiten, both), np.einsum("sij,sjc->sic", data.whiten, rows)
