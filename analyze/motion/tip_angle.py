"""Tipping angle theta per frame from markers' corners; one file, as its two fits share arrays.

The body moves in the plane across the pivot axis, so a frame has three unknowns: theta, and the pivot's
displacement along and off the table. Fitting only these, by Gauss-Newton on the reprojection of the corners,
uses the direction of a face-on tag in the image, which is accurate, and not its tilt, which is not: the noise
is 0.006 deg per frame for an 80 px tag, where a full pose gives some tenths of a degree. A second fit with
all six unknowns of a frame serves a body that wobbles.
"""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import fminbound
from scipy.spatial.transform import Rotation

from analyze.errors import EstimationError, TrackingError
from analyze.motion.rest_pose import MODEL_PX, RestPose, rest_pose, rest_turn
from analyze.tracking.camera_model import project_ideal, project_jacobian, undistort, world_to_camera
from analyze.tracking.pose import marker_corners
from analyze.types import TipAngle

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from analyze.types import Array, CameraModel, IntArray, Marker, MarkerTrack, RestTurn

_MAX_PLANAR_CHI2 = 3.0
"""chi^2 per degree of freedom above which the motion is not taken as planar"""
_PRIOR_FRAMES = 5
"""weight of the corners' own sd in the estimate of the noise, as a number of resting frames"""
_YAW_SD = 0.02
"""prior standard deviation of the object's heading against the plan [rad]"""
_YAW_TRIALS, _YAW_FRAMES = 13, 30
"""headings that are tried before the search about the best of them, and frames on which they are"""
_YAW_STEP = 1e-4
"""error of the heading at which its search ends [rad]"""
_WOBBLE_SD = np.array([np.inf, np.inf, np.inf, 0.15, 0.15, 0.005])
"""prior standard deviation of theta, x, z (all free), yaw, roll and y [rad, m]; a face-on tag hardly shows
the last three"""
_MAX_TURN, _MAX_PATH = 2 * math.pi, 2.0
"""largest tipping angle [rad] and path of the pivot [m] of an object on a table"""
_MAX_WILD_SHARE = 0.1
"""largest share of frames that may be left out because no tip explains them"""
_SLOW_SHARE = 0.7
"""share of theta's systematic error that changes as the object tips: half of its variance

The rest is constant, an error of theta's zero.
"""


@dataclass(frozen=True)
class Placement:
    """Planned pose of the object for a strike, and its pivot: a point on the edge's centre line, in O [m].

    A point x_object in the object frame O is at X_world = R_world_object x_object + p_world_object in the
    world frame W.
    """

    R_world_object: Array
    """(3, 3) rotation from O to W"""
    p_world_object: Array
    """(3,) O's origin in W [m]"""
    p_object_pivot: Array
    """(3,) point on the centre line of the edge's rounding, in O [m]"""
    radius: float
    """radius of that rounding [m]"""


@dataclass(frozen=True)
class PlanarMotion:
    """Measured motion of a strike in n frames: tip about the pivot axis, and deviations from a pure tip.

    The deviations are slip (along the table) and lift (off it) of the pivot [m], rotation about other axes
    [rad], and the axis's heading [rad] about the vertical, against y of the world frame.
    """

    angle: TipAngle
    """tipping angle theta since rest, slip (sliding of the edge along the table) and rotation about other
    axes"""
    lift: Array
    """(n,) height of the pivot over its position at rest [m]"""
    position_sd: Array
    """(n,) standard deviation of slip and lift [m]"""
    off_axis_sd: Array
    """(n,) standard deviation of the rotation about other axes [rad]"""
    yaw: float
    """heading of the true pivot axis against W's y, about W's z [rad]"""
    covariance: Array
    """(n, 3, 3) covariance of theta, slip and lift in each frame [rad, m], random part only"""
    place_sd: float | None = None
    """standard deviation [m] of the pivot's place by those of the markers on the object; None if no marker's
    place is known"""
    rest_turns: tuple[RestTurn, ...] = ()
    """turns of the object at rest against its planned pose, one by each marker whose place on it is known"""
    roll: Array | None = None
    """(n,) part of the rotation about other axes that is about the horizontal one across the pivot axis
    [rad]; None if unknown"""
    roll_sd: Array | None = None
    """(n,) standard deviation of `roll` [rad]"""
    slow_place_sd: float = 0.0
    """standard deviation of slow errors of slip and lift [m], below which a motion of the edge is not seen"""


