"""Is the struck body rigid? Contents that move (liquid, powder, a loose lump) show themselves in two tests.

A rigid body has one balance angle phi and one rate constant k about each edge, whatever the energy of the
strike (energy_test.py), and one centre of mass c in all poses (pose_test.py). The statistics of the two tests
are independent. A liquid whose surface stays level in every tip passes the first, a lump that does not change
its place between poses the second; no answer claims that a body is rigid.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from analyze.estimation.energy_test import EnergyTest, energy_test
from analyze.estimation.pose_test import PoseShift, pose_test
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.types import Array, EquiPlane

MIN_JOLTED = 2
"""Fewest strikes whose speed jumped from which they count: a single one may be a second impact."""
LARGEST_SHARE = 0.5
"""Largest share of the mass that a test must be able to find to count as a test."""


class Answer(Enum):
    """Answer to the question whether the body is rigid; none of them claims that it is."""

    NOT_RIGID = "not_rigid"
    NOTHING_MOVES = "nothing_moves"
    NOT_TESTED = "not_tested"


@dataclass(frozen=True)
class Rigidity:
    """Answer of both tests, with their figures."""

    energies: EnergyTest
    """Test of strikes over one edge at several energies."""
    poses: PoseShift
    """Test of the poses."""

    @property
    def answer(self) -> Answer:
        """Not rigid if a test says so; else that nothing moves that would show, or that nothing was tested.

        Strikes over one edge that differ, but not as contents make them differ, test nothing.
        """
        if self.energies.moves or self.poses.moves:
            return Answer.NOT_RIGID
        tested = self.share <= LARGEST_SHARE and not self.energies.unexplained
        return Answer.NOTHING_MOVES if tested else Answer.NOT_TESTED

    @property
    def share(self) -> float:
        """Smallest share of a liquid in the mass that one of the tests would have found; inf for none."""
        return min(self.energies.share, self.poses.share)


def check_rigidity(
    planes: Sequence[EquiPlane],
    energy_ratios: Sequence[float],
    com: Array,
    systematic: SystematicErrors,
    prior: ComPrior,
    jolted: tuple[Sequence[EquiPlane], Sequence[float]] = ((), ()),
) -> Rigidity:
    """Test whether the strikes are those of a rigid body.

    Args:
        planes: Equi-planes (through pivot line and centre of mass) of the strikes used, in the object frame
            O, with balance angles phi and rate constants k.
        energy_ratios: Energy ratio of each strike: its energy over the energy needed to reach balance.
        com: (3,) centre of mass [m] by all strikes together, in O.
        systematic: Stated standard deviations of errors that strikes share, and of their scatter.
        prior: Prior of c; its sd are half the extents of the body.
        jolted: Equi-planes and energy ratios of further strikes whose speed jumped, as by a second impact or
            by contents that hit a wall. They count if there are `MIN_JOLTED` or more, and if the test of the
            energies finds something whichever of them is left out.

    Returns:
        Both tests with their figures, and the centre of mass of each pose.
    """
    energies = energy_test(planes, np.array(energy_ratios, dtype=np.float64), com, systematic, prior)
    if not energies.moves and len(jolted[0]) >= MIN_JOLTED:
        without_one = [
            energy_test(
                [*planes, *(plane for j, plane in enumerate(jolted[0]) if j != i)],
                np.array([*energy_ratios, *(ratio for j, ratio in enumerate(jolted[1]) if j != i)]),
                com,
                systematic,
                prior,
            )
            for i in range(len(jolted[0]))
        ]
        if all(each.moves for each in without_one):
            energies = min(without_one, key=lambda each: each.chi_squared / each.limit)
    return Rigidity(energies, pose_test(planes, com, systematic, prior))
