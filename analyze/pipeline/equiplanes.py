"""Equi-planes (through pivot line and centre of mass) of fitted motions, and strikes' shared errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from analyze.estimation.equiplane import equiplane
from analyze.estimation.priors import SystematicErrors, TiltPrior
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.merge import (
    levelling_indices,
)
from analyze.types import (
    EquiPlane,
    TipMotion,
)

if TYPE_CHECKING:
    from schemas.session_manifest import SessionManifest
    from schemas.strike_plan import PlannedStrike


def equiplanes(
    evidence: Evidence, motions: Sequence[TipMotion], estimator: str | None = None
) -> tuple[EquiPlane, ...]:
    """Equi-planes of fitted motions, with each k scaled to gravity where the first recording was made.

    An equi-plane passes through a strike's pivot line and the centre of mass. The rate constant k = m g R /
    I_edge [rad/s^2] is fitted to the strike's motion, with m g the object's weight, R the distance of the
    centre of mass from the pivot line and I_edge the moment of inertia about it.

    Args:
        evidence: strikes of one or several recordings, with plan, object and manifests.
        motions: fitted motions.
        estimator: name of the estimator whose balance angle phi and k are used where it fitted a motion;
            None for the fit chosen for each motion.

    Returns:
        One plane per motion, in the order of `motions`, in the object frame O.

    Raises:
        EstimationError: a motion has no fit, or its planned pivot does not lie along the world's y.
    """
    levels = levelling_indices(evidence.recordings)
    found: list[EquiPlane] = []
    for motion in motions:
        plane = equiplane_by(evidence.planned(motion), motion, estimator)
        index = evidence.recorded_in.get(motion.strike_id, 0)
        gravity_ratio = evidence.manifest.g_m_s2 / evidence.recordings[index].manifest.g_m_s2
        k = None if plane.k is None else plane.k * gravity_ratio
        sd_k = None if plane.sd_k is None else plane.sd_k * gravity_ratio
        found.append(
            replace(plane, k=k, sd_k=sd_k, cov_phi_k=plane.cov_phi_k * gravity_ratio, level=levels[index])
        )
    return tuple(found)


def systematic_errors(evidence: Evidence) -> SystematicErrors:
    """Standard deviations of errors that strikes share: shape scale, edge radius, table tilt.

    They are taken from `evidence`. Those of scale (relative) and edge radius [m] are the object file's. Each
    levelling (set-up of the table) has one unknown tilt [rad] against gravity. Where the manifest (the
    recording's metadata) holds the reading of a level (the instrument), the tilt is that reading within its
    sd; otherwise 0 within the sd that the manifest states.
    """
    levels = levelling_indices(evidence.recordings)
    tilts = {level: each.manifest for level, each in zip(levels, evidence.recordings, strict=True)}
    return SystematicErrors(
        gravity_tilt_sd=tilts[0].gravity_tilt_sd_rad,
        scale_sd=evidence.spec.shape.scale_sd,
        edge_radius_sd=evidence.spec.edge_radius_sd_m,
        other_tilt_sds=tuple(tilts[level].gravity_tilt_sd_rad for level in range(1, len(tilts))),
        readings=tuple(_level_prior(tilts[level]) for level in range(len(tilts))),
    )


def _level_prior(manifest: SessionManifest) -> TiltPrior | None:
    """Lean of the vertical towards the world's x and y, and its two sd [rad], from a level's reading.

    The level (instrument) reads positive if that side of the table is the higher one. None if the manifest
    (the recording's metadata) has no reading. If the reading has no sd towards y, the sd is the one that the
    manifest states for a table without a level.
    """
    read = manifest.level
    if read is None:
        return None
    sideways = manifest.gravity_tilt_sd_rad if read.towards_y_sd_rad is None else read.towards_y_sd_rad
    return TiltPrior((read.towards_x_rad, read.towards_y_rad), (read.towards_x_sd_rad, sideways))


def equiplane_by(planned: PlannedStrike, motion: TipMotion, estimator: str | None) -> EquiPlane:
    """Equi-plane of a strike by the named estimator, or by the fit chosen for its motion.

    The chosen fit is used if the estimator did not fit the motion, or is None. The plane passes through the
    strike's pivot line and the centre of mass, and is in the object frame O.

    Raises:
        EstimationError: the motion has no fit, or the planned pivot does not lie along the world's y.
    """
    fits = (motion.fit, *motion.alternatives)
    chosen = next((fit for fit in fits if fit is not None and fit.estimator == estimator), motion.fit)
    return equiplane(motion.strike_id, planned, replace(motion, fit=chosen))
