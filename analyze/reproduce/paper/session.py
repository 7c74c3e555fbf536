"""Record of one session: both methods under both conditions, ground truth, and data of the figures."""

from __future__ import annotations

import time
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from analyze.estimation.paper import distance_from_pivot
from analyze.pipeline.estimate import Estimate, estimate_evidence
from analyze.progress import Progress, no_progress
from analyze.reproduce.paper.chain import (
    PaperAnswer,
    paper_answers,
    refuse_without_tips,
    sign_change_fit,
)
from analyze.reproduce.paper.miscalibrated import with_calibration_errors
from analyze.reproduce.paper.own_choice import com_from_papers_choice
from analyze.reproduce.paper.record import (
    Angle,
    AxisMoment,
    Condition,
    MethodAnswer,
    Profile,
    Section,
    SessionRecord,
    ThetaSource,
)
from analyze.reproduce.paper.scan_noise import LEVELS_M, errors_over_scan_noise
from analyze.reproduce.paper.sensitivity import (
    ANGLE_LEVELS_DEG,
    MOMENT_LEVELS,
    PAPER_NOISE_DEG,
    com_over_angles,
    masses_over_moments,
    true_order,
)
from analyze.result.document import result_document
from analyze.result.score import tip_truth
from analyze.types import Array, EquiPlane
from schemas.strike_result import Verdict

if TYPE_CHECKING:
    from analyze.pipeline.evidence import Evidence
    from schemas.proto import percuss_pb2 as pb

SWEPT_OBJECT = "carton"
"""Object whose sensitivities are computed; the paper computed them for its carton box."""
SLICE_HALF_CELLS = 1.0
"""Half-thickness of Fig. 12's slice, in cells."""
PROGRESS_STEPS = 6
"""Number of steps reported to the progress bar."""
LANDING_FRAMES = 20
"""Frames of the landing that Fig. 6 shows."""
SMOOTHING_FRAMES = 5
"""Frames averaged for Fig. 6's derivatives."""


@dataclass(frozen=True)
class Sweeps:
    """Levels of noise that is added to angles, moments and scan for further analyses; () omits a sweep.

    Levels are the noise's sd of angles [deg] and of moments (relative), and the largest shift [m] of a
    scanned point. The sweeps give the paper's Figs. 9(b), 9(c) and 10. By default there is only the paper's
    angle noise.
    """

    angles_deg: tuple[float, ...] = (PAPER_NOISE_DEG,)
    """Standard deviations of the angles' noise [deg]."""
    moments: tuple[float, ...] = ()
    """Standard deviations of the moments' noise, relative."""
    scan_m: tuple[float, ...] = ()
    """Largest shifts of a scanned point [m]."""


def default_sweeps(name: str) -> Sweeps:
    """Default levels (sizes) of added noise at which an object's session is analysed again.

    For the carton they are all levels of balance angles, moments and scan, as in the paper (VISAPP 2013);
    for other objects only the angle noise that the paper states. Levels are standard deviations of the angles
    [deg] and of the moments (relative), and the largest shift of a scanned point [m].

    Args:
        name: name of the object.
    """
    return Sweeps(ANGLE_LEVELS_DEG, MOMENT_LEVELS, LEVELS_M) if name == SWEPT_OBJECT else Sweeps()