@dataclass(frozen=True)
class _Views:
    """Corners of m markers in the n frames of a strike [ideal px], and their places at rest in W [m].

    Ideal pixels are free of lens distortion; W is the world frame.
    """

    time_ns: IntArray
    """(n,) log_time of the frames [ns]"""
    ideal: Array
    """(n, m, 4, 2) corners [ideal px]"""
    sd: Array
    """(n, m) standard deviation of a corner [px]; infinite if the marker was not found"""
    corners_world: Array
    """(m, 4, 3) corners at rest in W [m]"""
    theta: Array
    """(n,) first guess of theta [rad]"""
    at_rest: tuple[tuple[Marker, RestPose], ...]
    """the m markers with their poses at rest"""


def tip_angle(
    tracks: Sequence[MarkerTrack],
    markers: Sequence[Marker],
    camera: CameraModel,
    placement: Placement,
    rest_end_ns: int,
) -> PlanarMotion:
    """Tipping angle since rest, and motion of the pivot, in every frame of a strike.

    The pivot axis is W's y (W: world frame, z up); its small yaw is fitted. If the motion is clearly not
    planar, the full motion of every frame is fitted instead.

    Args:
        tracks: tracks of the object's markers through one strike window.
        markers: the object's markers.
        camera: camera with its pose in W.
        placement: nominal placement; its position is used only if no marker's place on the object is known.
        rest_end_ns: time on the recording's clock (log_time) [ns]; frames before it are at rest.

    Returns:
        Tipping angle [rad], slip (sliding of the edge along the table, without its rolling) and lift (height
        of the pivot over its position at rest) [m] of every frame, with their errors; also the rotation about
        other axes, and the yaw [rad].

    Raises:
        TrackingError: there is no track, or no marker is seen at rest in three frames before the strike.
        EstimationError: the markers do not move like an object that tips over the planned edge.
    """
    if not tracks:
        raise TrackingError(
            "no marker was followed in this window: check light, focus and the plan's visible_markers"
        )
    by_id = {marker.id: marker for marker in markers}
    views, pivot = _collect(tracks, by_id, camera, placement, rest_end_ns)
    yaw = _fitted_yaw(views, pivot, camera)
    best = _solve(views, pivot, yaw, camera)
    views, best = _without_wild_frames(views, best)
    at_rest = views.time_ns < rest_end_ns
    full = _solve_full(views, pivot, yaw, camera, best.x)
    chi2 = best.chi2 / np.maximum(best.freedom, 1)
    off_axis_sd = np.sqrt(full.covariance[:, 3, 3] + full.covariance[:, 4, 4]) * _scale(full)
    turned_aside = full.x[:, 3:5] - full.x[at_rest, 3:5].mean(axis=0)
    # A wobbling body does not move in a plane: a planar fit would shift theta by part of the wobble.
    chosen = (
        full
        if np.median(chi2) > _MAX_PLANAR_CHI2 and np.median(full.chi2 / full.freedom) < 0.5 * np.median(chi2)
        else best
    )
    relative = chosen.chi2 / np.maximum(chosen.freedom, 1)
    bad = np.sqrt(np.maximum(1.0, relative / max(1.0, 9.0 * float(np.median(relative)))))
    single = np.sqrt(chosen.covariance[:, 0, 0])
    random = single * _random_scale(chosen.x[at_rest, 0], single[at_rest])
    motion = chosen.x - np.mean(chosen.x[at_rest], axis=0)
    systematic = _systematic_sd(
        random[at_rest], single[at_rest], _scale(chosen), views.sd[at_rest].min(axis=1)
    )
    angle = TipAngle(
        time_ns=views.time_ns,
        theta=motion[:, 0],
        sd=random * bad,
        off_axis=np.hypot(turned_aside[:, 0], turned_aside[:, 1]),
        slip=motion[:, 1] - placement.radius * motion[:, 0],
        zero_sd=math.hypot(systematic, float(np.median(random[at_rest])) / math.sqrt(np.sum(at_rest))),
        slow_sd=_SLOW_SHARE * systematic,
        strain_sd=camera.strain_sd,
    )
    position_sd = (
        np.sqrt(0.5 * (chosen.covariance[:, 1, 1] + chosen.covariance[:, 2, 2])) * _scale(chosen) * bad
    )
    # Slip is x less the rolling by theta.
    to_slip = np.array([[1.0, 0.0, 0.0], [-placement.radius, 1.0, 0.0], [0.0, 0.0, 1.0]])
    covariance = (
        to_slip @ chosen.covariance[:, :3, :3] @ to_slip.T * (random / single * bad)[:, None, None] ** 2
    )
    place_sd, R_planned = _place_sd(tracks, by_id, placement), placement.R_world_object
    turns = [rest_turn(pose, marker, camera, R_planned, systematic) for marker, pose in views.at_rest]
    seen = tuple(turn for turn in turns if turn is not None)
    roll_sd = np.sqrt(full.covariance[:, 4, 4]) * _scale(full)
    return PlanarMotion(
        angle,
        motion[:, 2],
        position_sd,
        off_axis_sd,
        yaw,
        covariance,
        place_sd,
        seen,
        turned_aside[:, 1],
        roll_sd,
    )


