"""Robustness of an estimate: its change with another assumption or estimator, or without a strike.

Every alternative is an estimate of its own, not a linear prediction.
"""

from __future__ import annotations

import enum
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analyze.estimation.edge_radii import strikes_determine_radius, with_radius_not_given
from analyze.estimation.joint import JointSolution, MomentModel, solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.posterior import TENSOR, derived
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.geometry.edge_radius import MAX_ASSUMED_RADIUS
from analyze.geometry.second_moments import symmetric_entries, symmetric_matrix
from analyze.least_squares.intervals import SIGMAS_95
from analyze.types import TENSOR_ENTRIES, Array, EquiPlane

SLACK = 1.5
"""Largest change of a quantity, in half widths of its stated 95 % interval, that an alternative may make."""
EXPLAINED_SIGMAS = 4.0
"""Largest change that the loss of data explains, over the uncertainty that the loss adds: the root of the
difference of the variances without and with these data."""
WIDER = 2.0
"""Factor on the sd of tilt and shape in the alternatives that widen them."""
MAX_LEFT_OUT = 6
"""Largest number of strikes that are left out in turn: those that linear propagation says move c most."""


class WhatIf(enum.Enum):
    """Kinds of change to an estimate's assumptions or data that show if the answer holds, in words."""

    RADIUS = "edge radius not given"
    TILT = "tilt of the table twice as uncertain"
    SCAN = "errors of the shape twice as large"
    STRIKE = "one strike left out"
    ESTIMATOR = "other estimator of the motions"
    NO_K = "rate constants k left out"


ASSUMPTIONS = (WhatIf.RADIUS, WhatIf.TILT, WhatIf.SCAN)
"""Alternatives that keep all data and assume less."""


@dataclass(frozen=True)
class Alternative:
    """Change of centre of mass c and moments of inertia if one assumption or part of the data is changed."""

    what_if: WhatIf
    """The alternative."""
    strike_id: str | None
    """Id of the strike left out; None for other alternatives."""
    com_shift: Array
    """(3,) change of c [m], in the object frame O."""
    moment_changes: Array | None
    """(3,) relative changes of the principal moments, ascending; None where no moments are estimated."""
    com_holds: bool
    """True if c stays inside its stated interval, `SLACK` times as wide."""
    moments_hold: bool
    """True if all measured entries of the inertia tensor stay inside their stated intervals, `SLACK` times as
    wide, or no moments are estimated."""
    com_half: float = 0.0
    """Half width [m] of c's 95 % interval in its least certain direction under the alternative."""
    unchecked: bool = False
    """True if the strikes do not check the assumption: then c and moments must stay inside with the whole
    interval that they have without it."""

    @property
    def holds(self) -> bool:
        """True if, under the alternative, c and the measured moments stay close enough to the stated ones.

        Close enough: inside the stated 95 % intervals, `SLACK` times as wide, or changed by no more than the
        uncertainty that the alternative adds (`alternatives`).
        """
        return self.com_holds and self.moments_hold


def alternatives(
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    solution: JointSolution,
    stated: InertialParameters,
    other_planes: Sequence[EquiPlane] | None = None,
) -> tuple[Alternative, ...]:
    """Changes of c and moments if the problem is solved again under each alternative assumption or data.

    c is the centre of mass. Of the strikes left out in turn (at most `MAX_LEFT_OUT`), only the worst is kept.
    The estimate fails to hold if a change exceeds `SLACK` half widths of the stated 95 % interval. It is
    excused if the answer became so much less certain that the change is within the added uncertainty:
    `EXPLAINED_SIGMAS` of it with other or fewer data, 1.96 sd with an edge radius not given. Where the
    strikes do not check the stated edge radius, change and added uncertainty together must stay within
    `SLACK` half widths: else the stated radius alone would make the answer sure.

    Args:
        planes: Equi-planes of the strikes (plane through pivot line and c), in the object frame O.
        systematic: Standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: Prior of c.
        moments: Mass, gravity, and the shape's prior of the moments.
        solution: Solution of the joint problem of these.
        stated: Parameters stated from it, of the body that tipped.
        other_planes: Equi-planes of the same strikes by another estimator; None if there is none.

    Returns:
        Alternatives in the order of `WhatIf`, without those that do not apply: no edge radius was stated, too
        few strikes, no other estimator, no rate constant k used. Empty if c is not observed: then nothing is
        stated that could fail to hold.
    """
    if not stated.com.observed:
        return ()
    wider = systematic.with_tilt_factor(WIDER)
    # Radii beyond those that count as likely where none is given are no alternative to it.
    likely = [plane.axis_id for plane in planes if plane.edge_radius <= MAX_ASSUMED_RADIUS]
    radius = with_radius_not_given(planes, likely)
    scanned = [replace(plane, edge_sd=WIDER * plane.edge_sd) for plane in planes]
    shape = replace(systematic, scale_sd=WIDER * systematic.scale_sd, face_sd=WIDER * systematic.face_sd)
    found: list[Alternative] = []

    def compare(what_if: WhatIf, there: JointSolution, strike_id: str | None = None) -> Alternative:
        return _alternative(what_if, strike_id, solution, there, stated)

    if any(a is not b for a, b in zip(radius, planes, strict=True)):
        found.append(compare(WhatIf.RADIUS, solve_joint(radius, systematic, prior, moments, solution)))
    found.append(compare(WhatIf.TILT, solve_joint(planes, wider, prior, moments, solution)))
    found.append(compare(WhatIf.SCAN, solve_joint(scanned, shape, prior, moments, solution)))
    left_out = [
        compare(
            WhatIf.STRIKE,
            solve_joint([*planes[:i], *planes[i + 1 :]], systematic, prior, moments, solution),
            planes[i].strike_id,
        )
        for i in _most_influential(solution)
    ]
    if left_out:
        found.append(max(left_out, key=lambda each: (not each.holds, float(np.linalg.norm(each.com_shift)))))
    if other_planes is not None:
        found.append(
            compare(WhatIf.ESTIMATOR, solve_joint(other_planes, systematic, prior, moments, solution))
        )
    if solution.data.uses_k.any():
        found.append(compare(WhatIf.NO_K, solve_joint(planes, systematic, prior)))
    return tuple(found)