def session_record(
    evidence: Evidence,
    body: pb.TruthBody,
    source: ThetaSource,
    sweeps: Sweeps | None = None,
    progress: Progress = no_progress,
) -> SessionRecord:
    """Analyse a session by both methods (ours, the paper's) under both conditions of calibration.

    The conditions are the calibration as recorded, and one with random errors applied.

    Args:
        evidence: strikes of the session.
        body: ground truth, which no estimate uses.
        source: origin of theta(t), the tipping angles.
        sweeps: noise levels; None for those of `default_sweeps` for the object.
        progress: called with (text, done, total).

    Returns:
        Ground truth, estimates, and data of the figures.

    Raises:
        EstimationError: too few strikes can be used, or none has verdict "good".
    """
    name = evidence.spec.name
    rng = np.random.default_rng((body.seed, zlib.crc32(name.encode())))
    progress("estimating", 0, PROGRESS_STEPS)
    began = time.process_time()
    exact = estimate_evidence(evidence)
    cpu_s = time.process_time() - began
    refuse_without_tips(exact, name)
    progress("with calibration errors drawn", 1, PROGRESS_STEPS)
    drawn = estimate_evidence(with_calibration_errors(evidence, rng))
    estimates = {Condition.EXACT: exact, Condition.DRAWN: drawn}
    progress("by the paper's method", 2, PROGRESS_STEPS)
    paper = {
        condition: [_paper_answer(each, estimate, body) for each in paper_answers(estimate)]
        for condition, estimate in estimates.items()
    }
    progress("over noise of the angles", 3, PROGRESS_STEPS)
    sweeps = sweeps or default_sweeps(name)
    angle_noise = com_over_angles(exact, body, sweeps.angles_deg, rng)
    moment_noise = masses_over_moments(exact, body, sweeps.moments, rng)
    progress("over noise of the scan", 4, PROGRESS_STEPS)
    scan_com, scan_masses = errors_over_scan_noise(evidence, body, sweeps.scan_m, rng)
    progress("drawing", 5, PROGRESS_STEPS)
    model = evidence.model
    return SessionRecord(
        object=name,
        seed=body.seed,
        source=source,
        method=evidence.plan.method,
        strikes=len(exact.planes),
        axes=len({plane.axis_id for plane in exact.planes}),
        singular=not exact.com.observed,
        mass_kg=body.mass_kg,
        volume_m3=model.volume,
        centroid_m=model.centroid.tolist(),
        true_com_m=list(body.com_object),
        true_masses_kg=list(body.region_mass_kg),
        cpu_s=cpu_s,
        angles=_angles(exact, body),
        ours={condition: _own_answer(estimate, body) for condition, estimate in estimates.items()},
        paper=paper,
        naive_kg={
            key: masses[true_order(exact.distribution.dividing_plane_normal, body)].tolist()
            for key, masses in exact.distribution.baselines.items()
        },
        angle_noise=angle_noise,
        moment_noise=moment_noise,
        scan_noise_com=scan_com,
        scan_noise_masses=scan_masses,
        own_choice=com_from_papers_choice(exact, body),
        profile=_profile(exact, body) if name == SWEPT_OBJECT else None,
        section=_section(exact, body),
    )


def _own_answer(estimate: Estimate, body: pb.TruthBody) -> MethodAnswer:
    """Centre of mass, region masses and errors of the moments of inertia, by our method.

    The errors are relative to the ground truth. The regions are in the ground truth's order: shell (outer
    wall), upper and lower part of the interior.
    """
    regions, planes = result_document(estimate).regions, _first_planes(estimate)
    assert regions is not None  # noqa: S101 - every estimate has regions
    order = true_order(estimate.distribution.dividing_plane_normal, body)
    masses = [regions.regions[i].mass for i in order]
    low, high = np.array([mass.interval95 for mass in masses], dtype=np.float64).T.tolist()
    return MethodAnswer(
        com_m=estimate.com.position.tolist(),
        com_covariance_m2=estimate.com.covariance.tolist(),
        masses_kg=np.array([mass.value for mass in masses], dtype=np.float64).tolist(),
        masses_sd_kg=np.array([mass.sd for mass in masses], dtype=np.float64).tolist(),
        masses_low_kg=low,
        masses_high_kg=high,
        moments=[
            _axis_moment(planes[axis.axis_id], body, axis.i_edge, axis.i_com, axis.i_edge_sd, axis.i_com_sd)
            for axis in estimate.inertial.axes
        ],
    )


def _first_planes(estimate: Estimate) -> dict[str, EquiPlane]:
    """Equi-plane (through pivot line and centre of mass) of each axis's first strike, by id of the axis."""
    return {plane.axis_id: plane for plane in reversed(estimate.planes)}


