"""Masses of an object's labelled parts from its moments (docs/explanation/method.md, section 6).

Masses of shell and interior parts, without labels, are in region_masses.py.

The measured quantities are linear in the parts' masses x: sum x = m, sum x (c_p - c) = 0, sum x l.I_p(c).l =
I_c,l; m is the object's mass, c its centre of mass, I_c,l its moment about the line l through c, c_p a part's
centroid and I_p(c) its inertia per kilogram about c. No mass is negative and no part denser than lead: the
likelihood is a normal distribution truncated at these bounds. By the prior (material_prior.py) parts may be
of one material. Parts whose mixture the moments alone leave open within the bounds are reported as not
observed: the prior decides their masses.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import chdtrc

from analyze.errors import EstimationError
from analyze.estimation.cells import Cells
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.material_prior import log_material_prior
from analyze.estimation.shape_errors import ShapeErrors
from analyze.estimation.truncated_normal import draw_truncated, shortest_intervals
from analyze.geometry.object_model import LEVER_ERROR, MODEL_ERROR
from analyze.geometry.plausible_size import DENSITIES
from analyze.geometry.polyhedron import MassProperties
from analyze.geometry.second_moments import symmetric_entries
from analyze.types import Array

MIN_PROBABILITY = 0.01
"""Probability of a chi^2 by chance below which parts do not explain the moments."""
_MAX_DENSITY = DENSITIES[1]
"""Largest density of a part [kg/m^3], about that of lead."""
_CHAINS, _STEPS, _BURN_IN_STEPS = 200, 100, 40
"""Number of chains, of their steps, and of the first steps that are dropped."""
_DIFFERENCE_MOVES = 0.6
"""Share of moves along the difference of two other chains, which follows the bounds."""
_PRIOR_SD_OVER_MASS = 2.0
"""Prior sd of a part's mass over the object's mass; wide, since zero and the object's mass bound it too."""
_CENTRE_ITERATIONS = 2
"""Number of times that the c of the parts, about which moments are taken, is updated."""
_MASS_BOUND_SIGMAS = 5.0
"""Standard deviations by which a part's upper bound exceeds the object's mass."""
_SHAPE_STEP = 0.1
"""Step of the derivatives by an error of the shape, in units of its standard deviation."""
_AT_BOUND = 1e-5
"""Distance of a mass from a bound, over its possible range, within which it is at the bound."""
_UNOBSERVED_WIDTH = 0.5
"""Width of a part's interval over its possible range from which on it counts as not observed."""


def whitening_matrix(covariance: Array) -> Array:
    """Matrix (n, n) that turns errors with `covariance` (n, n) into independent errors of unit sd.

    Eigenvalues of the correlation matrix are bounded below by 1e-9 of the largest.
    """
    size = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    return np.asarray((vectors / np.sqrt(np.maximum(values, 1e-9 * values.max()))).T / size, dtype=np.float64)


@dataclass(frozen=True)
class MeasuredMoments:
    """Measured mass, centre of mass c and moments of inertia about `a` axes through c, with covariance.

    c and the axes are in the object frame O, units are SI.
    """

    mass: float
    """Mass [kg]."""
    com: Array
    """(3,) centre of mass c [m], in the object frame O."""
    directions: Array
    """(a, 3) unit directions of the axes through c, in O."""
    moments: Array
    """(a,) moments of inertia about the axes in `directions` [kg m^2]."""
    covariance: Array
    """(4 + a, 4 + a) covariance of mass, c and the moments, in this order."""

    def whitening(self) -> tuple[Array, Array]:
        """Whitening matrix W (4 + a, 4 + a) of the measurements, and the measurements (4 + a,) times W.

        The measurements are the mass, the first moment (3) and one moment of inertia for each of the a axes.
        The first moment is taken about the measured centre of mass, where it is 0. W makes the errors
        independent and of unit sd.
        """
        target = np.concatenate([[self.mass], np.zeros(3), self.moments])
        covariance = self.covariance.copy()
        # First moments are c times the mass: their rows and columns are scaled by it.
        covariance[1:4] *= self.mass
        covariance[:, 1:4] *= self.mass
        whiten = whitening_matrix(covariance)
        return whiten, whiten @ target

    def by_cell(self, cells: Cells, about: Array) -> Array:
        """Mass, first moment and moments of inertia (n, 4 + a) of a kilogram in each of n cells.

        Columns: 1; first moment (3) [m] about the measured centre of mass; moments of inertia [m^2] about a
        lines. The lines have the a directions about which moments were measured, and pass through the point
        `about` (3,) [m]. All are in the object frame O.
        """
        arm = cells.points - about
        off_axes = np.sum(arm**2, axis=1)[:, None] - (arm @ self.directions.T) ** 2
        across = off_axes + cells.own_inertia[:, None]
        return np.column_stack([np.ones(len(arm)), cells.points - self.com, across])


