"""Check of a video file's stated frame rate against the strikes, and consequences for the estimate.

A strike's rate constant k scales with the square of the frame rate, its balance angle phi does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.joint_model import GRAVITY
from analyze.estimation.priors import Scale
from analyze.estimation.rate import OPEN_LOG_GRAVITY_SD, RateCheck, rate_check
from analyze.motion.contact_time import contact_time
from schemas.session_manifest import TimeSource

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.cells import Cells
    from analyze.estimation.joint import JointSolution, MomentModel
    from analyze.estimation.priors import ComPrior, SystematicErrors
    from analyze.pipeline.evidence import Evidence
    from analyze.types import Array, EquiPlane
    from schemas.session_manifest import SessionManifest

STATED_RATE_SD = 0.002
"""relative 1 sigma of a frame rate that only a file states: 240 may be 239.76, and a phone's quartz drifts"""
MAX_SHAPE_POINTS = 800
"""approximate number of points where mass may be, from the cells and again from the hull's vertices; more do
not change the bounds of the frame rate"""
SLOW_MOTION_RATIOS = (8.0, 4.0, 2.0, 0.5, 0.25, 0.125)
"""true rate over stated rate in slow-motion files: 240 Hz played at 120, 60 or 30, or the reverse"""
USUAL_RATES_HZ = (24.0, 25.0, 30.0, 50.0, 60.0, 100.0, 120.0, 200.0, 240.0, 480.0, 960.0)
"""frame rates that cameras offer"""


@dataclass(frozen=True)
class FrameRate:
    """Frame rate that one recording's video file states, and its check by that recording's strikes."""

    recording: int
    """number of the recording by start time, from 1"""
    time_source: TimeSource
    """origin of the frame times"""
    time_sd_s: float
    """1 sigma of a frame's time against the other frames' [s]"""
    stated_hz: float
    """frame rate that the file states [Hz]"""
    stated_sd_hz: float | None
    """1 sigma [Hz] measured with a filmed drop; None where the rate is only stated"""
    contact_sd_s: float | None
    """median 1 sigma of the strikes' contact times, from the onset of motion [s]; None where no strike has
    one"""
    check: RateCheck | None
    """bounds and estimate of the true over the stated rate; None where no strike of the recording is used, or
    their k allow no check"""
    likely_hz: float | None
    """the only slow-motion or usual rate [Hz] that is consistent with the strikes; None if several or none
    are, or if the stated one is possible"""

    @property
    def possible(self) -> bool:
        """True if the frame rate that the file states can be the true one, or could not be checked."""
        return self.check is None or self.check.possible


def stated_scale(evidence: Evidence) -> Scale:
    """Mass [kg] by the object file and gravity g [m/s²] by the recordings, each with its sd.

    g is the first recording's. Its sd is the largest that a recording states, and counts as one error shared
    by all strikes: taken as independent at each place, the errors would average out and intervals be too
    narrow. The measured rate constant k is proportional to g and to the square of the frame rate; the
    uncertainty of a stated rate is therefore added to the sd of g.
    """
    spec, g = evidence.spec, evidence.manifest.g_m_s2
    own = max(recording.manifest.g_sd_m_s2 for recording in evidence.recordings)
    rate = max((relative_rate_sd(each.manifest) for each in evidence.recordings), default=0.0)
    return Scale(spec.mass_kg, spec.mass_sd_kg, g, float(np.hypot(own, 2 * rate * g)))


def relative_rate_sd(manifest: SessionManifest) -> float:
    """Standard deviation of a recording's frame rate, divided by the rate.

    It is as measured where the manifest (the recording's metadata) gives an sd, `STATED_RATE_SD` where only a
    video file states the rate, and 0 otherwise (a rig's camera).
    """
    camera = manifest.cameras[0]
    if camera.frame_rate_sd_hz is not None:
        return camera.frame_rate_sd_hz / camera.frame_rate_hz
    return STATED_RATE_SD if manifest.time_source is TimeSource.CONTAINER_PTS else 0.0


def drop_untimed_k(
    evidence: Evidence, planes: Sequence[EquiPlane], scale: Scale, rates: Sequence[FrameRate]
) -> tuple[tuple[EquiPlane, ...], Scale]:
    """Keep the rate constants k of recordings with an impossible frame rate from biasing the estimate.

    k of a strike's motion theta'' = -k sin(phi - theta) scales with the square of the frame rate; the balance
    angle needs no rate. With several recordings, the k of those whose stated rate is impossible are
    discarded. With a single one, gravity g becomes a free parameter instead, so that the ratios between its k
    still count.

    Args:
        evidence: recordings, and the recording that each strike belongs to.
        planes: planes through pivot line and centre of mass of the strikes used, with k at the stated rates.
        scale: mass and gravity as stated.
        rates: checked frame rates.

    Returns:
        The planes, some of them without k, and mass and gravity, with a very wide sd of g where it is a free
        parameter; both unchanged if all rates are possible.
    """
    wrong = {each.recording - 1 for each in rates if not each.possible}
    if not wrong:
        return tuple(planes), scale
    if len(evidence.recordings) == 1:
        return tuple(planes), replace(scale, gravity_sd=OPEN_LOG_GRAVITY_SD * scale.gravity)
    kept = [
        replace(plane, k=None, sd_k=None, cov_phi_k=0.0)
        if evidence.recorded_in.get(plane.strike_id, 0) in wrong
        else plane
        for plane in planes
    ]
    return tuple(kept), scale