def _axis_moment(
    plane: EquiPlane,
    body: pb.TruthBody,
    i_edge: float,
    i_com: float,
    i_edge_sd: float = 0.0,
    i_com_sd: float = 0.0,
    corrected: float | None = None,
    left_out: float | None = None,
) -> AxisMoment:
    """Errors of one axis's estimated moments of inertia and their sd, over the true moments.

    An error is estimate / truth - 1. The true moment about the edge [kg m^2] and the true distance [m] of the
    centre of mass from the pivot line are added.

    Args:
        plane: equi-plane (through pivot line and centre of mass) of a strike on the axis, for its edge.
        body: ground truth.
        i_edge: estimated moment about the edge [kg m^2].
        i_com: estimated moment about the parallel axis through the centre of mass [kg m^2].
        i_edge_sd: standard deviation of `i_edge` [kg m^2]; 0 for the paper's method, which states none.
        i_com_sd: standard deviation of `i_com` [kg m^2]; 0 for the paper's method.
        corrected: the paper's corrected moment about the edge [kg m^2]; None if there is none.
        left_out: fraction of the frames of stage two (free motion beyond the balance) that the paper's eq.
            (5) leaves out; None for our method.
    """
    R = distance_from_pivot(plane, np.array(body.com_object))
    about_com = float(plane.direction @ np.array(body.inertia_com).reshape(3, 3) @ plane.direction)
    about_edge = about_com + body.mass_kg * (R + plane.edge_radius) ** 2
    return AxisMoment(
        axis_id=plane.axis_id,
        distance_m=R,
        i_edge_off=i_edge / about_edge - 1,
        i_edge_sd=i_edge_sd / about_edge,
        i_com_off=i_com / about_com - 1,
        i_com_sd=i_com_sd / about_com,
        i_edge_kg_m2=about_edge,
        corrected_off=None if corrected is None else corrected / about_edge - 1,
        left_out=left_out,
    )


def _paper_answer(answer: PaperAnswer, estimate: Estimate, body: pb.TruthBody) -> MethodAnswer:
    """Centre of mass, region masses and errors of moments by the paper's method, for the session's record.

    The answer comes from one round of strikes, one on each axis. The centre of mass [m] is in the object
    frame O. The region masses [kg] are those of shell, upper and lower part, with the ground truth's upper
    part called upper; None if the method found none. Moments of inertia of axes whose strikes our estimate
    does not use are left out.
    """
    planes, regions = _first_planes(estimate), answer.regions
    corrected = {} if regions is None else regions.corrected_i_edge
    moments = [
        _axis_moment(
            planes[axis_id],
            body,
            found,
            found - body.mass_kg * distance_from_pivot(planes[axis_id], answer.com) ** 2,
            corrected=corrected.get(axis_id),
            left_out=answer.left_out[axis_id],
        )
        for axis_id, found in answer.i_edge.items()
        if axis_id in planes
    ]
    return MethodAnswer(
        com_m=answer.com.tolist(),
        masses_kg=None
        if regions is None
        else regions.masses[true_order(regions.dividing_plane_normal, body)].tolist(),
        moments=moments,
    )


def _angles(estimate: Estimate, body: pb.TruthBody) -> list[Angle]:
    """Balance angle [rad] of each strike used: ground truth, our estimate with its sd, and the paper's.

    The paper's is None for a strike whose verdict is not "good" (the object rocked back, slid, twisted or
    rolled). The rms residual of the tipping angle in the frames [rad] is given too.
    """
    evidence = estimate.evidence
    by_id = {motion.strike_id: motion for motion in evidence.motions}
    found: list[Angle] = []
    for plane in estimate.planes:
        motion = by_id[plane.strike_id]
        assert motion.fit is not None  # noqa: S101 - it was used
        paper = sign_change_fit(motion)
        found.append(
            Angle(
                axis_id=plane.axis_id,
                strike_id=plane.strike_id,
                true_rad=tip_truth(evidence.planned(motion), body).phi,
                ours_rad=plane.phi,
                ours_sd_rad=plane.sd_phi,
                paper_rad=None if paper is None else paper.phi,
                frame_residual_rad=float(np.sqrt(np.mean(motion.fit.residual**2))),
            )
        )
    return found