@dataclass(frozen=True)
class PartMasses:
    """Posterior of the masses of an object's n labelled parts: means, covariance and 95 % intervals."""

    names: tuple[str, ...]
    """Names of the parts."""
    masses: Array
    """(n,) posterior means [kg]."""
    covariance: Array
    """(n, n) posterior covariance [kg^2]."""
    intervals: Array
    """(n, 2) shortest intervals that contain 95 % [kg]."""
    observed: tuple[bool, ...]
    """False for a part whose 95 % interval by the moments alone (without the prior of materials) is at least
    half as wide as its possible range, and for all parts if they do not explain the moments."""
    volumes: Array
    """(n,) volumes of the parts [m^3]."""
    uniform: Array
    """(n,) naive answer [kg]: one density for all parts."""
    misfit: float
    """Rms of the standardised residuals at the best masses."""
    probability: float
    """Probability of so large a chi^2 of the moments by chance; 1 if there are no more moments than parts."""

    @property
    def explained(self) -> bool:
        """True if uniform parts of these shapes explain the measured moments within their errors.

        Otherwise a part is missing, not uniform, or of another shape, and the masses' intervals do not hold.
        """
        return self.probability >= MIN_PROBABILITY


def measured_moments(parameters: InertialParameters) -> MeasuredMoments:
    """Measured mass m, centre of mass c and moments about the struck axes through c, with covariance.

    m [kg], c (3,) [m] and the a moments (a,) [kg m^2] are those of `parameters`, in the object frame O; their
    covariance is (4 + a, 4 + a), in this order. To it the error of modelling the body by cells (small pieces)
    is added: 0.1 mm of c along each axis of O (`LEVER_ERROR`) and 0.4 % of each moment (`MODEL_ERROR`).
    """
    mass, moments = parameters.mass, np.array([axis.i_com for axis in parameters.axes])
    model = np.concatenate([[0.0], np.full(3, LEVER_ERROR), MODEL_ERROR * moments])
    directions = np.array([axis.direction for axis in parameters.axes]).reshape(-1, 3)
    return MeasuredMoments(
        mass, parameters.com.position, directions, moments, parameters.joint_covariance + np.diag(model**2)
    )


def part_masses(
    moments: MeasuredMoments,
    names: Sequence[str],
    parts: Sequence[MassProperties],
    rng: np.random.Generator,
    errors: ShapeErrors | None = None,
) -> PartMasses:
    """Posterior of the masses of uniform parts given the moments of the whole object.

    It is sampled by hit-and-run chains (Smith 1984, Operations Research 32) along directions drawn from the
    unbounded likelihood or from other chains (ter Braak 2006, Statistics and Computing 16). The chains thus
    mix well although the posterior is much narrower in some directions (the sum of the masses, the mass of a
    small part) than in others. Each step is accepted by the ratio of the priors of its ends (Metropolis).

    Args:
        moments: Measured mass, centre of mass and moments of the whole object.
        names: Names of the n parts.
        parts: Volume, centroid in the object frame O and inertia about it per kilogram of each part.
        rng: Random generator of the chains; the same seed gives the same result.
        errors: Errors of the shape, which move and stretch the parts; None for an exact shape.

    Returns:
        Means (n,) [kg], covariance (n, n) [kg^2] and 95 % intervals (n, 2) [kg] of the masses, and which of
        them the moments determine.

    Raises:
        EstimationError: fewer than two parts, or a part without volume.
    """
    volumes = np.array([part.volume for part in parts])
    if len(parts) < 2 or volumes.min() <= 0:
        raise EstimationError(
            f"{len(parts)} parts: masses of parts need at least two parts, each with a volume: check the "
            "labels"
        )
    uniform = moments.mass * volumes / volumes.sum()
    most = np.minimum(
        _MAX_DENSITY * volumes, moments.mass + _MASS_BOUND_SIGMAS * math.sqrt(float(moments.covariance[0, 0]))
    )
    prior = np.eye(len(parts)) / (_PRIOR_SD_OVER_MASS * moments.mass) ** 2
    if errors is not None:
        parts = errors.moved(parts, errors.mean)
    about, likeliest, updates = moments.com, uniform, 0
    while True:
        compared = moments if errors is None else _with_shape_errors(moments, parts, likeliest, errors)
        rows, target = _whitened(compared, parts, about)
        precision = rows.T @ rows + prior
        mean: Array = np.asarray(
            np.linalg.solve(precision, rows.T @ target + prior @ uniform), dtype=np.float64
        )
        likeliest = _bounded_mode(mean, precision, most)
        if updates == _CENTRE_ITERATIONS:
            break
        updates += 1
        about = likeliest @ np.array([part.centroid for part in parts]) / likeliest.sum()
    log_prior = partial(log_material_prior, volumes=volumes, highest=_MAX_DENSITY)
    by_moments = _sample(mean, precision, likeliest, most, lambda masses: np.zeros(len(masses)), rng)
    low, high = shortest_intervals(by_moments, 0.0)
    open_range = (high - low) / most
    draws = _sample(mean, precision, likeliest, most, log_prior, rng)
    low, high = shortest_intervals(draws, 0.0)
    residual = rows @ likeliest - target
    probability = _probability_by_chance(rows, residual, likeliest, most)
    explained = probability >= MIN_PROBABILITY
    return PartMasses(
        names=tuple(names),
        masses=draws.mean(axis=0),
        covariance=np.cov(draws.T),
        intervals=np.stack([low, high], axis=1),
        observed=tuple(explained and bool(part) for part in open_range < _UNOBSERVED_WIDTH),
        volumes=volumes,
        uniform=uniform,
        misfit=float(np.sqrt(np.mean(residual**2))),
        probability=probability,
    )


