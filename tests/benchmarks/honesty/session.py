"""One session of `make bench-honesty`: specimen, description, strikes, and the whole answer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from analyze.errors import AnalyzeError
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.strike_task import StrikeTask
from analyze.pipeline.estimate import Estimate, estimate_evidence
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.pipeline.sections import next_face_angle, rolling_outline, scanned_edge_sd, strike_supports
from analyze.result.document import result_document
from analyze.types import TipMotion
from schemas.object_spec import ObjectSpec
from schemas.result import Result
from schemas.strike_plan import PlannedStrike
from tests.analyze.simulated_session import manifest
from tests.benchmarks.honesty.bodies import MAKERS, Specimen, draw_specimen
from tests.benchmarks.honesty.described import DRAWS, Description, description, planning_key
from tests.benchmarks.honesty.disturbances import DISTURBANCES, Disturbance
from tests.benchmarks.honesty.images import analyse_images
from tests.benchmarks.honesty.observed import T0, draw_view, observe
from tests.benchmarks.honesty.statics import TrueTip, true_tip
from tests.benchmarks.honesty.struck import Bank, faces_of
from tests.benchmarks.honesty.tags import misplaced, stick_tags

SPECIMENS = 12
"""specimens per body that sessions share"""
VARIANTS = 3
"""struck motions per specimen and planned strike that sessions share"""
BACK_SHARE = 0.1
"""share of strikes that rock back"""
ATTEMPTS = 60
"""fillings tried for a specimen"""
LEAST_PHI = math.radians(5)
LARGE_FACE = 0.4
"""area over the largest face's, above which every specimen stands on the face"""


@dataclass(frozen=True)
class StrikeTruth:
    """Truth of one recorded strike."""

    tip: TrueTip
    phi: float
    """balance angle of the motion, from the pose in which the body rested [rad]"""
    over: bool
    """True if the body passed its balance"""
    mislabelled: bool = False
    """True if the strike was recorded under another strike's name"""


@dataclass(frozen=True)
class Trial:
    """One session: evidence, answer and truth."""

    specimen: Specimen
    evidence: Evidence | None
    """None without a plan"""
    estimate: Estimate | None
    """None if the answer was refused"""
    result: Result | None
    refusal: str
    """message of the refusal; "" if there is an answer"""
    truths: dict[str, StrikeTruth]
    """by strike id"""


@lru_cache(maxsize=64)
def specimen(name: str, number: int) -> Specimen:
    """Specimen whose filling lets it stand on every large face.

    Raises:
        ValueError: no filling does.
    """
    for attempt in range(ATTEMPTS):
        made = draw_specimen(name, number, attempt)
        if _stands(made):
            return made
    raise ValueError(f"{name}: specimen {number} does not stand")


def _stands(made: Specimen) -> bool:
    """True if the specimen stands on all its large faces, or on three of them."""
    normals, edges, areas = faces_of(made.body)
    large = np.flatnonzero(areas > LARGE_FACE * areas.max())
    firm = [_stands_on(made, normals[face], edges[face]) for face in large]
    return sum(firm) >= min(3, len(large))


