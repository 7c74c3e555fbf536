"""Equi-planes (through pivot line and centre of mass) of fitted motions, and strikes' shared errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.equiplane import equiplane, equiplane_normal
from analyze.estimation.priors import SystematicErrors, TiltPrior
from analyze.estimation.rest_turns import UNKNOWN_SLOPE_SD, RestTurns, rest_turns
from analyze.geometry.cloud_roundings import MAX_RADIUS
from analyze.geometry.edge_radius import MAX_ASSUMED_RADIUS, blurred_radius, edge_radius, stated_radius
from analyze.geometry.face_slopes import turn_covariance
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.surface_error import surface_sd
from analyze.pipeline.evidence import Evidence
from analyze.pipeline.measured_place import with_measured_places
from analyze.pipeline.merge import (
    levelling_indices,
)
from analyze.pipeline.sections import SCANNED_EDGE_SD
from analyze.planning.pivots import place_sd, wall_lean
from analyze.planning.stable_planes import resting_planes
from analyze.types import Array, EquiPlane, RadiusPrior, RadiusSource, TipMotion

if TYPE_CHECKING:
    from schemas.session_manifest import SessionManifest
    from schemas.strike_plan import PlannedStrike

SAME_FACE_FRACTION = 5e-4
"""distance of an edge from a face's plane, over the shape's longest extent, up to which it lies in the
face"""
SAME_FACE_COSINE = float(np.cos(np.radians(1.0)))
"""cosine of the angle up to which two normals are those of one face"""
MAX_SKEW, MIN_FACET_SLOPE = 0.05, 0.17
"""Conditions for a facet of an edge's rounding: largest cosine of the angle between its normal and the edge,
and smallest cosines of those between its normal and the directions down and forward."""
MIN_CUT_OFF = 0.2
"""height of a sharp corner over a facet of its rounding, over the radius (0.41 for a quarter circle), from
which on the rounding is part of the shape"""
SHAPE_RADIUS_SD = 0.05
"""relative standard deviation of a rounding's radius that is taken from the shape itself"""


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
        plane = with_edge(equiplane_by(evidence.planned(motion), motion, estimator), evidence)
        index = evidence.recorded_in.get(motion.strike_id, 0)
        gravity_ratio = evidence.manifest.g_m_s2 / evidence.recordings[index].manifest.g_m_s2
        k = None if plane.k is None else plane.k * gravity_ratio
        sd_k = None if plane.sd_k is None else plane.sd_k * gravity_ratio
        by_phi, by_k = plane.by_radius
        found.append(
            replace(
                plane,
                k=k,
                sd_k=sd_k,
                cov_phi_k=plane.cov_phi_k * gravity_ratio,
                by_radius=(by_phi, by_k * gravity_ratio),
                level=levels[index],
            )
        )
    planned = [evidence.planned(motion) for motion in motions]
    meshed = evidence.model.cloud is not None and evidence.model.cloud.meshed
    placed = with_measured_places(found, planned, motions, SCANNED_EDGE_SD if meshed else 0.0)
    return _with_rest_turns(placed, turns_at_rest(evidence, motions))


def turns_at_rest(evidence: Evidence, motions: Sequence[TipMotion]) -> RestTurns | None:
    """Turns of the object at rest before the strikes, as markers show them and the shape's slopes err.

    None if no marker shows them and the slopes of the shape's faces are exact.

    Args:
        evidence: strikes with shape and plan.
        motions: motions of the strikes.
    """
    planned = [evidence.planned(motion) for motion in motions]
    rotations = np.array([strike.R_world_object for strike in planned]).reshape(-1, 3, 3)
    by_face = {
        tuple(up): turn_covariance(evidence.model, up) for up in np.unique(rotations[:, 2].round(9), axis=0)
    }
    faces = [tuple(up) for up in rotations[:, 2].round(9)]
    slopes = np.zeros((len(faces), len(faces)))
    for i, face in enumerate(faces):
        alike = [j for j, other in enumerate(faces) if other == face]
        slopes[i, alike] = rotations[alike, 1] @ by_face[face] @ rotations[i, 1]
    return rest_turns([motion.rest_turns for motion in motions], slopes, _unknown_slopes(planned, slopes))