def _most_influential(solution: JointSolution) -> Iterator[int]:
    """Yield the numbers of the strikes that move the centre of mass most if left out, largest move first.

    The move is that of linear propagation, in sd of the centre of mass. At most `MAX_LEFT_OUT` are yielded,
    and none of fewer than four strikes, which leave too few to estimate from.
    """
    model, x, P = solution.model, solution.x, solution.covariance
    if len(model.planes) < 4:
        return
    both = np.stack([model.design(x), model.log_k(x)[1] * solution.data.uses_k[:, None]], axis=1)
    off = np.stack([model.residual(x), (model.log_k(x)[0] - solution.data.log_k) * solution.data.uses_k], 1)
    gain = np.einsum("cd,sid,sij,sj,s->sc", P[COM], both, solution.data.precisions, off, solution.weight)
    size = np.einsum("sc,cd,sd->s", gain, np.linalg.inv(P[COM, COM]), gain)
    yield from np.argsort(-size)[:MAX_LEFT_OUT].tolist()


def _alternative(
    what_if: WhatIf,
    strike_id: str | None,
    solution: JointSolution,
    there: JointSolution,
    stated: InertialParameters,
) -> Alternative:
    """Change of centre of mass and moments from the stated solution to that of one alternative, `there`.

    `strike_id` is the strike left out, or None; `stated` holds the intervals in which the changes should
    stay.
    """
    with_moments = what_if is not WhatIf.NO_K
    before, by = derived(solution.model, solution.x)
    after, by_after = derived(there.model, there.x)
    variance = np.einsum("qi,ij,qj->q", by[: TENSOR.stop], solution.covariance, by[: TENSOR.stop])
    less_certain = np.einsum(
        "qi,ij,qj->q", by_after[: TENSOR.stop], there.covariance, by_after[: TENSOR.stop]
    )
    change = after[: TENSOR.stop] - before[: TENSOR.stop]
    change[TENSOR] *= stated.mass
    unchecked = what_if is WhatIf.RADIUS and not strikes_determine_radius(there)
    added = np.sqrt(np.maximum(less_certain - variance, 0.0))
    added[TENSOR] *= stated.mass
    half = SIGMAS_95 * np.concatenate(
        [np.sqrt(np.diag(stated.com.covariance)), symmetric_entries(stated.inertia_sd)]
    )
    inside = np.abs(change) <= SLACK * half
    if what_if not in ASSUMPTIONS:
        inside |= np.abs(change) <= EXPLAINED_SIGMAS * added
    elif what_if is WhatIf.RADIUS:
        # Where strikes check the radius, the prior without it may be off: only its uncertainty is compared.
        inside |= np.abs(change) <= SIGMAS_95 * added
    if unchecked:
        inside &= np.abs(change) + SIGMAS_95 * added <= SLACK * half
    measured = np.array([stated.measured[i, j] for i, j in TENSOR_ENTRIES])
    moment_changes = None
    if with_moments:
        principal = [np.linalg.eigvalsh(symmetric_matrix(each[TENSOR])) for each in (before, after)]
        moment_changes = principal[1] / principal[0] - 1
    return Alternative(
        what_if=what_if,
        strike_id=strike_id,
        com_shift=change[COM],
        moment_changes=moment_changes,
        com_holds=bool(inside[COM].all()),
        moments_hold=not with_moments or bool(inside[TENSOR][measured].all()),
        com_half=SIGMAS_95 * float(np.sqrt(np.linalg.eigvalsh(there.covariance[COM, COM])[-1])),
        unchecked=unchecked,
    )
