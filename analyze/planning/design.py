"""Which axes to strike and how often: the set that tells most about c and the moments, never a degenerate one (METHOD 1.6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analyze.planning.information import COM, INERTIA, Information, spread
from analyze.types import Array

SINGULAR = 0.05
"""least singular value of the unit normals over the square root of their number, below which a set is refused"""
MOMENT_WORTH = 0.5
"""weight of a moment's ln sd beside that of c along one direction: without tips about all three directions a moment stays unmeasured, and
with it what is shell and what is inside"""
PLACEMENT_WORTH = 0.15
"""a further axis must lessen the loss by this, 5 % of c's error: every one is a placement by hand"""
MOST_AXES = 6
"""in one plan, unless there are so many strikes that each still gets `STRIKES_PER_AXIS`"""
STRIKES_PER_AXIS = 4
MANY_AXES = 10
"""more placements than anybody makes"""
LEAST = 3
"""strikes that determine c, if none was made before"""
POOL = 24
"""axes that are tried in all triples; the others join by exchange"""
STARTS = 3
BETTER = 1e-6


@dataclass(frozen=True)
class Design:
    """Chosen candidates, how often each is struck, and what that tells."""

    chosen: tuple[int, ...]
    """indices into the candidates"""
    repeats: tuple[int, ...]
    covariance: Array
    """(14, 14) of the shared unknowns, in SI"""

    @property
    def com_covariance(self) -> Array:
        """(3, 3) m^2."""
        return self.covariance[COM, COM]

    @property
    def com_rms(self) -> float:
        """Root mean square distance of c from the truth [m]."""
        return float(np.sqrt(np.trace(self.com_covariance)))