def _unknown_slopes(planned: Sequence[PlannedStrike], slopes: Array) -> dict[str, Array]:
    """Covariance (n, n) [rad^2] of the turns at rest of n strikes if a face's slopes are unknown, by face.

    Only faces of a scan, whose slopes err, are included.
    """
    along = np.array([strike.R_world_object for strike in planned]).reshape(-1, 3, 3)[:, 1]
    found: dict[str, Array] = {}
    for name in sorted({strike.plane_id for strike in planned}):
        mine = np.array([strike.plane_id == name for strike in planned])
        if np.any(slopes[mine]):
            found[name] = UNKNOWN_SLOPE_SD**2 * np.outer(mine, mine) * (along @ along.T)
    return found


def _with_rest_turns(planes: Sequence[EquiPlane], turns: RestTurns | None) -> tuple[EquiPlane, ...]:
    """Equi-planes with each balance angle counted from the planned pose, not from the pose at rest.

    An equi-plane passes through a strike's pivot line and the centre of mass. The planes are unchanged if no
    two strikes show how their poses at rest differ. What remains uncertain of the turns at rest is in
    `EquiPlane.phi_by_rest`.

    Args:
        planes: one per motion.
        turns: turns at rest of the strikes; None if nothing is known of them.
    """
    if turns is None:
        return tuple(planes)
    found: list[EquiPlane] = []
    for plane, turn, by in zip(planes, turns.mean.tolist(), turns.root, strict=True):
        phi = plane.phi + turn
        normal = equiplane_normal(plane.direction, plane.up, phi)
        found.append(replace(plane, phi=phi, normal=normal, rest_turn=turn, phi_by_rest=by))
    return tuple(found)


def with_edge(plane: EquiPlane, evidence: Evidence) -> EquiPlane:
    """Copy of an equi-plane that names the faces which meet at its pivot edge, and its radius's prior.

    An equi-plane is the plane through the pivot line and the centre of mass. Names of faces are those of the
    shape's resting faces, whatever the plan called them, so that a face has one place error both where the
    object rests on it and where it rises from the edge. If the object balanced over another line of the shape
    than the planned edge, the error of the place is that of this line. An edge that is rounded in the shape
    itself gets the prior alone; its names of faces stay as they are. The plane of a strike in which the
    contact rolled on a curved flank is returned unchanged, unless the meshing of a scan may have made it.

    Args:
        plane: equi-plane of one strike, in the object frame O.
        evidence: strikes with object file, shape and plan.
    """
    if not plane.rounded:
        return _with_blurred_curve(plane, evidence.model)
    model, up, forward = evidence.model, plane.base_up, np.cross(plane.direction, plane.base_up)
    lean = wall_lean(model, forward, up, [plane.point], plane.edge_radius)
    leaning = lean or 0.0
    inset = (1 + np.sin(leaning)) / np.cos(leaning)
    corner = plane.point - plane.edge_radius * (up - inset * forward)
    radius = edge_radius(evidence.spec, model, plane.axis_id, corner, plane.direction)
    if plane.facet_rad:
        plane = replace(plane, edge_sd=place_sd(_line_sd(evidence, corner), lean))
    if _is_rounded_in_shape(model, plane, corner):
        own = float(
            np.hypot(
                SHAPE_RADIUS_SD * plane.edge_radius, surface_sd(evidence.spec.shape, evidence.model.noise_sd)
            )
        )
        return replace(plane, radius_prior=RadiusPrior(plane.edge_radius, 0.0, own, RadiusSource.SHAPE))
    rest = _face_at(model, corner, -up)
    wall = _face_at(model, corner, np.cos(leaning) * forward + np.sin(leaning) * up)
    return replace(
        plane,
        face=rest or plane.face,
        wall=wall if rest and lean is not None else "",
        wall_lean=leaning,
        radius_prior=replace(radius, mean=plane.edge_radius),
    )


