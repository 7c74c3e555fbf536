"""Calibration errors drawn at random: the same strikes, as somebody would have them whose rig and scan are known no better than this.

What the errors do to phi, k and the edges is written into the evidence, and their sd is stated in place of the rig's own; what they are is
told to nobody. All strikes of one session share one tilt, one mass and one mean rounding, all strikes of one axis one edge and its k. What
an answer always allows for (air, an edge rounder than the others) is drawn too, so that errors over stated sd can be 1.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.types import Array, MotionFit, TipMotion

if TYPE_CHECKING:
    from analyze.pipeline.evidence import Evidence
    from schemas.strike_plan import PlannedStrike

TILT_SD = math.radians(0.2)
"""rad, of gravity against the table, towards W's x and y"""
SCAN_SD = 3e-4
"""m, of each edge's place, in both directions across it"""
ANGLE_SD = 2e-4
"""rad, of each axis: 0.2 % of the focal length where the tag is a tenth of its distance off the axis (on the axis it is not seen at all)"""
MASS_SD = 1e-4
"""kg"""
RADIUS_SD = 3e-4
"""m, of the edges' rounding, which nobody measured"""
OWN_RADIUS_SD = 0.3 * RADIUS_SD
"""m, of each edge's beside what all have in common"""
K_SD = 2e-3
"""relative, of each axis's k: air, play of the edge"""
LEAST_RADIUS = 1e-4
"""m"""


def miscalibrated(evidence: Evidence, rng: np.random.Generator) -> Evidence:
    """The evidence with calibration errors drawn and stated (METHOD's table of targets).

    Args:
        evidence: of one recording on a rig whose calibration is good.
        rng: draws them.
    """
    lean = rng.normal(0.0, TILT_SD, 2)
    rounding = float(rng.normal(0.0, RADIUS_SD))
    axes = list(dict.fromkeys(strike.axis_id for strike in evidence.plan.strikes))
    shifts = {axis: rng.normal(0.0, SCAN_SD, 2) for axis in axes}
    angles = {axis: float(rng.normal(0.0, ANGLE_SD)) for axis in axes}
    roundings = {axis: rounding + float(rng.normal(0.0, OWN_RADIUS_SD)) for axis in axes}
    slowness = {axis: 1.0 + float(rng.normal(0.0, K_SD)) for axis in axes}
    strikes = {strike.id: strike for strike in evidence.plan.strikes}
    motions: list[TipMotion] = []
    for motion in evidence.motions:
        strike = strikes[motion.plan_strike_id]
        leaning = float(lean @ [math.cos(strike.heading_rad), math.sin(strike.heading_rad)])
        motions.append(_changed(motion, leaning + angles[strike.axis_id], slowness[strike.axis_id]))
    spec = evidence.spec
    spec = spec.model_copy(
        update={
            "mass_kg": spec.mass_kg + float(rng.normal(0.0, MASS_SD)),
            "mass_sd_kg": MASS_SD,
            "edge_radius_sd_m": RADIUS_SD,
        }
    )
    plan = evidence.plan.model_copy(
        update={"strikes": [_edge_moved(strike, roundings[strike.axis_id], shifts[strike.axis_id]) for strike in evidence.plan.strikes]}
    )
    head = evidence.recordings[0]
    manifest = head.manifest.model_copy(update={"gravity_tilt_sd_rad": TILT_SD})
    return replace(evidence, spec=spec, plan=plan, motions=tuple(motions), recordings=(replace(head, manifest=manifest),))


def _changed(motion: TipMotion, later: float, faster: float) -> TipMotion:
    """Its balance seen `later` [rad], its k multiplied by `faster`."""

    def changed(fit: MotionFit) -> MotionFit:
        return replace(fit, phi=fit.phi + later, k=None if fit.k is None else fit.k * faster)

    return replace(motion, fit=None if motion.fit is None else changed(motion.fit), alternatives=tuple(map(changed, motion.alternatives)))


def _edge_moved(strike: PlannedStrike, rounding: float, shift: Array) -> PlannedStrike:
    """With another rounding, whose centre line moves with it, and at another place across the edge."""
    R = np.array(strike.R_world_object)
    tip, up = R[0], R[2]
    radius = max(strike.pivot.radius_m + rounding, LEAST_RADIUS)
    rounder = radius - strike.pivot.radius_m
    point = np.array(strike.pivot.point) + rounder * (up - tip) + shift[0] * tip + shift[1] * up
    pivot = strike.pivot.model_copy(update={"point": point.tolist(), "radius_m": radius, "sd_m": SCAN_SD})
    return strike.model_copy(update={"pivot": pivot})
