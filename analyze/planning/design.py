"""Design of the experiment: axes and repeats that best determine c and the moments (method 1.6).

c is the centre of mass; an axis is an edge about which the object is tipped by a strike.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analyze.planning.information import COM, INERTIA, Information, normal_spread
from analyze.types import Array

MIN_NORMAL_SPREAD = 0.05
"""Smallest `normal_spread` of a set of strikes; sets below it leave a direction of c unknown."""
MOMENT_WEIGHT = 0.5
"""Weight of a moment's ln sd relative to that of c along one direction.

Without tips about all three directions one moment stays unmeasured, and with it the split between shell and
inside."""
AXIS_PENALTY = 0.15
"""Decrease of the loss (5 % of c's error) that a further axis must bring, as every axis needs a placement by
hand."""
MAX_AXES = 6
"""Largest number of axes of a plan, unless each one still gets `STRIKES_PER_AXIS`."""
STRIKES_PER_AXIS = 4
"""Strikes per axis from which on a plan may have more than `MAX_AXES` axes."""
ABSOLUTE_MAX_AXES = 10
"""Largest number of axes of any plan."""
USUAL_STRIKES = 9
"""Number of strikes for which the error of c that axes allow is judged."""
MIN_STRIKES = 3
"""Smallest number of strikes that determine c if none was made before, and nothing is tossed."""
POOL_SIZE = 24
"""Number of axes of which all triples are tried; the others enter by exchange."""
STARTS = 3
"""Number of sets from which the search starts."""
MIN_GAIN = 1e-6
"""Smallest decrease of the loss that counts as an improvement."""


@dataclass(frozen=True)
class Design:
    """Axes chosen for a plan (edges to tip about), number of strikes on each, and predicted covariance.

    The axes are chosen among candidates, the axes that can be struck. The covariance is that of the centre of
    mass, the inertia and the errors that strikes share.
    """

    chosen: tuple[int, ...]
    """Indices of the chosen axes among the candidates."""
    repeats: tuple[int, ...]
    """Number of strikes on each of the chosen candidates."""
    covariance: Array
    """(14, 14) predicted covariance, in SI units, of centre of mass, inertia and the errors that strikes
    share, in the order of `Information.units`."""

    @property
    def com_covariance(self) -> Array:
        """Predicted covariance (3, 3) of the estimated centre of mass [m^2], in the object frame."""
        return self.covariance[COM, COM]

    @property
    def com_rms(self) -> float:
        """Predicted root mean square distance of the estimated centre of mass from the true one [m]."""
        return float(np.sqrt(np.trace(self.com_covariance)))


def choose_design(information: Information, strikes: int, most_axes: int | None = None) -> Design | None:
    """Design (axes to tip about, strikes on each) with the smallest loss that the search finds.

    The loss is 3 ln(rms error of c) + MOMENT_WEIGHT ln sqrt(det P) + `AXIS_PENALTY` for each axis, with c the
    centre of mass and P the covariance of the inertia tensor's six entries, both in units of their prior 1
    sigma. Sets of axes are excluded if their equi-planes (planes through edge and c at balance), together
    with those of the strikes made, leave a direction of c unknown. The search starts from the best sets of
    three axes (fewer if fewer strikes are asked for, or if axes were struck before), adds one axis at a time,
    and improves each set by exchanging single axes (Fedorov 1972). The same candidates in the same order give
    the same design.

    Args:
        information: Candidates, prior knowledge and errors.
        strikes: Number of further strikes.
        most_axes: Largest number of different axes; None for the larger of `MAX_AXES` and the number of axes
            that get `STRIKES_PER_AXIS` strikes each, but at most `ABSOLUTE_MAX_AXES`.

    Returns:
        The design; None if no set determines c in every direction, or there are no candidates or strikes.
    """
    candidates = information.candidates
    if not candidates or strikes < 1:
        return None
    search = _Search(information)
    struck = len(information.belief.struck)
    least = max(1, min(strikes, 3 - struck))
    most = most_axes or min(max(min(strikes, MAX_AXES), strikes // STRIKES_PER_AXIS), ABSOLUTE_MAX_AXES)
    best: tuple[float, tuple[int, ...], tuple[int, ...]] | None = None
    sets: list[tuple[int, ...]] = []
    for size in range(least, min(most, len(candidates), strikes) + 1):
        each = strikes // size
        sets = (
            search.first_sets(size, each) if not sets else [search.grown(members, each) for members in sets]
        )
        sets = list(dict.fromkeys(search.exchanged(members, each) for members in sets))
        for members in sets:
            repeats = search.distributed(members, strikes)
            loss = search.loss(members, repeats) + AXIS_PENALTY * size
            if np.isfinite(loss) and (best is None or loss < best[0] - MIN_GAIN):
                best = (loss, members, repeats)
        if not sets:
            return None
    if best is None:
        return None
    _, members, repeats = best
    return Design(members, repeats, information.covariance([candidates[i] for i in members], repeats))


class _Search:
    """Search for the set of axes (edges to tip about) with the smallest loss.

    The loss of a set is the weighted logarithm of its predicted errors of centre of mass and inertia
    (`losses`); the penalty for each axis is not part of it here. A set is a sorted tuple of indices of
    candidates, the axes that can be struck.

    Args:
        information: Candidates, prior knowledge with the strikes made, and errors.
    """

    def __init__(self, information: Information) -> None:
        self._information = information
        self._candidates = information.candidates
        self._normals = np.array([each.normal for each in self._candidates])
        made = [each.normal for each in information.belief.struck]
        self._made = np.array(made).reshape(-1, 3)
        self._outer = np.einsum("ni,nj->nij", self._normals, self._normals)
        self._before = information.before()
        # Information of strikes already made is in `before`: a further strike on their axis counts by its
        # increment.
        ids = {each.axis.id for each in information.belief.struck}
        self._already = [
            information.axis_information(each, 0) if each.axis.id in ids else 0.0 for each in self._candidates
        ]
        self._tables: dict[int, Array] = {}

    def table(self, repeats: int) -> Array:
        """Information (n, 14, 14) that `repeats` further strikes on each of n candidates add.

        It is Fisher information about the 14 unknowns that strikes share (centre of mass, inertia, common
        errors), in units of their prior 1 sigma. The result is cached.
        """
        if repeats not in self._tables:
            added = [
                self._information.axis_information(each, repeats) - old
                for each, old in zip(self._candidates, self._already, strict=True)
            ]
            self._tables[repeats] = np.array(added)
        return self._tables[repeats]

    def losses(self, total: Array, normals: Array) -> Array:
        """Losses (s,) of s sets of axes; inf where a direction of the centre of mass c is left unknown.

        A loss is 3 ln(rms error of c) + MOMENT_WEIGHT ln sqrt(det P), P the covariance of the inertia's six
        entries. All unknowns are in units of their prior 1 sigma.

        Args:
            total: (s, 14, 14) information of each set, strikes made and priors included, on the unknowns that
                all strikes share: c (3), inertia (6), and five errors such as mass and gravity.
            normals: (s, 3, 3) sum of n n^T over each set and the strikes made; n is the unit normal of an
                axis's equi-plane, the plane through edge and centre of mass at balance.
        """
        P = np.linalg.inv(total)
        com = np.trace(P[:, COM, COM], axis1=1, axis2=2)
        _, moments = np.linalg.slogdet(P[:, INERTIA, INERTIA])
        count = np.trace(normals, axis1=1, axis2=2)
        least = np.maximum(np.linalg.eigvalsh(normals)[:, 0], 0.0)
        loss = 1.5 * np.log(com) + 0.5 * MOMENT_WEIGHT * moments
        return np.where(np.sqrt(least / count) < MIN_NORMAL_SPREAD, np.inf, loss)

    def _sums(self, members: tuple[int, ...], each: int) -> tuple[Array, Array]:
        """Information (14, 14) from one set of axes, and sum (3, 3) of n n^T over the axes.

        The first is Fisher information about the 14 unknowns that strikes share, in units of their prior 1
        sigma: centre of mass (3), inertia tensor (6), and errors of mass, gravity, table tilt, scale and edge
        radius. n is the unit normal, in the object frame, of the plane through an axis's edge and the centre
        of mass. Both include the strikes made before, the information also the priors.

        Args:
            members: Indices of the set's axes among the candidates.
            each: Number of further strikes on each axis.
        """
        index = list(members)
        normals = np.vstack([self._made, self._normals[index]])
        return self._before + self.table(each)[index].sum(axis=0), normals.T @ normals

    def loss(self, members: tuple[int, ...], repeats: tuple[int, ...]) -> float:
        """Loss of one set of axes: weighted logarithm of the predicted errors of centre of mass and inertia.

        Smaller is better; inf if the set leaves a direction of the centre of mass unknown.

        Args:
            members: The set's axes (edges to tip about), as indices among the candidates.
            repeats: Number of further strikes on each of them.
        """
        total = self._before + sum(
            self.table(many)[i] for i, many in zip(members, repeats, strict=True) if many
        )
        normals = np.vstack([self._made, self._normals[list(members)]])
        return float(self.losses(total[None], (normals.T @ normals)[None])[0])

    def first_sets(self, size: int, each: int) -> list[tuple[int, ...]]:
        """Up to `STARTS` sets of axes with the smallest losses, the best first.

        A set is a tuple of indices of candidates (axes that can be struck). The loss is the weighted
        logarithm of the predicted errors of centre of mass and inertia. The result is empty if all sets leave
        a direction of the centre of mass unknown.

        Args:
            size: Number of axes of a set, 1 to 3; they are taken from `_pool`.
            each: Number of strikes on each axis.
        """
        sets = np.array(list(combinations(self._pool(each), size)))
        table = self.table(each)
        losses = np.concatenate(
            [
                self.losses(
                    self._before + table[part].sum(axis=1),
                    self._made.T @ self._made + self._outer[part].sum(axis=1),
                )
                for part in np.array_split(sets, max(1, len(sets) // 512))
            ]
        )
        order = np.argsort(np.round(losses, 9), kind="stable")[:STARTS]
        return [tuple(sets[k].tolist()) for k in order if np.isfinite(losses[k])]

    def _pool(self, each: int) -> list[int]:
        """Sorted indices of up to `POOL_SIZE` candidates that are likely to be of use.

        A candidate is a pivot axis that may be planned. All are returned if there are no more. Otherwise the
        first three are those whose equi-planes (planes through edge and centre of mass at balance) have
        normals that span space best. The others are added one by one, each time the one with which the loss
        is least. The loss is a measure of the predicted errors of centre of mass and inertia.

        Args:
            each: number of further strikes that are assumed on every axis.
        """
        everything = list(range(len(self._candidates)))
        if len(everything) <= POOL_SIZE:
            return everything
        taken = _widest_three(self._normals)
        total = self._before + self.table(each)[taken].sum(axis=0)
        solid = np.eye(3)[None]
        while len(taken) < POOL_SIZE:
            left = [i for i in everything if i not in taken]
            losses = self.losses(total + self.table(each)[left], np.repeat(solid, len(left), axis=0))
            best = left[int(np.argmin(np.round(losses, 9)))]
            taken.append(best)
            total = total + self.table(each)[best]
        return sorted(taken)

    def grown(self, members: tuple[int, ...], each: int) -> tuple[int, ...]:
        """Set of pivot axes, as sorted indices, with the candidate added that lowers the loss most.

        The loss is the weighted logarithm of the predicted errors of centre of mass and inertia. If all
        candidates are in the set, `members` is returned.

        Args:
            members: Indices of the candidates in the set.
            each: Number of strikes on each axis.
        """
        left = [i for i in range(len(self._candidates)) if i not in members]
        if not left:
            return members
        total, normals = self._sums(members, each)
        losses = self.losses(total + self.table(each)[left], normals + self._outer[left])
        return tuple(sorted([*members, left[int(np.argmin(np.round(losses, 9)))]]))

    def exchanged(self, members: tuple[int, ...], each: int) -> tuple[int, ...]:
        """Set of axes improved by exchanging one axis at a time for another while this lowers the loss.

        At most 50 exchanges are made. The loss is the weighted sum of the logarithms of the predicted errors
        of centre of mass and inertia.

        Args:
            members: Indices of the set's axes among the candidates (axes that can be struck).
            each: Number of strikes on each axis.

        Returns:
            Sorted indices of the candidates in the improved set, which has as many axes.
        """
        table = self.table(each)
        current = float(self.losses(*(part[None] for part in self._sums(members, each)))[0])
        for _ in range(50):
            left = np.array([i for i in range(len(self._candidates)) if i not in members], dtype=np.int64)
            if not len(left):
                break
            total, normals = self._sums(members, each)
            gone = list(members)
            totals = (total - table[gone])[:, None] + table[left]
            spans = (normals - self._outer[gone])[:, None] + self._outer[left]
            losses = self.losses(totals.reshape(-1, *total.shape), spans.reshape(-1, 3, 3))
            best = int(np.argmin(np.round(losses, 9)))
            if not losses[best] < current - MIN_GAIN:
                break
            out, into = divmod(best, len(left))
            gone[out] = int(left[into])
            current, members = float(losses[best]), tuple(sorted(gone))
        return members

    def distributed(self, members: tuple[int, ...], strikes: int) -> tuple[int, ...]:
        """Number of strikes on each axis (edge to tip the object about) of a set, in the order of `members`.

        All axes get equal shares; each strike left over goes where it lowers the loss (predicted errors of
        centre of mass and inertia) most.

        Args:
            members: Indices of the set's axes among all axes that can be struck; no more of them than
                `strikes`.
            strikes: Number of strikes in all.
        """
        each, left = divmod(strikes, len(members))
        repeats = [each] * len(members)
        index = list(members)
        more = self.table(each + 1)[index] - self.table(each)[index]
        total, normals = self._sums(members, each)
        for _ in range(left):
            open_ones = [i for i in range(len(members)) if repeats[i] == each]
            losses = self.losses(total + more[open_ones], np.repeat(normals[None], len(open_ones), axis=0))
            best = open_ones[int(np.argmin(np.round(losses, 9)))]
            repeats[best] += 1
            total = total + more[best]
        return tuple(repeats)


def can_determine_com(information: Information) -> bool:
    """True if some set of the candidate axes determines the centre of mass in every direction.

    Axes of strikes made before count too.

    Args:
        information: Candidates, and prior knowledge with the strikes made.
    """
    normals = np.array(
        [each.normal for each in (*information.candidates, *information.belief.struck)]
    ).reshape(-1, 3)
    if len(normals) < 3:
        return False
    return (
        normal_spread(normals[_widest_three(normals)]) >= MIN_NORMAL_SPREAD
        or choose_design(information, MIN_STRIKES) is not None
    )


def usual_com_rms(information: Information) -> float:
    """Expected rms error of the centre of mass [m] with `USUAL_STRIKES` strikes; inf if it is not determined.

    Args:
        information: Candidates, prior knowledge and errors.
    """
    if not can_determine_com(information):
        return float("inf")
    chosen = choose_design(information, USUAL_STRIKES)
    return float("inf") if chosen is None else chosen.com_rms


def _widest_three(normals: Array) -> list[int]:
    """Indices of three of n unit vectors (n, 3), n at least 3, that span space well.

    They are chosen one after another, each with the largest part perpendicular to those chosen before.
    """
    taken: list[int] = []
    rest = normals.copy()
    for _ in range(3):
        i = int(np.argmax(np.linalg.norm(rest, axis=1).round(9)))
        taken.append(i)
        along = rest[i] / max(float(np.linalg.norm(rest[i])), 1e-12)
        rest = rest - np.outer(rest @ along, along)
    return taken
