"""Contents of the struck body that move: tests of rigidity, and the fill level of a stated container."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.estimation.fill_level import KnownDensity
from analyze.estimation.joint_model import COM
from analyze.estimation.rigidity import MIN_JOLTED, Answer, Rigidity, check_rigidity
from analyze.estimation.settled_contents import SettledContents, settled_contents
from analyze.pipeline.equiplanes import equiplanes
from analyze.pipeline.filling import RELATIVE_DENSITY_SD, filling_label
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from collections.abc import Collection, Sequence

    from analyze.pipeline.evidence import Evidence
    from analyze.pipeline.solved import EstimateOptions, SolvedStrikes
    from analyze.types import TipMotion


@dataclass(frozen=True)
class LooseContents:
    """Answer to the question whether the struck body is rigid, with what follows where it is not."""

    rigidity: Rigidity
    """tests, and the centre of mass of each pose"""
    settled: SettledContents | None = None
    """fill level by the poses' centres of mass; None if the body passes, names no filling, or is held in a
    fixture"""
    jolted: tuple[str, ...] = ()
    """ids of strikes whose speed jumped, as by a second impact or by contents that hit a wall"""

    @property
    def suspected(self) -> bool:
        """True if the tests decide nothing although strikes look as contents that move make them look.

        Their speed jumps, or those over one edge differ by more than their errors.
        """
        unsure = self.rigidity.answer is Answer.NOT_TESTED
        return unsure and (len(self.jolted) >= MIN_JOLTED or self.rigidity.energies.unexplained)

    @property
    def not_rigid(self) -> bool:
        """True if a test shows that something moves inside."""
        return self.rigidity.answer is Answer.NOT_RIGID


def energy_ratios(motions: Sequence[TipMotion]) -> list[float]:
    """Energy ratio of each fitted motion: energy of the strike over the energy needed to reach balance."""
    return [motion.energy_ratio or 1.0 for motion in motions]


def jolted_motions(evidence: Evidence, exclude: Collection[str] = ()) -> list[TipMotion]:
    """Fitted motions with a jump in speed, as by a second impact or by contents that hit a wall.

    They are not used for the estimate. `exclude` holds ids of strikes that the user leaves out.
    """
    return [
        motion
        for motion in evidence.motions
        if motion.verdict is Verdict.STRUCK_TWICE
        and motion.fit is not None
        and motion.strike_id not in exclude
    ]


def loose_contents(solved: SolvedStrikes, options: EstimateOptions) -> LooseContents:
    """Test whether the body that tipped is rigid; if it is not, and names a filling, estimate its level.

    Args:
        solved: joint solution of all strikes of one or several recordings.
        options: choices of the user, of which the strikes to exclude and the estimator are used.
    """
    jolted = jolted_motions(solved.evidence, options.exclude)
    rigidity = check_rigidity(
        solved.planes,
        energy_ratios(solved.used),
        solved.solution.x[COM],
        solved.systematic,
        solved.prior,
        (equiplanes(solved.evidence, jolted, options.estimator), energy_ratios(jolted)),
    )
    label, ids = filling_label(solved.evidence), tuple(motion.strike_id for motion in jolted)
    if rigidity.answer is not Answer.NOT_RIGID or label is None or solved.fixture is not None:
        return LooseContents(rigidity, jolted=ids)
    density = None
    if label.density_kg_m3 is not None:
        density_sd = label.density_sd_kg_m3 or RELATIVE_DENSITY_SD * label.density_kg_m3
        density = KnownDensity(label.density_kg_m3, density_sd)
    settled = settled_contents(rigidity.poses.centres, solved.cells, solved.scale.mass, density)
    return LooseContents(rigidity, settled, ids)