def _place_sd(
    tracks: Sequence[MarkerTrack], by_id: dict[int | str, Marker], placement: Placement
) -> float | None:
    """Standard deviation [m] of the pivot's place across its axis, as the markers on the object show it.

    None if no tracked marker's place on the object is known. A marker turned on the object moves the pivot by
    that angle times its distance. The errors of several markers count as one: they come from one scan.

    Args:
        tracks: tracks of the object's markers.
        by_id: the object's markers by id.
        placement: planned placement, with the pivot point.
    """
    known = [by_id[track.marker_id] for track in tracks if track.marker_id in by_id]
    sds = [
        math.hypot(
            marker.place_sd,
            marker.turn_sd * float(np.linalg.norm(placement.p_object_pivot - marker.T_object_marker[:3, 3])),
        )
        for marker in known
        if marker.T_object_marker is not None
    ]
    return float(np.mean(sds)) if sds else None


def _without_wild_frames(views: _Views, solution: _Solution) -> tuple[_Views, _Solution]:
    """Views and planar motion without frames that no tip on a table explains, such as misread ones.

    Their angle or displacement is not finite, or larger than a tip can be.

    Args:
        views: corners of all markers in all frames.
        solution: planar motion of all frames.

    Raises:
        EstimationError: more than a tenth of the frames are such.
    """
    x = solution.x
    sound = np.all(np.isfinite(x), axis=1) & (np.abs(x[:, 0]) < _MAX_TURN)
    sound &= np.all(np.abs(x[:, 1:]) < _MAX_PATH, axis=1)
    if np.mean(sound) < 1.0 - _MAX_WILD_SHARE:
        raise EstimationError(
            "the markers do not move as on an object that tips over the planned edge: check that this is the"
            " planned strike, the markers' places in the object file, and the camera's calibration"
        )
    if np.all(sound):
        return views, solution
    return (
        replace(
            views,
            time_ns=views.time_ns[sound],
            ideal=views.ideal[sound],
            sd=views.sd[sound],
            theta=views.theta[sound],
        ),
        _Solution(x[sound], solution.covariance[sound], solution.chi2[sound], solution.freedom[sound]),
    )


def _random_scale(theta: Array, sd: Array) -> float:
    """Ratio of the scatter of theta between neighbouring resting frames to its stated standard deviation.

    It is shrunk towards 1 if frames are few; 1 for fewer than five. Residuals within a frame do not measure
    it: their systematic part (from a lens, a printed marker or its place not quite as modelled) is the
    same in all frames, so that it moves theta's zero but does not add scatter.

    Args:
        theta: (n,) tipping angle of the resting frames [rad].
        sd: (n,) its stated standard deviation [rad].
    """
    if len(theta) < 2:
        return 1.0
    # Second differences are insensitive to slow drift, for example while the object still settles.
    z2 = (np.diff(theta, 2) / sd[1:-1]) ** 2 / 6.0 if len(theta) > 4 else np.zeros(0)
    known = _PRIOR_FRAMES + len(z2)
    return math.sqrt(float(_PRIOR_FRAMES + np.sum(np.minimum(z2, 25.0))) / known)