def with_estimated_gravity(scale: Scale, solution: JointSolution) -> Scale:
    """Mass and gravity with g replaced by its joint estimate, if g was a free parameter of the estimate.

    `scale` is the mass and gravity that the joint estimate `solution` started from. g was free if its sd
    there is at least `OPEN_LOG_GRAVITY_SD` times g; otherwise `scale` is returned unchanged.
    """
    if scale.gravity_sd < OPEN_LOG_GRAVITY_SD * scale.gravity:
        return scale
    return replace(
        scale, gravity=scale.gravity * float(np.exp(scale.gravity_sd / scale.gravity * solution.x[GRAVITY]))
    )


def check_frame_rates(
    evidence: Evidence,
    planes: Sequence[EquiPlane],
    systematic: SystematicErrors,
    prior: ComPrior,
    moments: MomentModel,
    cells: Cells,
) -> list[FrameRate]:
    """Check the frame rate stated with each recording whose frame times are a video file's time stamps.

    It is checked against the rate constants k of the recording's strikes, as k scales with the rate squared.

    Args:
        evidence: recordings, their strikes and the shape.
        planes: planes through pivot line and centre of mass of all strikes used, with their rate constants k
            at the stated frame rates.
        systematic: standard deviations of errors that strikes share (table tilt, shape scale, edge radius).
        prior: prior of the centre of mass.
        moments: model of k, with mass, gravity and the shape's inertia prior.
        cells: the body divided into cells, where its mass may be.

    Returns:
        One entry per such recording, in order of start time; empty if there is none: the stated rate, and as
        its check the bounds and, if determined, an estimate of the ratio of true to stated rate. The check is
        None if no strike of the recording is used or their k allow none.
    """
    found: list[FrameRate] = []
    for index, recording in enumerate(evidence.recordings):
        manifest = recording.manifest
        if manifest.time_source is not TimeSource.CONTAINER_PTS:
            continue
        own = [plane for plane in planes if evidence.recorded_in.get(plane.strike_id, 0) == index]
        check = rate_check(own, systematic, prior, moments, _mass_points(evidence, cells)) if own else None
        rate = manifest.cameras[0].frame_rate_hz
        found.append(
            FrameRate(
                recording=index + 1,
                time_source=manifest.time_source,
                time_sd_s=1e-9 * manifest.time_source_sd_ns,
                stated_hz=rate,
                stated_sd_hz=manifest.cameras[0].frame_rate_sd_hz,
                contact_sd_s=_contact_sd_s(evidence, {plane.strike_id for plane in own}),
                check=check,
                likely_hz=None if check is None or check.possible else _likely_rate_hz(check, rate),
            )
        )
    return found


def _mass_points(evidence: Evidence, cells: Cells) -> Array:
    """Points (n, 3) [m] where mass may be, in the object frame O.

    They are a sample of the centres of the body's cells (small pieces) and of the vertices of its hull.
    """
    inside = cells.points[:: max(1, len(cells.points) // MAX_SHAPE_POINTS)]
    hull = evidence.model.hull_vertices
    return np.vstack([inside, hull[:: max(1, len(hull) // MAX_SHAPE_POINTS)]])


def _contact_sd_s(evidence: Evidence, used: set[str]) -> float | None:
    """Median [s] of the standard deviations of the contact times of the strikes with ids `used`.

    A contact time is found by extrapolating the fitted tipping motion back to angle 0. None if no strike has
    one.
    """
    fits = [motion.fit for motion in evidence.motions if motion.strike_id in used]
    times = [contact_time(fit) for fit in fits if fit is not None]
    sds = [1e-9 * time.sd_ns for time in times if time is not None]
    return float(np.median(sds)) if sds else None


def _likely_rate_hz(check: RateCheck, rate: float) -> float | None:
    """Frame rate [Hz] that is probably the true one; None if the strikes do not single one out.

    Rates are tried that lie within the bounds of `check` and, if it has an estimate, within 3 sd of that. If
    just one of them is 2, 4 or 8 times the stated `rate` [Hz] or 1/2, 1/4 or 1/8 of it (slow motion), it is
    returned; otherwise, if just one is a rate that cameras usually have, that one.
    """
    low, high = check.low, check.high
    if check.estimate is not None:
        reach = 3 * check.estimate.sd
        low, high = max(low, check.estimate.ratio - reach), min(high, check.estimate.ratio + reach)
    slow = [ratio * rate for ratio in SLOW_MOTION_RATIOS if low <= ratio <= high]
    usual = [each for each in USUAL_RATES_HZ if low * rate <= each <= high * rate]
    for candidates in (slow, usual):
        if len(candidates) == 1:
            return candidates[0]
    return None