def _with_blurred_curve(plane: EquiPlane, model: ObjectModel) -> EquiPlane:
    """Equi-plane of a strike that rolled on a curve, which may be an edge that the meshing of a scan rounded.

    Up to `MAX_RADIUS` the object may have any radius from 0 to that of the curve. A smaller one has its
    centre line farther out, towards the sharp edge. Planes of other shapes and curves are not changed.

    Args:
        plane: equi-plane through the centre of curvature and the centre of mass.
        model: shape of the object.
    """
    meshed = model.cloud is not None and model.cloud.meshed
    if not meshed or not MAX_ASSUMED_RADIUS < plane.edge_radius < MAX_RADIUS:
        return plane
    prior, up = blurred_radius(plane.edge_radius), plane.base_up
    outwards = np.cross(plane.direction, up) - up
    return replace(
        plane,
        point=plane.point + (plane.edge_radius - prior.mean) * outwards,
        edge_radius=prior.mean,
        radius_sd=0.0,
        radius_prior=prior,
        rounded=True,
    )


def _line_sd(evidence: Evidence, point: Array) -> float:
    """1 sigma [m] of the position, normal to itself, of an edge in which two faces of the shape meet.

    The error of the faces is taken from the object file in use; the shape may have been loaded with another.

    Args:
        evidence: strikes with object file and shape.
        point: (3,) point [m] of the edge, in the object frame O.
    """
    model = evidence.model
    loaded, in_use = model.surface_sd, surface_sd(evidence.spec.shape, model.noise_sd)
    own = model.edge_sd(np.stack([point, point])) ** 2 - loaded**2
    return float(np.sqrt(own + in_use**2))


def _is_rounded_in_shape(model: ObjectModel, plane: EquiPlane, corner: Array) -> bool:
    """True if the shape itself is rounded at a pivot edge: a facet cuts off the sharp corner of its faces.

    Args:
        model: shape of the object.
        plane: equi-plane (plane through pivot line and centre of mass) of a strike over the edge.
        corner: (3,) point [m] in which the faces that meet at the edge would do so if it were sharp, in the
            object frame O.
    """
    normals, forward = model.hull_planes[:, :3], np.cross(plane.direction, plane.base_up)
    between = (np.abs(normals @ plane.direction) < MAX_SKEW) & (
        np.minimum(normals @ forward, -(normals @ plane.base_up)) > MIN_FACET_SLOPE
    )
    heights = (normals @ corner + model.hull_planes[:, 3])[between]
    return bool(np.any(heights > MIN_CUT_OFF * plane.edge_radius)) if plane.edge_radius > 0 else False


def _face_at(model: ObjectModel, corner: Array, outward: Array) -> str:
    """Id of the shape's resting face through a point that has the given normal; "" if there is none.

    Args:
        model: shape of the object.
        corner: (3,) point [m], in the object frame.
        outward: (3,) outward unit normal of the face, in the object frame.
    """
    within = SAME_FACE_FRACTION * float(model.extent.max())
    near = [
        (abs(float(corner @ face.up) - face.level), face.id)
        for face in resting_planes(model)
        if -(face.up @ outward) > SAME_FACE_COSINE
    ]
    distance, name = min(near, default=(within, ""))
    return name if distance < within else ""


def systematic_errors(evidence: Evidence) -> SystematicErrors:
    """Standard deviations of errors that strikes share: shape scale, place of faces, edge radius, tilt.

    They are taken from `evidence`. Those of scale (relative), faces [m] and edge radius [m] are the object
    file's; the plane of a strike over an edge with a radius of its own (`EquiPlane.radius_prior`) states that
    one's errors. Each levelling (set-up of the table) has one unknown tilt [rad] against gravity. Where the
    manifest (the recording's metadata) holds the reading of a level (the instrument), the tilt is that
    reading within its sd; otherwise 0 within the sd that the manifest states.
    """
    levels = levelling_indices(evidence.recordings)
    tilts = {level: each.manifest for level, each in zip(levels, evidence.recordings, strict=True)}
    return SystematicErrors(
        gravity_tilt_sd=tilts[0].gravity_tilt_sd_rad,
        scale_sd=evidence.spec.shape.scale_sd,
        edge_radius_sd=stated_radius(evidence.spec).common_sd,
        face_sd=surface_sd(evidence.spec.shape, evidence.model.noise_sd),
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
