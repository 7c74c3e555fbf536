"""Random calibration errors applied to the strikes of a session.

The evidence is then that of a rig and a scan known less precisely. The errors change the balance angle phi
and the rate constant k of the strikes, the edges and the mass. The estimators are given the standard
deviations of the errors of tilt, mass and edges in place of the stated ones, but not the errors drawn. All
strikes of one session share one tilt, one mass and one mean edge radius; all strikes of one axis share one
edge and its k. Errors that every estimate allows for (air drag, an edge rounder than the others) are drawn as
well, so that the ratio of error to stated sd can reach 1.
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
"""Tilt of gravity against the table [rad], towards W's x and y each."""
SCAN_SD = 3e-4
"""Error of each edge's position [m], in both directions across it."""
ANGLE_SD = 2e-4
"""Error of each axis's angle [rad]: 0.2 % of the focal length for a tag that is a tenth of its distance off
the optical axis (on the optical axis the error has no effect)."""
MASS_SD = 1e-4
"""Error of the mass [kg]."""
RADIUS_SD = 3e-4
"""Error of the edges' mean radius [m], for a radius that was not measured."""
OWN_RADIUS_SD = 0.3 * RADIUS_SD
"""Deviation of each edge's radius [m] from the mean of all edges."""
K_SD = 2e-3
"""Relative error of each axis's k: air drag, play of the edge."""
MIN_EDGE_RADIUS_M = 1e-4
"""Lower limit of a drawn edge radius [m]."""


def with_calibration_errors(evidence: Evidence, rng: np.random.Generator) -> Evidence:
    """Evidence (fitted motions of all strikes, with object and plan) with random calibration errors applied.

    The errors are those of table tilt, edges' places and radii, balance angle, rate constant k and mass, with
    the standard deviations of this module's constants. Those of tilt, places, mean radius and mass are also
    stated in the evidence, as a user would.

    Args:
        evidence: strikes of one recording on a well calibrated rig; it is not changed.
        rng: generator that draws the errors.

    Returns:
        The evidence with changed fits, edges and mass.
    """
    tilt = rng.normal(0.0, TILT_SD, 2)
    rounding = float(rng.normal(0.0, RADIUS_SD))
    axes = list(dict.fromkeys(strike.axis_id for strike in evidence.plan.strikes))
    shifts = {axis: rng.normal(0.0, SCAN_SD, 2) for axis in axes}
    angles = {axis: float(rng.normal(0.0, ANGLE_SD)) for axis in axes}
    roundings = {axis: rounding + float(rng.normal(0.0, OWN_RADIUS_SD)) for axis in axes}
    k_factor = {axis: 1.0 + float(rng.normal(0.0, K_SD)) for axis in axes}
    motions: list[TipMotion] = []
    for motion in evidence.motions:
        strike = evidence.planned(motion)
        along_tip = float(tilt @ [math.cos(strike.heading_rad), math.sin(strike.heading_rad)])
        motions.append(_changed(motion, along_tip + angles[strike.axis_id], k_factor[strike.axis_id]))
    spec = evidence.spec
    spec = spec.model_copy(
        update={
            "mass_kg": spec.mass_kg + float(rng.normal(0.0, MASS_SD)),
            "mass_sd_kg": MASS_SD,
            "edge_radius_sd_m": RADIUS_SD,
        }
    )
    plan = evidence.plan.model_copy(
        update={
            "strikes": [
                _edge_moved(strike, roundings[strike.axis_id], shifts[strike.axis_id])
                for strike in evidence.plan.strikes
            ]
        }
    )
    head = evidence.recordings[0]
    manifest = head.manifest.model_copy(update={"gravity_tilt_sd_rad": TILT_SD})
    return replace(
        evidence, spec=spec, plan=plan, motions=tuple(motions), recordings=(replace(head, manifest=manifest),)
    )


def _changed(motion: TipMotion, phi_error: float, k_factor: float) -> TipMotion:
    """Motion with `phi_error` [rad] added to phi and k multiplied by `k_factor`, in all its fits.

    phi is the balance angle, k the rate constant of the tip; a k that is None stays None.
    """

    def changed(fit: MotionFit) -> MotionFit:
        return replace(fit, phi=fit.phi + phi_error, k=None if fit.k is None else fit.k * k_factor)

    return replace(
        motion,
        fit=None if motion.fit is None else changed(motion.fit),
        alternatives=tuple(map(changed, motion.alternatives)),
    )


def _edge_moved(strike: PlannedStrike, rounding: float, shift: Array) -> PlannedStrike:
    """Strike with a changed radius and place of its pivot edge.

    The radius is at least `MIN_EDGE_RADIUS_M`. A larger one moves the centre line of the rounding up and
    against the direction of tipping by as much. The stated sd of the place becomes `SCAN_SD`.

    Args:
        strike: the planned strike.
        rounding: length added to the edge's radius [m].
        shift: (2,) shift of the edge in the direction of tipping, and up [m].
    """
    R = np.array(strike.R_world_object)
    tip, up = R[0], R[2]
    radius = max(strike.pivot.radius_m + rounding, MIN_EDGE_RADIUS_M)
    rounder = radius - strike.pivot.radius_m
    point = np.array(strike.pivot.point) + rounder * (up - tip) + shift[0] * tip + shift[1] * up
    pivot = strike.pivot.model_copy(update={"point": point.tolist(), "radius_m": radius, "sd_m": SCAN_SD})
    return strike.model_copy(update={"pivot": pivot})
