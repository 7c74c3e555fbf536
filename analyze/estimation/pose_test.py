"""Test of the poses of a body: do the planes of all strikes meet in one centre of mass c?

Contents that move lie elsewhere when the body is put down on another face. The statistic is the decrease of
chi^2 by a c of its own for each pose, in the directions that the strikes determine; the errors that strikes
share are integrated out. The strike that explains most of it is left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analyze.estimation.detection import critical_value, noncentrality
from analyze.estimation.joint_model import COM, SECOND, JointModel
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import Array, EquiPlane

MIN_SHIFT_INFORMATION = 100.0
"""Least information about a shift of c between poses that counts as determined, in units of the inverse
variance of c before any strike."""
LEVEL_OFFSET = 0.25
"""Distance of a liquid's centre from the middle of a half filled body, over the body's extent upwards."""
MIN_POSES = 2
"""Fewest poses that are compared."""
POSE_SHIFT = 0.2
"""1 sigma of the shift of a pose's c from that common to all poses, over half the body's extents."""
POSE_STEPS = 4
"""Number of Gauss-Newton steps for the centres of mass of the poses."""


@dataclass(frozen=True)
class PoseCentre:
    """Centre of mass of the body as it rests on one face, by the strikes made there."""

    face: str
    """Id of the face."""
    up: Array
    """(3,) direction that points upwards at rest, in O."""
    position: Array
    """(3,) centre of mass [m], in O."""
    covariance: Array
    """(3, 3) its covariance [m^2], errors that strikes share included."""
    residual: float
    """Rms distance [m] of the centre of mass of all poses together from the planes of this pose."""


@dataclass(frozen=True)
class PoseShift:
    """Test of one centre of mass for all poses against one for each."""

    centres: tuple[PoseCentre, ...]
    """Centre of mass of each pose."""
    largest_shift: float
    """Largest shift of c between two poses along a direction that the strikes determine [m]."""
    chi_squared: float
    """Decrease of chi^2 by a centre of mass of its own for each pose."""
    freedom: int
    """Number of directions of shifts that the strikes determine; 0: no test."""
    limit: float
    """Value that chance exceeds at the false-alarm probability; infinite without a test."""
    share: float
    """Smallest share of a liquid in the mass that would exceed it in nine of ten cases; infinite without a
    test."""

    @property
    def moves(self) -> bool:
        """True if one centre of mass does not explain the strikes of all poses."""
        return self.chi_squared > self.limit


def pose_test(
    planes: Sequence[EquiPlane], com: Array, systematic: SystematicErrors, prior: ComPrior
) -> PoseShift:
    """Test of one centre of mass c for all poses, without the strike that explains most of a difference.

    Args:
        planes: Equi-planes (through pivot line and c) of the strikes used, in the object frame O.
        com: (3,) c [m] by all strikes together, in O, about which the test is linear.
        systematic: Standard deviations of errors that strikes share, and of their scatter.
        prior: Prior of c.

    Returns:
        Misfit of one c with its critical value, and the centre of mass of each pose.
    """
    centres = _pose_centres(planes, com, systematic, prior)
    faces = np.array([plane.face for plane in planes])
    found = _shift_test(planes, faces, com, systematic, prior)
    for i in range(len(planes)):
        kept = np.arange(len(planes)) != i
        other = _shift_test(
            [plane for plane, stays in zip(planes, kept.tolist(), strict=True) if stays],
            faces[kept],
            com,
            systematic,
            prior,
        )
        if other.chi_squared - other.limit < found.chi_squared - found.limit:
            found = other
    return replace(found, centres=centres)


def _shift_test(
    planes: Sequence[EquiPlane],
    faces: NDArray[np.str_],
    com: Array,
    systematic: SystematicErrors,
    prior: ComPrior,
) -> PoseShift:
    """Test of the poses with all `planes`, linear about `com`; `faces` (strikes,) are their resting faces.

    The centres of mass of the poses are left out.
    """
    names = np.unique(faces)
    none = PoseShift((), 0.0, 0.0, 0, math.inf, math.inf)
    if len(names) < MIN_POSES:
        return none
    model = JointModel(planes, systematic)
    residual, by_com, shared = _phi_rows(model, com, np.zeros(model.count - SECOND.stop))
    by_com = by_com * prior.sd
    covariance = np.diag(_phi_variance(planes, systematic)) + shared @ shared.T + by_com @ by_com.T
    mine = np.array([faces == name for name in names[1:]], dtype=np.float64)
    shifts = np.einsum("os,sc->soc", mine, by_com).reshape(len(planes), -1)
    weighted = np.linalg.solve(covariance, np.column_stack([shifts, -residual]))
    values, vectors = np.linalg.eigh(shifts.T @ weighted[:, :-1])
    determined = values > MIN_SHIFT_INFORMATION
    if not np.any(determined):
        return none
    values, vectors = values[determined], vectors[:, determined]
    along = vectors.T @ (shifts.T @ weighted[:, -1]) / values
    freedom = len(values)
    limit = critical_value(freedom)
    ups = np.array([planes[int(np.argmax(faces == name))].up for name in names])
    lowered = -LEVEL_OFFSET * 2 * (np.abs(ups) @ prior.sd)[:, None] * ups / prior.sd
    power = float(values @ (vectors.T @ (lowered[1:] - lowered[0]).ravel()) ** 2)
    moved = (vectors @ along).reshape(-1, 3) * prior.sd
    return PoseShift(
        centres=(),
        largest_shift=float(np.linalg.norm(moved, axis=1).max()),
        chi_squared=float(values @ along**2),
        freedom=freedom,
        limit=limit,
        share=math.sqrt(noncentrality(limit, freedom) / max(power, 1e-12)),
    )


def _phi_rows(model: JointModel, com: Array, errors: Array) -> tuple[Array, Array, Array]:
    """Residuals (strikes,) of phi, modelled less measured [rad], and their derivatives.

    The derivatives are by the centre of mass (strikes, 3) [rad/m] and by the errors that strikes share
    (strikes, errors), in units of their sd.

    Args:
        model: Model of the strikes' phi.
        com: (3,) centre of mass [m] about which it is linearised, in the object frame O.
        errors: (errors,) shared errors there.
    """
    at = np.concatenate([com, np.zeros(SECOND.stop - COM.stop), errors])
    design = model.design(at)
    return model.residual(at), design[:, COM], design[:, SECOND.stop :]


def _phi_variance(planes: Sequence[EquiPlane], systematic: SystematicErrors) -> Array:
    """Variances (strikes,) [rad^2] of the strikes' own errors of phi, with the usual scatter."""
    return np.array([plane.sd_phi**2 + systematic.strike_angle_sd**2 for plane in planes])


