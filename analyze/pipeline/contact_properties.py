"""Friction, restitution and rolling loss between the object and its table, from an estimate's strikes."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import EstimationError
from analyze.estimation.contact_properties import (
    HIGHEST_MU,
    LOWEST_MU,
    ContactProperties,
    LandingRestitution,
    StrikeFriction,
    combined_friction,
    combined_restitution,
    combined_rolling,
    held_evidence,
)
from analyze.motion.held_edge import LASTING_S, HeldRatio, held_ratio, rolling_loss, slide_range
from analyze.motion.landing_impact import LandingBody, landing
from analyze.motion.sliding_fit import FrictionLikelihood, PivotBody, friction_likelihood
from analyze.pipeline.sections import strike_supports

if TYPE_CHECKING:
    from analyze.estimation.mass_properties import CentreOfMass
    from analyze.geometry.object_model import ObjectModel
    from analyze.pipeline.estimate import Estimate
    from analyze.pipeline.evidence import Evidence
    from analyze.types import MotionFit, Phases, TipAngle, TipMotion
    from schemas.strike_plan import PlannedStrike

_PAST_BALANCE = 0.12
"""angle past balance [rad] from which the fall is used: up to there an edge holds, unless mu is below 0.1"""
_HELD_RANGE = 1.5e-4
"""sliding [m] up to which the edge counts as held on its way up"""
_SLID_RANGE = 4e-4
"""sliding [m] on the way up from which it is fitted"""
_RADIUS_SD = 3e-4
"""standard deviation of an edge's radius [m]"""
_OFF_AXIS = math.radians(4.0)
"""turn about other axes [rad] at which a fall over a rim no longer is a plane motion"""
_OWN_TILT_SD = 1e-4
"""standard deviation of the table's tilt from strike to strike [rad]"""
_ON_TABLE_M = 1e-3
"""height over the table [m] up to which a point belongs to the resting face"""
_CURVE_POINTS = 1500
"""coefficients of friction at which a strike's evidence is kept"""
_LEAST_BODY = 5e-3
"""least distance [m] of a line that lands from the edge"""


@dataclass(frozen=True)
class _Strike:
    """One strike with what the contact estimate needs of it."""

    motion: TipMotion
    planned: PlannedStrike
    angle: TipAngle
    phases: Phases
    fit: MotionFit
    body: PivotBody
    tilt_sd: float
    """standard deviation of the table's tilt in the direction of tipping [rad], which strikes share"""


def contact_properties(evidence: Evidence, com: CentreOfMass) -> ContactProperties:
    """Friction, restitution and rolling loss from the strikes of an estimate.

    Used are the strikes that the estimate used, about the planned edge (a strike that balanced over the next
    line of the shape, or rolled on a curve, shows only its landing).

    Args:
        evidence: fitted motions of the strikes.
        com: centre of mass of the body that tipped, with the planes of the strikes used.
    """
    friction: list[StrikeFriction] = []
    landings: list[LandingRestitution] = []
    arms: list[tuple[float, float]] = []
    strikes = _strikes(evidence, com)
    for strike in strikes:
        if strike.fit.rolling is None:
            friction.append(_friction(strike))
        if (landed := _landing(evidence.model, strike)) is not None:
            landings.append(landed)
        loss = rolling_loss(strike.fit, strike.angle, strike.body.R)
        if loss is not None:
            arms.append((loss.arm, loss.sd))
    return ContactProperties(
        table_name(evidence),
        combined_friction(
            [each for each in friction if len(each.mu) > 1],
            max((strike.tilt_sd for strike in strikes), default=0.0),
        ),
        combined_restitution(landings),
        combined_rolling(arms),
    )


def with_contact_properties(estimate: Estimate) -> Estimate:
    """Copy of an estimate with the friction and restitution that its strikes show, where they show any."""
    found = contact_properties(estimate.evidence, estimate.com_struck)
    seen = (found.friction, found.restitution, found.rolling)
    return replace(estimate, contact=found) if any(each is not None for each in seen) else estimate


def table_name(evidence: Evidence) -> str:
    """Name of the table as the rig files state it (`table_name`), or "the table of this recording"."""
    names: set[str] = set()
    for head in evidence.recordings:
        try:
            stated = tomllib.loads(head.rig_toml or "").get("table_name")
        except tomllib.TOMLDecodeError:
            stated = None
        if isinstance(stated, str):
            names.add(stated)
    several = len(evidence.recordings) > 1
    return (
        " and ".join(sorted(names)) or f"the table of {'these recordings' if several else 'this recording'}"
    )


def _strikes(evidence: Evidence, com: CentreOfMass) -> list[_Strike]:
    """Strikes of an estimate with their bodies, in recording order."""
    motions = {motion.strike_id: motion for motion in evidence.motions}
    found: list[_Strike] = []
    for i, plane in enumerate(com.planes):
        motion = motions[plane.strike_id]
        fit = motion.fit
        if fit is None or fit.k is None or motion.angle is None or motion.phases is None:
            continue
        if motion.carried_by is not None or motion.edge_path is None:
            continue
        planned = evidence.planned(motion)
        tilt = com.tilts[plane.level] if plane.level < len(com.tilts) else None
        towards = np.array([math.cos(plane.heading), math.sin(plane.heading)])
        lean = 0.0 if tilt is None else float(towards @ tilt.lean)
        lean_sd = 0.0 if tilt is None else math.sqrt(float(towards @ tilt.covariance @ towards))
        scale = np.array([1.0, 1.0 / fit.k])
        body = PivotBody(
            fit.phi,
            fit.k,
            fit.covariance * np.outer(scale, scale),
            float(com.distances[i]),
            math.hypot(math.sqrt(float(com.distance_covariance[i, i])), plane.edge_sd),
            planned.pivot.radius_m,
            plane.radius_sd or _RADIUS_SD,
            lean,
            _OWN_TILT_SD,
            evidence.recording_of(motion.strike_id).manifest.g_m_s2,
        )
        found.append(_Strike(motion, planned, motion.angle, motion.phases, fit, body, lean_sd))
    return found


