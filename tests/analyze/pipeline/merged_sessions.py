"""Simulated sessions of one object, as one recording and as parts of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from analyze.estimation.centre_of_mass import centre_of_mass
from analyze.estimation.mass_properties import CentreOfMass
from analyze.estimation.priors import ComPrior
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.pipeline.evidence import Evidence
from analyze.types import TipMotion
from schemas.document import sha256_text
from schemas.strike_result import Verdict
from tests.analyze.estimation.bodies import fit_of, planned_strike, tip
from tests.analyze.simulated_session import carton, session

BODY = carton()
SD_PHI, SD_K = 4e-4, 2e-3


def recording(evidence: Evidence, name: str, **manifest: object) -> Evidence:
    """Evidence with the same strikes, as a recording named `name` with these manifest entries."""
    (head,) = evidence.recordings
    entries = {"recording_id": name, "created": f"2026-01-0{1 + len(name) % 9}T00:00:00Z", **manifest}
    ids = tuple(motion.strike_id for motion in evidence.motions)
    return replace(
        evidence,
        recordings=(
            replace(
                head,
                path=Path(f"{name}.mcap"),
                content_id=sha256_text(name),
                manifest=head.manifest.model_copy(update=entries),
                strike_ids=ids,
                files=(f"{name}.mcap",),
            ),
        ),
    )


def part(evidence: Evidence, start: int, stop: int, name: str, **manifest: object) -> Evidence:
    """Evidence with the strikes `start` to `stop`, as a recording of its own."""
    return recording(replace(evidence, motions=evidence.motions[start:stop]), name, **manifest)


def session_without_frames(
    rng: np.random.Generator,
    tilt: float,
    moved: dict[str, np.ndarray],
    axes: tuple[tuple[int, int, int, int], ...],
) -> Evidence:
    """Session of two strikes per axis, with phi and k but no frames.

    The table is tilted by `tilt` [rad]; the true edges are displaced by `moved` [m], by axis id.
    """
    plain = session_of(axes)
    motions: list[TipMotion] = []
    for strike in plain.plan.strikes:
        phi, k = tip(BODY, strike, moved[strike.axis_id])
        fit = fit_of(
            phi + tilt + rng.normal(0, np.hypot(SD_PHI, 5e-4)),
            k * (1 + rng.normal(0, SD_K)),
            SD_PHI,
            SD_K * k,
        )
        motions.append(TipMotion(f"{strike.id}.1", strike.id, Verdict.GOOD, "", None, None, fit, (), 1.1))
    return replace(plain, motions=tuple(motions))


def session_of(axes: tuple[tuple[int, int, int, int], ...]) -> Evidence:
    strikes = [planned_strike(BODY, *axis, repeat) for axis in axes for repeat in range(2)]
    return replace(BARE, plan=BARE.plan.model_copy(update={"strikes": strikes}))


BARE = session(BODY, np.random.default_rng(0), repeats=1)


def com_of(evidence: Evidence) -> CentreOfMass:
    """Centre of mass by the strikes' balance angles alone, without moments: quicker than a whole estimate."""
    prior = ComPrior.from_bounds(*evidence.model.bounds)
    return centre_of_mass(equiplanes(evidence, evidence.motions), systematic_errors(evidence), prior)