def _profile(estimate: Estimate, body: pb.TruthBody) -> Profile | None:
    """Motion of the first strike with verdict "good" (a clean tip), for Fig. 6 of the paper.

    It holds, per frame, time [s], tipping angle [rad], its first and second derivative (smoothed) [rad/s,
    rad/s^2]; the frame ranges of the phases; and the balance angle [rad] as fitted and as true. It ends
    `LANDING_FRAMES` frames after the last phase before the landing.

    None if there is no such strike, or if it has no tipping angle, phases or fit.
    """
    motion = next((each for each in estimate.evidence.motions if each.verdict is Verdict.GOOD), None)
    if motion is None or motion.angle is None or motion.phases is None or motion.fit is None:
        return None
    angle, phases = motion.angle, motion.phases
    seconds: Array = (angle.time_ns - motion.fit.time0_ns).astype(np.float64) * 1e-9
    smooth = np.convolve(
        np.pad(angle.theta, SMOOTHING_FRAMES // 2, mode="edge"),
        np.ones(SMOOTHING_FRAMES) / SMOOTHING_FRAMES,
        mode="valid",
    )
    rate = np.gradient(smooth, seconds)
    spans = phases.spans()
    last = max(stop for name, (_, stop) in spans.items() if name != "landing")
    shown = slice(0, min(len(seconds), last + LANDING_FRAMES))
    return Profile(
        time_s=seconds[shown].tolist(),
        theta_rad=angle.theta[shown].tolist(),
        rate_rad_s=rate[shown].tolist(),
        acceleration_rad_s2=np.gradient(rate, seconds)[shown].tolist(),
        phases=spans,
        phi_rad=motion.fit.phi,
        phi_true_rad=tip_truth(estimate.evidence.planned(motion), body).phi,
    )


def _section(estimate: Estimate, body: pb.TruthBody) -> Section:
    """Convex outline seen along O's y axis, and estimated and true regions in a slice normal to this axis.

    O is the object frame. The slice passes through the estimated centre of mass. The outline is given by its
    corners (x, z) [m], the slice by the middles (x, z) [m] of its cells with the region of each (shell, upper
    or lower part).
    """
    cells, distribution = estimate.cells, estimate.distribution
    outline = estimate.evidence.model.vertices[:, [0, 2]]
    near = np.abs(cells.points[:, 1] - estimate.com.position[1]) < SLICE_HALF_CELLS * cells.pitch
    points = cells.points[near]
    in_shell = cells.shell[near] > 0
    true_normal, true_offset = np.array(body.region_plane[:3]), body.region_plane[3]
    sign = 1.0 if distribution.dividing_plane_normal @ true_normal >= 0 else -1.0
    ours = _region(
        in_shell,
        sign * (points @ distribution.dividing_plane_normal - distribution.dividing_plane_offset) > 0,
    )
    return Section(
        outline_m=_pairs(outline[ConvexHull(outline).vertices]),
        points_m=_pairs(points[:, [0, 2]]),
        ours=ours,
        true=_region(in_shell, points @ true_normal > true_offset),
    )


def _region(in_shell: NDArray[np.bool_], above: NDArray[np.bool_]) -> list[int]:
    """Region of each of n cells: 0 where `in_shell` (n,), else 1 where `above` the dividing plane, else 2."""
    return [int(value) for value in np.where(in_shell, 0, np.where(above, 1, 2))]


def _pairs(points: Array) -> list[tuple[float, float]]:
    """Points (n, 2) [m], in x and z of the object frame O, as a list of pairs rounded to 10 µm."""
    return [(round(float(x), 5), round(float(z), 5)) for x, z in points]