def _friction(strike: _Strike) -> StrikeFriction:
    """Evidence of one strike on friction: its fall, and its way up."""
    likelihoods = [each for each in (_fall(strike), _rise_slide(strike)) if each is not None]
    held = _held(strike) if not any(each.slid > _SLID_RANGE for each in likelihoods[1:]) else None
    fine = np.geomspace(LOWEST_MU, HIGHEST_MU, _CURVE_POINTS)
    curves = [(fine, each.value(fine)) for each in likelihoods]
    if held is not None:
        curves.append(held_evidence(held.ratio, held.sd))
    mu = np.unique(np.concatenate([curve[0] for curve in curves])) if curves else np.zeros(0)
    chi2 = np.sum([np.interp(mu, *curve) for curve in curves], axis=0) if curves else np.zeros(0)
    return StrikeFriction(
        strike.motion.strike_id,
        mu,
        chi2 - chi2.min(initial=np.inf) if len(mu) else chi2,
        max((each.slid for each in likelihoods), default=0.0),
        None if held is None else held.ratio,
        None if held is None else held.sd,
    )


def _fall(strike: _Strike) -> FrictionLikelihood | None:
    """Likelihood of friction from the fall past balance; None if the strike has none."""
    if strike.phases.stage_two is None:
        return None
    theta = strike.angle.theta
    begin, end = strike.phases.stage_two
    first = begin + int(np.argmax(theta[begin:end] > strike.body.phi + _PAST_BALANCE))
    last = end - 1
    if strike.planned.rolls:
        aside = np.flatnonzero(strike.angle.off_axis[first:last] > _OFF_AXIS)
        last = first + int(aside[0]) if len(aside) else last
    return _likelihood(strike, (first, last), moving=False)


def _rise_slide(strike: _Strike) -> FrictionLikelihood | None:
    """Likelihood of friction from a slide between the impact and balance; None if there is none."""
    window = _rise(strike)
    if slide_range(strike.angle, strike.motion.edge_path, window) < _SLID_RANGE:  # type: ignore[arg-type]
        return None
    return _likelihood(strike, window, moving=True)


def _rise(strike: _Strike) -> tuple[int, int]:
    """Frames [start, stop) of the free motion up to balance."""
    begin, end = strike.phases.stage_one or (0, 0)
    return max(begin, strike.fit.window[0]), min(end, strike.fit.window[1])


def _likelihood(strike: _Strike, window: tuple[int, int], *, moving: bool) -> FrictionLikelihood | None:
    path = strike.motion.edge_path
    if path is None:
        return None
    try:
        return friction_likelihood(strike.angle, path, window, strike.body, moving=moving)
    except (EstimationError, np.linalg.LinAlgError):
        return None


def _held(strike: _Strike) -> HeldRatio | None:
    """Friction that the edge needed while it held on its way up; None if it slid, or in too few frames."""
    window, path = _rise(strike), strike.motion.edge_path
    if path is None or window[1] - window[0] < 6 or slide_range(strike.angle, path, window) > _HELD_RANGE:
        return None
    last = 1e-9 * float(strike.angle.time_ns[window[1] - 1] - strike.fit.time0_ns)
    return held_ratio(strike.fit, strike.body, last - LASTING_S)


def _landing(model: ObjectModel, strike: _Strike) -> LandingRestitution | None:
    """Restitution at the landing of a strike; None if none is seen."""
    path, phase = strike.motion.edge_path, strike.phases.landing
    if path is None or phase is None or phase[0] < 1:
        return None
    body = _landing_body(model, strike)
    if body is None:
        return None
    found = landing(strike.angle, path, body, phase[0] - 1, strike.body.gravity)
    if found is None:
        return None
    return LandingRestitution(
        strike.motion.strike_id,
        found.restitution,
        found.sd,
        found.upper,
        found.speed,
        found.omega_before,
        found.omega_after,
    )


def _landing_body(model: ObjectModel, strike: _Strike) -> LandingBody | None:
    """Lines of the body that land: the end of the next face, or of the resting face if it rocked back."""
    planned, body = strike.planned, strike.body
    com = body.R * np.array([-math.sin(body.phi), math.cos(body.phi)])
    if strike.phases.stage_two is None:
        at_rest = (model.hull_vertices - np.array(planned.pivot.point)) @ np.array(planned.R_world_object).T
        low = at_rest[at_rest[:, 2] < at_rest[:, 2].min() + _ON_TABLE_M]
        back = float(low[:, 0].min()) + planned.pivot.radius_m
        line = np.array([back, 0.0])
        return LandingBody(line, np.zeros((0, 2)), com) if back < -_LEAST_BODY else None
    lines = strike_supports(model, planned)
    if lines is None or len(lines) < 2 or any(line.is_curve for line in lines[:2]):
        return None
    places = np.array([[line.along_m - lines[0].along_m, line.up_m - lines[0].up_m] for line in lines[1:]])
    if float(np.linalg.norm(places[0])) < _LEAST_BODY:
        return None
    return LandingBody(places[0], places[1:], com)
