"""Frame times that a file states and no clock of ours gave: what the strikes say of the frame rate, and what an answer may take from it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.joint_model import GRAVITY
from analyze.estimation.rate import OPEN, RateCheck, rate_check
from analyze.estimation.stated import Scale
from analyze.motion.contact_time import contact_time
from schemas.result import FrameTimes, Quantity
from schemas.session_manifest import TimeSource

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.cells import Cells
    from analyze.estimation.joint import JointSolution, Moments
    from analyze.estimation.stated import ComPrior, SystematicErrors
    from analyze.pipeline.evidence import Evidence
    from analyze.types import Array, EquiPlane
    from schemas.session_manifest import SessionManifest

RATE_SD = 0.002
"""relative, of a camera's frame rate that its file states and nothing checks: 240 may be 239.76, and a phone's quartz wanders"""
POINTS = 800
"""of the shape, where mass is tried: more do not move the limits"""
SIGMAS95 = 1.96
CONFUSED = (8.0, 4.0, 2.0, 0.5, 0.25, 0.125)
"""ratios that slow motion's files have: 240 frames a second that are played at 120, 60 or 30, or the reverse"""
RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 200.0, 240.0, 480.0, 960.0)
"""frames a second that cameras have"""


def stated_scale(evidence: Evidence) -> Scale:
    """Mass and gravity; of several places the worst known g, for to share it is safe, and to average it would not be.

    k goes with g as with the frame rate squared: what a stated rate is unsure of is in g.
    """
    spec, g = evidence.spec, evidence.manifest.g_m_s2
    own = max(recording.manifest.g_sd_m_s2 for recording in evidence.recordings)
    rate = max((rate_sd(each.manifest) for each in evidence.recordings), default=0.0)
    return Scale(spec.mass_kg, spec.mass_sd_kg, g, float(np.hypot(own, 2 * rate * g)))


def rate_sd(manifest: SessionManifest) -> float:
    """Relative 1 sigma of a recording's frame rate: as it was measured, else as rates that files state are known; 0 of a rig's."""
    camera = manifest.cameras[0]
    if camera.frame_rate_sd_hz is not None:
        return camera.frame_rate_sd_hz / camera.frame_rate_hz
    return RATE_SD if manifest.time_source is TimeSource.CONTAINER_PTS else 0.0


def borne_out(
    evidence: Evidence, planes: Sequence[EquiPlane], scale: Scale, times: Sequence[FrameTimes]
) -> tuple[tuple[EquiPlane, ...], Scale]:
    """Planes and scale as they may be used where a stated rate cannot be: phi needs none.

    Of one recording g is left open, so that its k's still tell of each other; of several, the k's of those with wrong times are left out.
    """
    wrong = {each.recording - 1 for each in times if not each.possible}
    if not wrong:
        return tuple(planes), scale
    if len(evidence.recordings) == 1:
        return tuple(planes), replace(scale, gravity_sd=OPEN * scale.gravity)
    return tuple(
        replace(plane, k=None, sd_k=None, cov_phi_k=0.0) if evidence.recorded_in.get(plane.strike_id, 0) in wrong else plane
        for plane in planes
    ), scale


def felt(scale: Scale, solution: JointSolution) -> Scale:
    """With g as the strikes' motions have it by their times: the stated one, unless it was left open."""
    if scale.gravity_sd < OPEN * scale.gravity:
        return scale
    return replace(scale, gravity=scale.gravity * float(np.exp(scale.gravity_sd / scale.gravity * solution.x[GRAVITY])))


def frame_times(
    evidence: Evidence,
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: Moments,
    cells: Cells,
) -> list[FrameTimes]:
    """One per recording whose times come from a file's time stamps."""
    found: list[FrameTimes] = []
    for index, recording in enumerate(evidence.recordings):
        manifest = recording.manifest
        if manifest.time_source is not TimeSource.CONTAINER_PTS:
            continue
        own = [plane for plane in planes if evidence.recorded_in.get(plane.strike_id, 0) == index]
        check = rate_check(own, systematic, prior, moments, _places(evidence, cells)) if own else None
        rate = manifest.cameras[0].frame_rate_hz
        found.append(
            FrameTimes(
                recording=index + 1,
                source=manifest.time_source.value,
                sd_s=1e-9 * manifest.time_source_sd_ns,
                frame_rate_hz=rate,
                frame_rate_sd_hz=manifest.cameras[0].frame_rate_sd_hz,
                contact_sd_s=_contact_sd(evidence, {plane.strike_id for plane in own}),
                rate_limits=None if check is None else [check.low, check.high],
                rate_ratio=None if check is None or check.told is None else _quantity(check.told.ratio, check.told.sd),
                possible=check is None or check.possible,
                likely_rate_hz=None if check is None or check.possible else _likely(check, rate),
            )
        )
    return found


def _quantity(value: float, sd: float) -> Quantity:
    return Quantity(value=value, sd=sd, unit="1", interval95=[value - SIGMAS95 * sd, value + SIGMAS95 * sd])


def _places(evidence: Evidence, cells: Cells) -> Array:
    """Points (n, 3) of the shape where mass may be: some throughout it, and all its ends."""
    inside = cells.points[:: max(1, len(cells.points) // POINTS)]
    return np.vstack([inside, evidence.model.hull_vertices[:: max(1, len(evidence.model.hull_vertices) // POINTS)]])


def _contact_sd(evidence: Evidence, used: set[str]) -> float | None:
    """The middle one of the strikes' [s]."""
    fits = [motion.fit for motion in evidence.motions if motion.strike_id in used]
    times = [contact_time(fit) for fit in fits if fit is not None]
    sds = [1e-9 * time.sd_ns for time in times if time is not None]
    return float(np.median(sds)) if sds else None


def _likely(check: RateCheck, rate: float) -> float | None:
    """The rate in Hz that the strikes allow and slow motion explains; else the only usual one; None: several, or none."""
    low, high = check.low, check.high
    if check.told is not None:
        reach = 3 * check.told.sd
        low, high = max(low, check.told.ratio - reach), min(high, check.told.ratio + reach)
    confused = [ratio * rate for ratio in CONFUSED if low <= ratio <= high]
    usual = [each for each in RATES if low * rate <= each <= high * rate]
    for some in (confused, usual):
        if len(some) == 1:
            return some[0]
    return None
