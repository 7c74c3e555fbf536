"""Mean, covariance and 95 % intervals of all reported quantities, from one or many solutions.

The quantities are the centre of mass c, the inertia tensor per kilogram, and for every strike the distance R
of c from the pivot's centre line and the moments per kilogram about the line of contact and about its
parallel through c.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from analyze.estimation.joint import JointSolution
from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.geometry.second_moments import symmetric_entries, unit_inertia
from analyze.types import Array

TENSOR = slice(3, 9)
"""Indices of the tensor's entries (xx, yy, zz, xy, xz, yz) among the quantities; those of c are `COM`."""
FIRST_STRIKE_QUANTITY = 9
"""Index of the first strike's distance R among the quantities; R of all strikes, then their moments about c,
then those about the edges follow in this order."""
TAILS_95 = (0.025, 0.975)
"""Probabilities below the ends of a 95 % interval."""
QUANTILE_STEPS = 60
"""Number of bisections for a quantile."""


@dataclass(frozen=True)
class Posterior:
    """Distribution of the reported quantities: normal, or a mixture of normal distributions.

    The quantities are, in this order: centre of mass c (3) [m, in the object frame O], inertia tensor per
    kilogram about c (6: xx, yy, zz, xy, xz, yz) [m^2], then three blocks with one value per strike: distance
    R of c from the centre line of the pivot edge's rounding [m], moment per kilogram about the parallel to it
    through c [m^2], and about the line of contact with the table [m^2].
    """

    mean: Array
    """(quantities,) mean."""
    covariance: Array
    """(quantities, quantities) covariance."""
    open_directions: Array
    """(n, 3) unit directions in O along which c is open, 0 to 2; with none the distribution is normal."""
    weights: Array
    """(components,) probability of each component of the mixture."""
    means: Array
    """(components, quantities) mean of each component."""
    sds: Array
    """(components, quantities) 1 sigma of each component."""

    @property
    def linear(self) -> bool:
        """True if the distribution is normal: mean and covariance contain everything."""
        return len(self.open_directions) == 0

    @property
    def strikes(self) -> int:
        """Number of strikes."""
        return (len(self.mean) - FIRST_STRIKE_QUANTITY) // 3

    @property
    def distances(self) -> slice:
        """Slice that selects, among all quantities, the distance R of each strike.

        R is the distance [m] of the centre of mass from the pivot, counted from the centre line of the
        pivot edge's rounding.
        """
        return slice(FIRST_STRIKE_QUANTITY, FIRST_STRIKE_QUANTITY + self.strikes)

    @property
    def about_com(self) -> slice:
        """Slice of all quantities: moment of inertia per kilogram about the centre of mass, per strike.

        It is that about the parallel to the strike's pivot line through the centre of mass.
        """
        return slice(self.distances.stop, self.distances.stop + self.strikes)

    @property
    def about_edge(self) -> slice:
        """Slice of all quantities: moment of inertia per kilogram about the edge, per strike.

        It is that about the edge's line of contact with the table at balance.
        """
        return slice(self.about_com.stop, self.about_com.stop + self.strikes)

    def interval(self, index: int, relative_sd: float = 0.0) -> tuple[float, float]:
        """95 % interval (lower, upper end) of one quantity, in its unit, by the quantiles of the mixture.

        Args:
            index: Number of the quantity.
            relative_sd: 1 sigma of a further relative error of the quantity, such as that of the mass by
                which a moment per kilogram is multiplied.
        """
        means = self.means[:, index]
        sds = np.maximum(np.hypot(self.sds[:, index], relative_sd * means), 1e-300)
        low, high = (means - 8 * sds).min(), (means + 8 * sds).max()
        ends: list[float] = []
        for tail in TAILS_95:
            a, b = float(low), float(high)
            for _ in range(QUANTILE_STEPS):
                middle = (a + b) / 2
                below = float(self.weights @ _normal_cdf((middle - means) / sds))
                a, b = (middle, b) if below < tail else (a, middle)
            ends.append((a + b) / 2)
        return ends[0], ends[1]


def linear_posterior(solution: JointSolution) -> Posterior:
    """Normal distribution of the reported quantities, by linear error propagation about the solution.

    The quantities are centre of mass, inertia tensor, and three per strike (order and units: `Posterior`).
    """
    mean, by = derived(solution.model, solution.x)
    covariance = by @ solution.covariance @ by.T
    sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Posterior(mean, covariance, np.zeros((0, 3)), np.ones(1), mean[None], sds[None])


def mixture_posterior(
    open_directions: Array, weights: Array, means: Array, covariances: Array, steps: Array
) -> Posterior:
    """Mixture of normal distributions of the reported quantities (order and units: `Posterior`).

    Args:
        open_directions: (n, 3) unit directions, in the object frame O, along which the strikes leave the
            centre of mass open.
        weights: (components,) probabilities.
        means: (components, quantities) means.
        covariances: (components, quantities, quantities) covariances.
        steps: (components, n, quantities) difference of the means over the part of each open direction that a
            component stands for; a uniform distribution over it is added to the component's covariance.
    """
    covariances = covariances + np.einsum("snq,snr->sqr", steps, steps) / 12
    mean = weights @ means
    apart = means - mean
    covariance = np.einsum("s,sqr->qr", weights, covariances) + (apart * weights[:, None]).T @ apart
    sds = np.sqrt(np.maximum(np.einsum("sqq->sq", covariances), 0.0))
    return Posterior(mean, covariance, open_directions, weights, means, sds)


def derived(model: JointModel, x: Array) -> tuple[Array, Array]:
    """Reported quantities (quantities,) at the model's unknowns `x` (count,), and their derivatives by x.

    The quantities are centre of mass, inertia tensor, and three per strike (order and units: `Posterior`);
    the derivatives are (quantities, count).
    """
    J, by = unit_inertia(x[SECOND])
    to_com, to_tensor = np.zeros((3, len(x))), np.zeros((6, len(x)))
    to_com[:, COM], to_tensor[:, SECOND] = np.eye(3), symmetric_entries(by).T
    about_com, by_com = model.about_com(x)
    about_edge, by_edge = model.about_edge(x)
    values = np.concatenate([x[COM], symmetric_entries(J), model.distances(x), about_com, about_edge])
    return values, np.vstack([to_com, to_tensor, model.distance_design(x), by_com, by_edge])


def _normal_cdf(z: Array) -> Array:
    """Probability that a standard normal variable lies below each entry of `z`, in the shape of `z`."""
    return np.asarray(ndtr(z), dtype=np.float64)