def _systematic_sd(random: Array, single: Array, misfit: float, corner_sd: Array) -> float:
    """Standard deviation [rad] of the tipping angle's error that all frames of an object at rest share.

    It joins the misfit of model and image within a frame, and MODEL_PX (0.01 px) for each corner, which need
    not show as a misfit: on 7 simulated cameras, whose lens blurs whole pixels and so shifts edges along the
    pixel grid by up to 0.03 px, the zero of the angle was off by 0.0075 deg rms.

    Args:
        random: (n,) noise of each resting frame [rad].
        single: (n,) standard deviation of each resting frame from its corners' own sd [rad].
        misfit: factor on `single` that the residuals within frames require.
        corner_sd: (n,) standard deviation of a corner [px].
    """
    scatter = float(np.median(random))
    modelled = float(np.median(single)) * misfit
    by_px = float(np.median(single / corner_sd))
    return math.sqrt(max(modelled**2 - scatter**2, 0.0) + (by_px * MODEL_PX) ** 2)


def _scale(solution: _Solution) -> float:
    """Factor on the corners' stated sd that explains the residuals of a fitted motion, at least 1.

    It is the root of the median frame's chi^2 per degree of freedom.
    """
    return float(np.sqrt(max(1.0, np.median(solution.chi2 / np.maximum(solution.freedom, 1)))))


def _collect(
    tracks: Sequence[MarkerTrack],
    by_id: dict[int | str, Marker],
    camera: CameraModel,
    placement: Placement,
    rest_end_ns: int,
) -> tuple[_Views, Array]:
    """Corners in every frame of the markers seen at rest, and the pivot point (3,) in W [m].

    W is the world frame, z up. The corners (frames, markers, 4, 2) [px] are free of lens distortion, and come
    with their sd, their positions at rest in W [m], and a first guess of the tipping angle [rad]. The pivot
    point is the mean of those that the markers' places give, or the planned one if no marker's place on the
    object is known.

    Args:
        tracks: tracks of the object's markers.
        by_id: the object's markers by id.
        camera: camera with its pose in W.
        placement: planned pose of the object and pivot.
        rest_end_ns: time on the recording's clock (log_time) [ns]; frames before it are at rest.

    Raises:
        TrackingError: no marker is at rest in view, in three frames, before the strike.
        EstimationError: a marker at rest fits no pose near the planned one.
    """
    rested = [
        track
        for track in tracks
        if np.count_nonzero(track.time_ns < rest_end_ns) >= 3 and track.marker_id in by_id
    ]
    if not rested:
        raise TrackingError(
            "no marker lies still in view before the strike:"
            " start earlier, put the camera on a stand, and check the light"
        )
    time_ns = np.unique(np.concatenate([track.time_ns for track in rested]))
    n, m = len(time_ns), len(rested)
    ideal = np.zeros((n, m, 4, 2))
    sd = np.full((n, m), np.inf)
    corners_world = np.zeros((m, 4, 3))
    theta = np.full((n, m), np.nan)
    pivots: list[Array] = []
    poses: list[tuple[Marker, RestPose]] = []
    R_world_camera, p_world_camera = camera.T_world_camera[:3, :3], camera.T_world_camera[:3, 3]
    for j, track in enumerate(rested):
        marker = by_id[track.marker_id]
        index = np.searchsorted(time_ns, track.time_ns)
        corners = undistort(camera, track.corners_px)
        ideal[index, j] = corners
        sd[index, j] = track.corner_sd_px
        still = track.time_ns < rest_end_ns
        pose = rest_pose(corners[still], track, still, marker, camera, placement.R_world_object)
        poses.append((marker, pose))
        R_world_marker = R_world_camera @ pose.R
        p_world_marker = R_world_camera @ pose.p + p_world_camera
        corners_world[j] = marker_corners(marker.size) @ R_world_marker.T + p_world_marker
        if not (np.all(np.isfinite(pose.R)) and np.all(np.isfinite(pose.p))):
            raise EstimationError(
                f"marker {track.marker_id} at rest fits no pose near the planned one: check that this is the"
                " planned strike, and the marker's place in the object file"
            )
        turned = Rotation.from_matrix(R_world_camera @ track.R_camera_marker @ R_world_marker.T).as_rotvec()
        theta[index, j] = turned[:, 1]
        if marker.T_object_marker is not None:
            lever = marker.T_object_marker[:3, :3].T @ (
                placement.p_object_pivot - marker.T_object_marker[:3, 3]
            )
            pivots.append(R_world_marker @ lever + p_world_marker)
    nominal = placement.R_world_object @ placement.p_object_pivot + placement.p_world_object
    pivot = np.mean(pivots, axis=0) if pivots else nominal
    return _Views(time_ns, ideal, sd, corners_world, np.nanmean(theta, axis=1), tuple(poses)), pivot