def _pose_centres(
    planes: Sequence[EquiPlane], com: Array, systematic: SystematicErrors, prior: ComPrior
) -> tuple[PoseCentre, ...]:
    """Centre of mass of each pose, in the order of the strikes; Gauss-Newton from `com`, that of all poses.

    The errors that strikes share are common to all poses. What the strikes of one pose leave open comes from
    the others, to the shift that contents may make.
    """
    model = JointModel(planes, systematic)
    variance, count = _phi_variance(planes, systematic), model.count - SECOND.stop
    names = list(dict.fromkeys(plane.face for plane in planes))
    pose = np.array([names.index(plane.face) for plane in planes])
    centres, errors = np.tile(com, (len(names), 1)), np.zeros(count)
    prior_covariance = np.eye(3 * len(names) + count)
    together = np.ones((len(names), len(names))) + POSE_SHIFT**2 * np.eye(len(names))
    prior_covariance[: centres.size, : centres.size] = np.kron(together, np.diag(prior.sd**2))
    precision = covariance = np.asarray(np.linalg.inv(prior_covariance), dtype=np.float64)
    for _ in range(POSE_STEPS):
        rows, residual = np.zeros((len(planes), len(prior_covariance))), np.zeros(len(planes))
        for number, centre in enumerate(centres):
            mine = pose == number
            off, by_com, shared = _phi_rows(model, centre, errors)
            residual[mine] = off[mine]
            rows[mine, 3 * number : 3 * number + 3] = by_com[mine]
            rows[mine, 3 * len(names) :] = shared[mine]
        weighted = rows / variance[:, None]
        covariance = np.asarray(np.linalg.inv(rows.T @ weighted + precision), dtype=np.float64)
        away = np.concatenate([(centres - prior.mean).ravel(), errors])
        step = -covariance @ (weighted.T @ residual + precision @ away)
        centres, errors = centres + step[: centres.size].reshape(-1, 3), errors + step[centres.size :]
    off = np.array([plane.normal @ (com - plane.point) for plane in planes])
    found: list[PoseCentre] = []
    for number, name in enumerate(names):
        own = slice(3 * number, 3 * number + 3)
        up = planes[int(np.argmax(pose == number))].up
        rms = float(np.sqrt(np.mean(off[pose == number] ** 2)))
        found.append(PoseCentre(name, up, centres[number], covariance[own, own], rms))
    return tuple(found)