def _probability_by_chance(rows: Array, residual: Array, masses: Array, most: Array) -> float:
    """Probability that measurement errors alone make the moments fit the n parts' masses this badly.

    It is that of a chi^2 at least as large as the sum of squared residuals at the best masses. Of the 4 + a
    degrees of freedom, each combination of masses that the moments determine takes one, except masses at
    their bounds; the probability is 1 if none is left.

    Args:
        rows: (4 + a, n) whitened design matrix: what a kilogram of each part contributes to the object's
            mass, to its first moment (3) and to its a moments of inertia, scaled so that measurement errors
            are independent with unit sd.
        residual: (4 + a,) residuals at the best masses, scaled likewise.
        masses: (n,) best masses [kg].
        most: (n,) upper bounds of the masses [kg].
    """
    free = (masses > _AT_BOUND * most) & (masses < (1 - _AT_BOUND) * most)
    scaled = rows[:, free] * most[free]
    rank = int(np.linalg.matrix_rank(scaled, tol=1.0)) if free.any() else 0
    freedom = len(residual) - rank
    return 1.0 if freedom < 1 else float(chdtrc(freedom, float(residual @ residual)))


def _whitened(moments: MeasuredMoments, parts: Sequence[MassProperties], about: Array) -> tuple[Array, Array]:
    """Whitened design matrix (4 + a, n) and measurements (4 + a,) of the problem of n parts' masses.

    The matrix times the masses [kg] is to equal the measurements. Its rows are the mass [kg], the first
    moment (3) about the measured centre of mass [kg m], and the moments of inertia about the a measured axes
    through `about` [kg m^2]; a column is what a kilogram of one part contributes. Both results are multiplied
    by the matrix that makes the measurements' errors independent and of unit sd.

    The moments of inertia were measured about the true centre of mass; `about` should be close to it. For a
    slender body the measured centre of mass is not close enough: the square of its error along the body,
    times the mass, exceeds the error of the moment. The centre of mass of the estimated parts is closer.

    Args:
        moments: measured mass, centre of mass and moments of inertia, with their covariance.
        parts: the n parts, each of uniform density.
        about: (3,) centre of mass in the object frame O [m], as measured or of the estimated parts.
    """
    whiten, target = moments.whitening()
    return whiten @ _design(moments, parts, about), target


def _design(moments: MeasuredMoments, parts: Sequence[MassProperties], about: Array) -> Array:
    """Mass, first moment and moments of inertia (4 + a, n) of a kilogram of each of n parts.

    Rows: 1; first moment (3) [m] about the measured centre of mass; moments of inertia [m^2] about the a
    measured axes through the point `about` (3,) [m], in the object frame O.
    """
    columns = []
    for part in parts:
        arm = part.centroid - about
        inertia = part.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm)
        along = np.einsum("ai,ij,aj->a", moments.directions, inertia, moments.directions)
        columns.append(np.concatenate([[1.0], part.centroid - moments.com, along]))
    return np.array(columns).T