def choose(information: Information, strikes: int, most_axes: int | None = None) -> Design | None:
    """The set with the least loss; None: no set of rank 3.

    Loss: 3*ln(rms error of c) + MOMENT_WORTH*ln(determinant of the inertia's sd). Sets whose normals, with those of the strikes made, do
    not span space are never considered. Search: the best triples, then one axis more at a time, each set improved by exchange (Fedorov
    1972) until no swap helps. The same candidates in the same order give the same design.

    Args:
        information: candidates, what is known, errors.
        strikes: how many more.
        most_axes: at most so many different axes; default: `MOST_AXES`, or so many that each gets `STRIKES_PER_AXIS`.
    """
    candidates = information.candidates
    if not candidates or strikes < 1:
        return None
    search = _Search(information)
    struck = len(information.belief.struck)
    least = max(1, min(strikes, 3 - struck))
    most = most_axes or min(max(min(strikes, MOST_AXES), strikes // STRIKES_PER_AXIS), MANY_AXES)
    best: tuple[float, tuple[int, ...], tuple[int, ...]] | None = None
    sets: list[tuple[int, ...]] = []
    for size in range(least, min(most, len(candidates), strikes) + 1):
        each = strikes // size
        sets = search.first_sets(size, each) if not sets else [search.grown(members, each) for members in sets]
        sets = list(dict.fromkeys(search.exchanged(members, each) for members in sets if members))
        for members in sets:
            repeats = search.shared_out(members, strikes)
            loss = search.loss(members, repeats) + PLACEMENT_WORTH * size
            if np.isfinite(loss) and (best is None or loss < best[0] - BETTER):
                best = (loss, members, repeats)
        if not sets:
            return None
    if best is None:
        return None
    _, members, repeats = best
    return Design(members, repeats, information.covariance([candidates[i] for i in members], repeats))


class _Search:
    """Losses of many sets at once."""

    def __init__(self, information: Information) -> None:
        self._information = information
        self._candidates = information.candidates
        self._normals = np.array([each.normal for each in self._candidates])
        made = [each.normal for each in information.belief.struck]
        self._made = np.array(made).reshape(-1, 3)
        self._before = information.before()
        # What a struck axis has told already is in `before`: a further strike on it counts by what it adds.
        ids = {each.axis.id for each in information.belief.struck}
        self._already = [information.of_axis(each, 0) if each.axis.id in ids else 0.0 for each in self._candidates]
        self._tables: dict[int, Array] = {}

    def table(self, repeats: int) -> Array:
        """(n, 14, 14): what `repeats` strikes on each candidate add."""
        if repeats not in self._tables:
            added = [self._information.of_axis(each, repeats) - old for each, old in zip(self._candidates, self._already, strict=True)]
            self._tables[repeats] = np.array(added)
        return self._tables[repeats]

    def losses(self, total: Array, normals: Array) -> Array:
        """(s,) for information (s, 14, 14) and sums of n n^T (s, 4, 3, 3 without the 4): inf where degenerate."""
        P = np.linalg.inv(total)
        com = np.trace(P[:, COM, COM], axis1=1, axis2=2)
        _, moments = np.linalg.slogdet(P[:, INERTIA, INERTIA])
        count = np.trace(normals, axis1=1, axis2=2)
        least = np.maximum(np.linalg.eigvalsh(normals)[:, 0], 0.0)
        loss = 1.5 * np.log(com) + 0.5 * MOMENT_WORTH * moments
        return np.where(np.sqrt(least / count) < SINGULAR, np.inf, loss)

    def _sums(self, members: tuple[int, ...], each: int) -> tuple[Array, Array]:
        index = list(members)
        normals = np.vstack([self._made, self._normals[index]])
        return self._before + self.table(each)[index].sum(axis=0), normals.T @ normals

    def loss(self, members: tuple[int, ...], repeats: tuple[int, ...]) -> float:
        """Of one set with its own repeats."""
        total = self._before + sum(self.table(many)[i] for i, many in zip(members, repeats, strict=True) if many)
        normals = np.vstack([self._made, self._normals[list(members)]])
        return float(self.losses(total[None], (normals.T @ normals)[None])[0])

    def first_sets(self, size: int, each: int) -> list[tuple[int, ...]]:
        """The best sets of `size` (1 to 3) among the pool."""
        pool = self._pool(each)
        sets = np.array(list(combinations(pool, size)))
        if not len(sets):
            return []
        table = self.table(each)
        outer = np.einsum("ni,nj->nij", self._normals, self._normals)
        losses = np.concatenate(
            [
                self.losses(self._before + table[part].sum(axis=1), self._made.T @ self._made + outer[part].sum(axis=1))
                for part in np.array_split(sets, max(1, len(sets) // 512))
            ]
        )
        order = [int(i) for i in np.argsort(np.round(losses, 9), kind="stable")[:STARTS] if np.isfinite(losses[i])]
        return [tuple(int(i) for i in sets[k]) for k in order]

    def _pool(self, each: int) -> list[int]:
        """Up to `POOL` candidates: first three that span space best, then one by one what lessens the loss most."""
        everything = list(range(len(self._candidates)))
        if len(everything) <= POOL:
            return everything
        taken = _widest_three(self._normals)
        total = self._before + self.table(each)[taken].sum(axis=0)
        solid = np.eye(3)[None]
        while len(taken) < POOL:
            left = [i for i in everything if i not in taken]
            losses = self.losses(total + self.table(each)[left], np.repeat(solid, len(left), axis=0))
            best = left[int(np.argmin(np.round(losses, 9)))]
            taken.append(best)
            total = total + self.table(each)[best]
        return sorted(taken)

    def grown(self, members: tuple[int, ...], each: int) -> tuple[int, ...]:
        """With the candidate added that lessens the loss most."""
        left = [i for i in range(len(self._candidates)) if i not in members]
        if not left:
            return members
        total, normals = self._sums(members, each)
        outer = np.einsum("ni,nj->nij", self._normals[left], self._normals[left])
        losses = self.losses(total + self.table(each)[left], normals + outer)
        return tuple(sorted([*members, left[int(np.argmin(np.round(losses, 9)))]]))

    def exchanged(self, members: tuple[int, ...], each: int) -> tuple[int, ...]:
        """Swapped one for one while that helps."""
        table = self.table(each)
        current = float(self.losses(*(part[None] for part in self._sums(members, each)))[0])
        for _ in range(50):
            left = np.array([i for i in range(len(self._candidates)) if i not in members], dtype=np.int64)
            if not len(left):
                break
            total, normals = self._sums(members, each)
            gone = list(members)
            outer = np.einsum("ni,nj->nij", self._normals, self._normals)
            totals = (total - table[gone])[:, None] + table[left]
            spans = (normals - outer[gone])[:, None] + outer[left]
            losses = self.losses(totals.reshape(-1, *total.shape), spans.reshape(-1, 3, 3)).reshape(len(gone), len(left))
            swaps: list[tuple[float, tuple[int, ...]]] = []
            for out, row in zip(members, losses, strict=True):
                i = int(np.argmin(np.round(row, 9)))
                swaps.append((float(row[i]), tuple(sorted([*(k for k in members if k != out), int(left[i])]))))
            loss, swapped = min(swaps, key=lambda pair: round(pair[0], 9))
            if not loss < current - BETTER:
                break
            current, members = loss, swapped
        return members

    def shared_out(self, members: tuple[int, ...], strikes: int) -> tuple[int, ...]:
        """Strikes shared out evenly, what is left over where it tells most."""
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


def determines(information: Information) -> bool:
    """Whether any set of candidates, with the strikes made, leaves no direction of c unknown."""
    normals = np.array([each.normal for each in (*information.candidates, *information.belief.struck)]).reshape(-1, 3)
    if len(normals) < 3:
        return False
    return spread(normals[_widest_three(normals)]) >= SINGULAR or choose(information, LEAST) is not None


def _widest_three(normals: Array) -> list[int]:
    """Three of unit vectors (n, 3) that span space well, found one after the other."""
    taken: list[int] = []
    rest = normals.copy()
    for _ in range(3):
        i = int(np.argmax(np.linalg.norm(rest, axis=1).round(9)))
        taken.append(i)
        along = rest[i] / max(float(np.linalg.norm(rest[i])), 1e-12)
        rest = rest - np.outer(rest @ along, along)
    return taken


def degenerate(information: Information, members: Sequence[int]) -> bool:
    """Whether the normals of `members`, with those of the strikes made, leave a direction of c unknown."""
    normals = [information.candidates[i].normal for i in members] + [each.normal for each in information.belief.struck]
    return spread(np.array(normals).reshape(-1, 3)) < SINGULAR