def _stands_on(made: Specimen, normal: np.ndarray, edges: np.ndarray) -> bool:
    """True if the specimen balances by at least 5 degrees over every edge of a face."""
    some = edges[:: max(1, len(edges) // 8)]
    for edge in (*some, *-some):
        tip = true_tip(made, np.stack([np.cross(edge, -normal), edge, -normal]), np.zeros(2))
        if tip is None or tip.phi < LEAST_PHI:
            return False
    return True


def run_session(
    body: str, disturbance_name: str, seed: int, bank: Bank, images: bool = False
) -> Trial | None:
    """Draw, strike, track and estimate one session; None if the disturbance does not apply to the body.

    Args:
        body: name of the body.
        disturbance_name: name of the disturbance.
        seed: seed of the session; sessions with the same seed and body share the specimen.
        bank: struck motions.
        images: True to draw images of every strike and track their tags.
    """
    disturbance = DISTURBANCES[disturbance_name]
    made = specimen(body, seed % SPECIMENS)
    try:
        key = planning_key(disturbance)
        described = description(body, key, seed % DRAWS)
    except AnalyzeError as error:
        return Trial(made, None, None, None, f"no plan: {error}", {})
    if described is None:
        return None
    order = (list(MAKERS).index(body), list(DISTURBANCES).index(disturbance_name))
    rng = np.random.default_rng((0x5E55, seed, *order))
    motions, truths = make_strikes(described, made, (disturbance, images), bank, rng)
    evidence = session_evidence(described, made, disturbance, motions, rng)
    try:
        estimate = estimate_evidence(evidence)
    except AnalyzeError as error:
        return Trial(made, evidence, None, None, str(error), truths)
    return Trial(made, evidence, estimate, result_document(estimate), "", truths)


def make_strikes(
    described: Description,
    made: Specimen,
    how: tuple[Disturbance, bool],
    bank: Bank,
    rng: np.random.Generator,
) -> tuple[list[TipMotion], dict[str, StrikeTruth]]:
    """Analysed motions of the strikes that the session makes, and their truth by strike id.

    `how` is the disturbance, and whether images are drawn.
    """
    session = StruckSession(described, made, how, bank, rng)
    for strike in session.chosen:
        session.strike(strike)
    return session.motions, session.truths


class StruckSession:
    """Session whose strikes are made one after another.

    Args:
        described: object as its user describes it, with the plan.
        made: true body and table.
        how: the disturbance, and whether images are drawn.
        bank: struck motions.
        rng: random generator of the session.

    Attributes:
        chosen: planned strikes that are made, all unless the disturbance leaves some out.
        motions: analysed motions, in the order of the strikes.
        truths: their truth by strike id.
    """

    def __init__(
        self,
        described: Description,
        made: Specimen,
        how: tuple[Disturbance, bool],
        bank: Bank,
        rng: np.random.Generator,
    ) -> None:
        self._described, self._made, self._how, self._bank, self._rng = described, made, how, bank, rng
        disturbance, _ = how
        self._view = draw_view(disturbance, rng)
        self.chosen = _chosen(described.plan.strikes, disturbance, rng)
        self._labels = _swapped(self.chosen, rng) if disturbance.mislabelled else {}
        self._tags = stick_tags(made.body, described.plan.strikes, self._view, disturbance)
        self._at_rest = rng.spawn(1)[0]
        self.motions: list[TipMotion] = []
        self.truths: dict[str, StrikeTruth] = {}

    def strike(self, strike: PlannedStrike) -> TipMotion | None:
        """Make and analyse a planned strike; None if the body does not stand as planned."""
        described, made, rng = self._described, self._made, self._rng
        disturbance, images = self._how
        back = rng.random() < BACK_SHARE
        variant = f"{'back' if back else 'over'}{rng.integers(VARIANTS)}"
        known = rng.random() < 0.5
        rotation, tilt = np.array(strike.R_world_object), disturbance.tilt * made.lean
        struck = self._bank.motion(made, rotation, strike.impact_height_m, tilt, variant)
        if struck is None:
            return None
        named = self._labels.get(strike.id, strike)
        tracked, crumb = observe(named, struck, self._view, disturbance, rng)
        attempt = 1 + sum(motion.plan_strike_id == named.id for motion in self.motions)
        task = StrikeTask(
            f"{named.id}.{attempt}",
            named,
            T0 if known else 0,
            None,
            rolling_outline(described.model, named),
            next_face_angle(described.model, named),
            supports=strike_supports(described.model, named),
            plan_strikes=tuple(described.plan.strikes),
            edge_sd=scanned_edge_sd(described.spec, described.model, named),
        )
        if images:
            crumb, motion = 0.0, analyse_images(task, strike, self._tags, struck, self._view, rng)
        else:
            motion = misplaced(task, strike, self._tags, struck, self._view, self._at_rest)
            motion = motion or analyse_motion(tracked, task, MotionSettings())
        self.motions.append(motion)
        self.truths[task.strike_id] = StrikeTruth(
            struck.tip, struck.tip.phi - crumb, struck.over, named is not strike
        )
        return motion


def _chosen(
    planned: list[PlannedStrike], disturbance: Disturbance, rng: np.random.Generator
) -> list[PlannedStrike]:
    """Planned strikes that are made: all, or a few over different axes."""
    if disturbance.strikes is None:
        return planned
    count = int(rng.integers(disturbance.strikes[0], disturbance.strikes[1] + 1))
    first = {strike.axis_id: strike for strike in reversed(planned)}
    axes = [first[name] for name in rng.permutation(sorted(first))[:count]]
    return sorted(axes, key=lambda strike: int(strike.id[1:]))


def _swapped(planned: list[PlannedStrike], rng: np.random.Generator) -> dict[str, PlannedStrike]:
    """Plan entry under which each strike is recorded: two over different axes have changed places."""
    labels = {strike.id: strike for strike in planned}
    pairs = [(a, b) for i, a in enumerate(planned) for b in planned[i + 1 :] if a.axis_id != b.axis_id]
    if pairs:
        a, b = pairs[int(rng.integers(len(pairs)))]
        labels[a.id], labels[b.id] = b, a
    return labels


def session_evidence(
    described: Description,
    made: Specimen,
    disturbance: Disturbance,
    motions: list[TipMotion],
    rng: np.random.Generator,
) -> Evidence:
    """Evidence of the session: what the user weighed and stated, and the motions."""
    true = float(made.masses.sum())
    sd = max(described.spec.mass_sd_kg, disturbance.mass * true)
    spec: ObjectSpec = described.spec.model_copy(
        update={"mass_kg": true + rng.normal(0, sd), "mass_sd_kg": sd}
    )
    stated = manifest(spec).model_copy(update={"gravity_tilt_sd_rad": disturbance.tilt_stated})
    ids = tuple(motion.strike_id for motion in motions)
    head = RecordingHead(Path("r.mcap"), stated, "c" * 64, ids, files=("r.mcap",))
    evidence = Evidence(
        (head,),
        spec,
        described.model,
        described.plan,
        described.plan.object_sha256,
        tuple(motions),
    )
    return replace(evidence, bodies=described.bodies)