def _with_shape_errors(
    moments: MeasuredMoments, parts: Sequence[MassProperties], masses: Array, errors: ShapeErrors
) -> MeasuredMoments:
    """Measured moments with the covariance of their difference from those of the parts.

    A shape error moves parts and measured centre of mass together, so that the difference may err less than
    either. The derivatives of the moments of the n uniform `parts` by the errors of the shape are taken at
    `masses` (n,) [kg], by finite differences.
    """
    centre = masses @ np.array([part.centroid for part in parts]) / masses.sum()
    count = len(errors.mean)

    def moments_of(step: Array) -> Array:
        return _design(moments, errors.moved(parts, step), centre) @ masses

    unit = _SHAPE_STEP * np.eye(count)
    by = np.array([(moments_of(step) - moments_of(-step)) / (2 * _SHAPE_STEP) for step in unit]).T
    # Compared are c, the first moment over the mass, and moments of inertia.
    by[1:4] /= moments.mass
    lines = moments.directions[:, :, None] * moments.directions[:, None, :]
    along = symmetric_entries(lines) * [1, 1, 1, 2, 2, 2] * moments.mass
    shared = np.vstack([np.zeros((1, count)), errors.with_com, along @ errors.with_tensor])
    crossed = by @ shared.T
    covariance = moments.covariance + by @ errors.covariance @ by.T - crossed - crossed.T
    return replace(moments, covariance=covariance)


def _bounded_mode(mean: Array, precision: Array, most: Array) -> Array:
    """Likeliest n masses (n,) [kg] by a normal distribution, each mass bounded by 0 and `most` (n,) [kg].

    `mean` (n,) [kg] and `precision` (n, n) [1/kg^2], the inverse covariance, are those before truncation at
    the bounds. The result is kept 1e-6 of `most` inside the bounds.
    """
    values, vectors = np.linalg.eigh(precision)
    root = (vectors * np.sqrt(values)).T * most
    share = lsq_linear(root, root @ (mean / most), bounds=(0.0, 1.0)).x
    return most * np.clip(share, 1e-6, 1.0 - 1e-6)


def _sample(
    mean: Array,
    precision: Array,
    start: Array,
    most: Array,
    log_prior: Callable[[Array], Array],
    rng: np.random.Generator,
) -> Array:
    """Random draws (draws, n) [kg] of n masses from their posterior, within 0 .. `most` (n,).

    The likelihood is normal; `mean` (n,) and `precision` (n, n), the inverse covariance, are those before
    truncation. `log_prior` computes the log prior densities (m,) of m sets of masses (m, n). The draws are
    the positions of `_CHAINS` Markov chains, which all begin at `start` (n,); their first `_BURN_IN_STEPS`
    steps are dropped.
    """
    values, vectors = np.linalg.eigh(precision)
    spread = vectors / np.sqrt(values)
    x = np.tile(start, (_CHAINS, 1))
    prior = log_prior(x)
    halves = np.arange(_CHAINS // 2), np.arange(_CHAINS // 2, _CHAINS)
    kept = []
    for step in range(_STEPS):
        for _ in range(len(mean)):
            for moved, others in (halves, halves[::-1]):
                direction = rng.standard_normal((len(moved), len(mean))) @ spread.T
                if rng.uniform() < _DIFFERENCE_MOVES:
                    pair = others[rng.integers(len(others), size=(2, len(moved)))]
                    # Where the two chains coincide, the drawn direction is kept.
                    apart = x[pair[0]] - x[pair[1]]
                    direction = np.where((apart != 0.0).any(axis=1)[:, None], apart, direction)
                proposed = _draw_on_lines(x[moved], direction, mean, precision, most, rng)
                prior_proposed = log_prior(proposed)
                accepted = rng.exponential(size=len(moved)) > prior[moved] - prior_proposed
                x[moved[accepted]] = proposed[accepted]
                prior[moved[accepted]] = prior_proposed[accepted]
        if step >= _BURN_IN_STEPS:
            kept.append(x.copy())
    return np.concatenate(kept)


def _draw_on_lines(
    x: Array, direction: Array, mean: Array, precision: Array, most: Array, rng: np.random.Generator
) -> Array:
    """One draw (m, n) on each of m lines x + t d, from a bounded normal distribution of n quantities.

    Along a line the log density is -(b t + a t^2 / 2), with a = d.precision.d and b = d.precision.(x - mean).
    `x` and `direction` d are (m, n), the bounds 0 and `most` (n,); `mean` (n,) and `precision` (n, n), the
    inverse covariance, are those before truncation.
    """
    by_precision = direction @ precision
    a = (by_precision * direction).sum(axis=1)
    b = (by_precision * (x - mean)).sum(axis=1)
    forward, back = direction > 0, direction < 0
    with np.errstate(divide="ignore", invalid="ignore"):
        to_zero, to_most = -x / direction, (most - x) / direction
    low = np.where(forward, to_zero, np.where(back, to_most, -np.inf)).max(axis=1)
    high = np.where(forward, to_most, np.where(back, to_zero, np.inf)).min(axis=1)
    moved = x + draw_truncated(-b / a, 1.0 / np.sqrt(a), low, high, rng)[:, None] * direction
    return np.minimum(np.maximum(moved, 0.0), most)