@dataclass(frozen=True)
class _Solution:
    """Motion of the object since rest, fitted in n frames, with covariance and misfit of each frame.

    A frame has p = 3 unknowns (planar: tipping angle, shift of the pivot across its axis and up) or 6 (also
    two rotations, and the shift along the axis), in rad and m.
    """

    x: Array
    """(n, p) theta and the pivot's displacement x (across the axis) and z (up); for p = 6 also the rotations
    yaw (about the vertical) and roll (about x), and the displacement y along the axis [rad, m]"""
    covariance: Array
    """(n, p, p) covariance of a frame's x"""
    chi2: Array
    """(n,) sum of squared weighted residuals"""
    freedom: NDArray[np.int64]
    """(n,) degrees of freedom"""


def _fitted_yaw(views: _Views, pivot: Array, camera: CameraModel) -> float:
    """Heading [rad] of the pivot axis, within three sd of its prior, with which a tip fits the corners best.

    Args:
        views: corners of all markers in all frames.
        pivot: (3,) pivot point at rest in W [m].
        camera: camera with its pose in W.
    """

    def cost(yaw: float, seen: _Views = views) -> float:
        """Cost of a trial heading [rad]."""
        return _cost(_solve(seen, pivot, yaw, camera), yaw)

    # As wild frames count less, the cost is no parabola, and may have other minima far from the least.
    some = slice(None, None, max(1, len(views.time_ns) // _YAW_FRAMES))
    few = replace(
        views,
        time_ns=views.time_ns[some],
        ideal=views.ideal[some],
        sd=views.sd[some],
        theta=views.theta[some],
    )
    trials = np.linspace(-3.0, 3.0, _YAW_TRIALS) * _YAW_SD
    best = int(np.argmin([cost(float(yaw), few) for yaw in trials]))
    low, high = trials[max(best - 1, 0)], trials[min(best + 1, len(trials) - 1)]
    found = fminbound(cost, low, high, xtol=_YAW_STEP)
    return float(np.asarray(found, dtype=np.float64))


def _cost(solution: _Solution, yaw: float) -> float:
    """Cost of a trial heading `yaw` [rad] of the pivot axis: sum of the frames' chi^2, plus (yaw / sd)^2.

    `solution` is the motion fitted to every frame with this heading; sd is that of the heading's prior. The
    chi^2 of a frame, the sum of its squared residuals in sd, counts up to 9 times the median one, so that
    wrong readings do not decide.
    """
    limit = 9.0 * float(np.median(solution.chi2)) + 1e-12
    return float(np.sum(np.minimum(solution.chi2, limit))) + (yaw / _YAW_SD) ** 2


def _rotated(points: Array, axis: Array, theta: Array) -> Array:
    """Points (n, ..., 3): each of `points` (..., 3) rotated about `axis` (3,) by each theta (n,) [rad].

    The axis is a unit vector through the origin.
    """
    shape = (len(theta), *([1] * (points.ndim)))
    cos, sin = np.cos(theta).reshape(shape), np.sin(theta).reshape(shape)
    return points * cos + np.cross(axis, points) * sin + (points @ axis)[..., None] * axis * (1.0 - cos)


def _solve(views: _Views, pivot: Array, yaw: float, camera: CameraModel) -> _Solution:
    """Planar motion fitted to every frame: theta, and the pivot's displacement along and off the table.

    theta is the tipping angle [rad]; the displacements are horizontal across the pivot axis and up [m].

    Args:
        views: corners of all markers in all frames.
        pivot: (3,) pivot point at rest in the world frame W [m].
        yaw: heading of the pivot axis against W's y, about W's z [rad].
        camera: camera that took the frames.

    Returns:
        Per frame theta and the displacements across and up, (n, 3) [rad, m, m], their covariance (n, 3, 3),
        and chi^2 with its degrees of freedom (n,).
    """
    R_camera_world, t_camera_world = world_to_camera(camera)
    axis = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    arms = views.corners_world - pivot
    n = len(views.time_ns)
    x = np.zeros((n, 3))
    x[:, 0] = views.theta
    weight = np.repeat(1.0 / views.sd, 8, axis=1)
    normal = np.zeros((n, 3, 3))
    residual = np.zeros((n, weight.shape[1]))
    for _ in range(8):
        turned = _rotated(arms, axis, x[:, 0])
        points = turned + pivot + (x[:, 1, None] * along + x[:, 2, None] * up)[:, None, None, :]
        in_camera = points @ R_camera_world.T + t_camera_world
        residual = (views.ideal - project_ideal(camera, in_camera)).reshape(n, -1) * weight
        by_point = project_jacobian(camera, in_camera) @ R_camera_world
        by_theta = (by_point @ np.cross(axis, turned)[..., None])[..., 0]
        J = (
            np.stack([by_theta, by_point @ along, by_point @ up], axis=-1).reshape(n, -1, 3)
            * weight[..., None]
        )
        normal = J.transpose(0, 2, 1) @ J
        step = np.linalg.solve(normal, (J.transpose(0, 2, 1) @ residual[..., None]))[..., 0]
        x += step
        if float(np.max(np.abs(step))) < 1e-7:
            break
    freedom = np.count_nonzero(weight > 0, axis=1) - 3
    return _Solution(
        x, np.asarray(np.linalg.inv(normal), dtype=np.float64), np.sum(residual**2, axis=1), freedom
    )


def _solve_full(views: _Views, pivot: Array, yaw: float, camera: CameraModel, planar: Array) -> _Solution:
    """Full motion (six unknowns) fitted to every frame, starting from the planar fit.

    The unknowns are those of the planar fit (tipping angle theta; displacement of the pivot across its axis,
    x, and up, z) and three more, each with a prior: rotations about the vertical and about x, and the
    displacement along the axis.

    Args:
        views: corners of all markers in all frames.
        pivot: (3,) pivot point at rest in the world frame W [m].
        yaw: heading of the pivot axis against W's y, about W's z [rad].
        camera: camera that took the frames.
        planar: (n, 3) theta [rad], x, z [m] of the planar fit.

    Returns:
        In every frame: the unknowns (n, 6) [rad, m], in the order theta, x, z, rotation about the vertical,
        rotation about x, displacement along the axis; their covariance (n, 6, 6); and the chi^2 of the
        corners with its degrees of freedom, (n,) each.
    """
    R_camera_world, t_camera_world = world_to_camera(camera)
    axis = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    n = len(planar)
    weight = np.repeat(1.0 / views.sd, 8, axis=1)
    prior = np.where(np.isfinite(_WOBBLE_SD), 1.0 / _WOBBLE_SD**2, 0.0)
    x = np.concatenate([planar, np.zeros((n, 3))], axis=1)
    covariance = np.zeros((n, 6, 6))
    residual = np.zeros((n, weight.shape[1]))
    for _ in range(4):
        turned = _rotated(views.corners_world - pivot, axis, x[:, 0])
        extra = Rotation.from_rotvec(x[:, 3, None] * up + x[:, 4, None] * along).as_matrix()
        arm = turned @ extra.transpose(0, 2, 1)[:, None]
        shift = x[:, 1, None] * along + x[:, 2, None] * up + x[:, 5, None] * axis
        in_camera = (arm + pivot + shift[:, None, None, :]) @ R_camera_world.T + t_camera_world
        residual = (views.ideal - project_ideal(camera, in_camera)).reshape(n, -1) * weight
        by_point = project_jacobian(camera, in_camera) @ R_camera_world
        columns = [
            (by_point @ np.cross(direction, arm)[..., None])[..., 0] for direction in (axis, up, along)
        ]
        shifts = [by_point @ direction for direction in (along, up, axis)]
        J = (
            np.stack([columns[0], shifts[0], shifts[1], columns[1], columns[2], shifts[2]], axis=-1).reshape(
                n, -1, 6
            )
            * weight[..., None]
        )
        normal = J.transpose(0, 2, 1) @ J + np.diag(prior)
        gradient = (J.transpose(0, 2, 1) @ residual[..., None])[..., 0] - prior * x
        x += np.linalg.solve(normal, gradient[..., None])[..., 0]
        covariance = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    freedom = np.maximum(np.count_nonzero(weight > 0, axis=1) - 6, 1)
    return _Solution(x, covariance, np.sum(residual**2, axis=1), freedom)
