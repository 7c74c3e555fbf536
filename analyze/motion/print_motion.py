"""Motion of a strike by the object's own print: template at rest, tracking, and the pose at rest with them.

A hand puts an object down a degree and a few millimetres off its planned pose. The frames of the tip show
the turn about the vertical and the place on the table, which are fitted with the motion.
"""

# numpy and cv2 are only partly typed.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportUnknownArgumentType=false

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.errors import TrackingError
from analyze.motion.enough_print import print_follower, refuse_poor_print
from analyze.motion.print_rest_pose import moved_camera, rest_correction, theta_sd_by_rest
from analyze.motion.rest_frames import end_of_motion, frames_at_rest
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion, analyse_strike, placement_of
from analyze.motion.tip_angle import PlanarMotion
from analyze.tracking.print_follower import ROLL, THETA, YAW, X, Z
from analyze.tracking.print_likeness import rest_view
from analyze.tracking.print_outline import OutlineMisfit, outline_misfit
from analyze.tracking.print_points import print_points
from analyze.tracking.print_template import IdealImages
from analyze.tracking.track import TrackingReport, track_markers
from analyze.types import TipAngle
from schemas.strike_result import FollowedBy

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from analyze.motion.strike_task import StrikeTask
    from analyze.motion.tip_angle import Placement
    from analyze.tracking.print_follower import PrintFollower, PrintPose
    from analyze.tracking.print_likeness import RestView
    from analyze.tracking.print_points import PrintPoints
    from analyze.types import Array, CameraModel, ImageFrame, IntArray, Marker, TipMotion

_WORSE = 0.98
"""share of the print explained, over the best so far, below which a correction at rest was wrong"""
REST_STEPS = 3
"""number of corrections of the pose at rest, each with the strike tracked again"""
_REST_CONVERGED = np.array([math.radians(0.06), 2e-3, 5e-4])
"""correction of the pose at rest below which the strike is not tracked again: a place along the image only
keeps the points off the background"""
BIAS_SD, ROUND_BIAS_SD = math.radians(0.010), math.radians(0.020)
"""1 sigma of theta's error that neighbouring frames share, on flat faces and on round walls: grey values
between pixels, light, the pose at rest"""
OBLIQUE_SD = math.radians(0.2)
"""1 sigma of such an error, times the sine of the angle by which the line of sight lies beside the edge:
turns of the object about the other two axes then look like a tip"""
PLACE_SD = 0.15e-3
"""1 sigma of slow errors of slip and lift [m], as of theta"""
BIAS_PER_MISFIT, PLACE_PER_MISFIT = math.radians(0.8), 4e-3
"""1 sigma of further slow errors of theta [rad] and of slip and lift [m], per share of the print that moving
frames do not explain: highlights, shadows and coding"""
_TRACKED_REST = 30
"""largest number of frames at rest that are tracked; all serve for the template"""
_OUTLINE_RAD, _OUTLINE_FRAMES = (math.radians(8.0), math.radians(50.0)), 8
"""tips at which the outline is checked [rad], and number of frames"""
MAX_BEYOND, MAX_MISSING = 0.018, 0.012
"""area beyond the planned outline that moves with the body, and within it that stays, over the outline's,
above which the object lies otherwise; a shadow that falls on a shadow makes up to 0.015"""
_LEAST_EXPLAINED = 0.6
"""share of the print that a frame must explain, over that at rest, to count"""
_MOST_BACK = math.radians(15.0)
"""tip towards the striker beyond which a frame does not count: the table is there"""


@dataclass(frozen=True)
class _Followed:
    """Frames tracked with the pose at rest that fits them."""

    poses: list[PrintPose]
    """(n,) poses of the frames; those after the motion were tracked with the planned pose at rest"""
    ended: int
    """number of frames until the motion ends"""
    follower: PrintFollower
    """the tracker"""
    seen_by: CameraModel
    """camera as seen from the object as it was put down"""
    yaw: float
    """turn about W's z by which it was put down otherwise than planned [rad]"""


def analyse_images(
    frames: Iterable[ImageFrame],
    camera: CameraModel,
    markers: list[Marker],
    shape: tuple[Array, IntArray] | None,
    task: StrikeTask,
) -> tuple[TipMotion, TrackingReport]:
    """Analyse one strike from its images: by the object's markers, without any by its own print.

    Args:
        frames: images of the strike's window, in order of time.
        camera: camera with its pose in W.
        markers: markers of the object.
        shape: vertices (v, 3) in O [m] and triangles (t, 3) of the object; needed without markers.
        task: the strike as planned and as carried out; what the images show of it is filled in.

    Returns:
        Motion with phases, fits and verdict, and report on the tracking.

    Raises:
        TrackingError: markers cannot be used, fewer than three images show the object at rest, or the print
            is too poor to show the tip.
    """
    if markers:
        report = track_markers(frames, camera, markers, task.planned.visible_markers)
        task = replace(task, images_end_ns=report.images_end_ns, unmarked_ns=report.unmarked_ns)
        return analyse_strike(report.tracks, markers, camera, task), report
    if shape is None:
        raise TrackingError("the object has no tags, and its shape is not known yet: it cannot be followed")
    images = list(frames)
    times_ns = np.array([frame.time_ns for frame in images], dtype=np.int64)
    motion, view, points = print_motion(
        images, camera, shape, placement_of(task.planned), task.contact_time_ns, _edge_left_rad(task)
    )
    report = TrackingReport((), (), times_ns, view, points)
    unseen_ns = np.setdiff1d(times_ns, motion.angle.time_ns)
    task = replace(task, images_end_ns=report.images_end_ns, unmarked_ns=unseen_ns)
    analysed = analyse_motion(motion, task, MotionSettings())
    return replace(analysed, followed_by=FollowedBy.PRINT), report


def print_motion(
    frames: Sequence[ImageFrame],
    camera: CameraModel,
    shape: tuple[Array, IntArray],
    placement: Placement,
    contact_time_ns: int,
    edge_left_rad: float = math.inf,
) -> tuple[PlanarMotion, RestView, PrintPoints]:
    """Motion of a strike from its images by the print that the camera sees at rest.

    Args:
        frames: images of the strike's window, in order of time.
        camera: camera with its pose in W.
        shape: vertices (v, 3) in O [m] and triangles (t, 3) of the object.
        placement: planned pose of the object and pivot.
        contact_time_ns: log time of the contact [ns]; 0 if unknown.
        edge_left_rad: tip at which the object goes over to another line than the planned edge [rad].

    Returns:
        Tipping angle, slip and lift of the pivot in every frame in which the print was found; the object at
        rest; and some of the points that were followed.

    Raises:
        TrackingError: fewer than three images at rest, or a print too poor to show the tip.
    """
    images = IdealImages(camera)
    rested = frames_at_rest(frames, contact_time_ns)
    rest = [images.ideal(frame.image) for frame in frames[:rested]]
    frames = frames[max(0, rested - _TRACKED_REST) :]
    rested = min(rested, _TRACKED_REST)
    times_ns = np.array([frame.time_ns for frame in frames], dtype=np.int64)
    times_s = 1e-9 * (times_ns - times_ns[0])
    followed = _follow(frames, times_s, rest, images, shape, placement, edge_left_rad)
    poses, follower, seen_by = followed.poses, followed.follower, followed.seen_by
    pivot = placement.R_world_object @ placement.p_object_pivot + placement.p_world_object
    tipped = _over_edge(poses[: followed.ended], edge_left_rad)
    bias_sd = ROUND_BIAS_SD if follower.sees_round_walls else BIAS_SD
    slow_sd = _slow_sd(tipped, rested, pivot - seen_by.T_world_camera[:3, 3], bias_sd)
    found = _frames_with_print(poses, rested)
    tip = [(images.ideal(frames[number].image), poses[number].x) for number in _outline_frames(poses, found)]
    if tip:
        placed = shape[0] @ placement.R_world_object.T + placement.p_world_object, shape[1]
        _refuse_other_outline(outline_misfit(follower, seen_by, placed, np.mean(rest, axis=0), tip))
    motion = _planar(times_ns, poses, rested, found, slow_sd)
    angle = replace(motion.angle, strain_sd=camera.strain_sd)
    pose = placement.R_world_object, placement.p_world_object
    view = rest_view(rest, seen_by, shape[0], pose)
    return replace(motion, angle=angle, yaw=followed.yaw), view, print_points(times_ns, poses, camera)


def _follow(
    frames: Sequence[ImageFrame],
    times_s: Array,
    rest: Sequence[NDArray[np.float32]],
    images: IdealImages,
    shape: tuple[Array, IntArray],
    placement: Placement,
    edge_left_rad: float,
) -> _Followed:
    """Track the frames, with the pose at rest that explains most of the print.

    Args:
        frames: (n,) images, from some at rest on.
        times_s: (n,) their times [s].
        rest: (h, w) images at rest, free of lens distortion.
        images: removal of the camera's distortion.
        shape: vertices (v, 3) in O [m] and triangles (t, 3) of the object.
        placement: planned pose of the object and pivot.
        edge_left_rad: tip at which the object goes over to another line than the planned edge [rad].

    Raises:
        TrackingError: no face is in view, or its print is too poor.
    """
    rested = min(len(rest), _TRACKED_REST)
    pivot = placement.R_world_object @ placement.p_object_pivot + placement.p_world_object
    interval_s = float(np.median(np.diff(times_s)))
    turned = np.zeros(3)
    unknown: list[None] = [None] * len(frames)
    starts: Sequence[Array | None] = unknown
    rates: Sequence[float | None] = unknown
    best: tuple[float, Array, list[PrintPose], PrintFollower] | None = None
    settled: list[PrintPose] = []
    for step in range(REST_STEPS + 1):
        # Where the object was put down otherwise, so was its edge: the camera is moved instead.
        before = moved_camera(images.camera, pivot, turned)
        follower = print_follower(rest, before, images, shape, placement, interval_s)
        if step == 0:
            refuse_poor_print(follower)
        moving = frames[: len(frames) - len(settled)]
        poses = [
            follower.add(frame.image, starts[number], rates[number]) for number, frame in enumerate(moving)
        ]
        if step == 0:
            ended = end_of_motion(poses, times_s)
            poses, settled = poses[:ended], poses[ended:]
        explained = _explained_of_rest(poses, rested)
        if best is not None and explained < _WORSE * best[0]:
            # Too far: half the way back.
            turned, starts = 0.5 * (turned + best[1]), unknown
            continue
        best = explained, turned, poses, follower
        correction = rest_correction(_over_edge(poses[rested:], edge_left_rad), turned)
        if np.all(np.abs(correction) < _REST_CONVERGED):
            break
        turned = turned + correction
        rates = np.gradient([pose.x[THETA] for pose in poses], times_s[: len(poses)]).tolist()
        # Points on the background may have led the poses astray.
        astray = abs(correction[1]) > _REST_CONVERGED[1]
        starts = [
            None if astray or pose.explained == 0 else pose.x + pose.by_rest @ correction for pose in poses
        ]
    assert best is not None  # noqa: S101 - there is a step
    _, turned, poses, follower = best
    after = [_by_rest(pose, turned, follower) for pose in settled]
    seen_by = moved_camera(images.camera, pivot, turned)
    return _Followed([*poses, *after], len(poses), follower, seen_by, float(turned[0]))


def _explained_of_rest(poses: Sequence[PrintPose], rested: int) -> float:
    """Share of the print that frames in motion explain, over that of the frames at rest.

    It compares templates: one that takes in the body's outline explains more at rest.
    """
    explained = np.array([pose.explained for pose in poses])
    return float(np.mean(explained[rested:])) / max(float(np.mean(explained[:rested])), 1e-9)


def _edge_left_rad(task: StrikeTask) -> float:
    """Tip [rad] at which the object goes over to another line than the planned edge; infinite if unknown."""
    landing = math.inf if task.landing_angle_rad is None else task.landing_angle_rad
    return min([landing, *(line.takes_over_rad for line in (task.supports or ())[1:2])])


def _over_edge(poses: Sequence[PrintPose], edge_left_rad: float) -> list[PrintPose]:
    """Frames in which the object turns over the planned edge, before any in which it does over another."""
    left = [number for number, pose in enumerate(poses) if pose.explained and pose.x[THETA] > edge_left_rad]
    return list(poses[: left[0]] if left else poses)


def _by_rest(pose: PrintPose, turned: Array, follower: PrintFollower) -> PrintPose:
    """Pose that was found with the planned pose at rest, for another one."""
    x = pose.x + pose.by_rest @ turned
    pixels = follower.moved(x)
    return replace(pose, x=x, pixels=pixels, explained_points=np.full(len(pixels), pose.explained))


def _frames_with_print(poses: Sequence[PrintPose], rested: int) -> NDArray[np.bool_]:
    """True (n,) for frames at rest, and for others that explain enough of the print above the table."""
    explained = np.array([pose.explained for pose in poses])
    theta = np.array([pose.x[THETA] for pose in poses])
    found = (explained >= _LEAST_EXPLAINED * float(np.median(explained[:rested]))) & (theta > -_MOST_BACK)
    found[:rested] = True
    return found


def _outline_frames(poses: Sequence[PrintPose], found: NDArray[np.bool_]) -> list[int]:
    """Numbers of some frames of the tip, by which the outline is checked."""
    low, high = _OUTLINE_RAD
    theta = np.array([pose.x[THETA] for pose in poses])
    usable = np.flatnonzero(found & (theta > low) & (theta < high))
    return usable[:: max(1, len(usable) // _OUTLINE_FRAMES)].tolist()


def _refuse_other_outline(misfit: OutlineMisfit) -> None:
    """Refuse a strike in which more, or less, than the planned shape moves with the print.

    Raises:
        TrackingError: the object was put down otherwise than planned, or has another size.
    """
    if misfit.beyond > MAX_BEYOND or misfit.missing > MAX_MISSING:
        found = "more" if misfit.beyond > misfit.missing else "less"
        raise TrackingError(
            f"{found} than the planned shape moves with the print: put the object down as its card shows, or"
            " correct the shape in the object file"
        )


def _slow_sd(poses: Sequence[PrintPose], rested: int, sight: Array, bias_sd: float) -> tuple[float, float]:
    """1 sigma of the errors that neighbouring frames share: of theta [rad], and of slip and lift [m].

    Args:
        poses: (n,) poses of the frames at rest and of the tip.
        rested: number of the first frames, in which the object is at rest.
        sight: (3,) from the camera to the pivot.
        bias_sd: 1 sigma of such an error of theta where all is well [rad].
    """
    explained = np.array([pose.explained for pose in poses])[_frames_with_print(poses, rested)][rested:]
    misfit = 1.0 - float(np.median(explained)) if len(explained) else 0.0
    oblique = abs(float(sight[0])) / float(np.linalg.norm(sight))
    by_rest = theta_sd_by_rest(poses, rested)
    theta_sd = math.hypot(bias_sd, OBLIQUE_SD * oblique, BIAS_PER_MISFIT * misfit, by_rest)
    return theta_sd, math.hypot(PLACE_SD, PLACE_PER_MISFIT * misfit)


def _planar(
    times_ns: IntArray,
    poses: Sequence[PrintPose],
    rested: int,
    kept: NDArray[np.bool_],
    slow_sd: tuple[float, float],
) -> PlanarMotion:
    """Motion of the frames in which the print was found, against that at rest.

    Args:
        times_ns: (n,) log times of the frames [ns].
        poses: (n,) their poses.
        rested: number of the first frames, in which the object is at rest.
        kept: (n,) True for frames in which the print was found.
        slow_sd: 1 sigma of the errors that neighbouring frames share: of theta [rad], of slip and lift [m].
    """
    x = np.array([pose.x for pose in poses])[kept]
    covariance = np.array([pose.covariance for pose in poses])[kept]
    x = x - x[:rested].mean(axis=0)
    single = np.sqrt(covariance[:, THETA, THETA])
    # Noise that neighbouring pixels share: the scatter at rest knows it.
    scatter = float(np.std(np.diff(x[:rested, THETA])) / math.sqrt(2.0)) if rested > 4 else np.inf
    factor = min(1.0, max(scatter / float(np.median(single[:rested])), 0.3))
    place = [THETA, X, Z]
    off_axis = np.hypot(x[:, ROLL], x[:, YAW])
    off_sd = np.sqrt(covariance[:, ROLL, ROLL] + covariance[:, YAW, YAW])
    angle = TipAngle(
        time_ns=times_ns[kept],
        theta=x[:, THETA],
        sd=factor * single,
        off_axis=off_axis,
        slip=x[:, X],
        zero_sd=math.hypot(0.5 * BIAS_SD, factor * float(np.median(single[:rested])) / math.sqrt(rested)),
        slow_sd=slow_sd[0],
    )
    planar = covariance[:, place][:, :, place] * factor**2
    planar[:, 1:, 1:] += slow_sd[1] ** 2 * np.eye(2)
    position_sd = np.sqrt(0.5 * (planar[:, 1, 1] + planar[:, 2, 2]))
    motion = PlanarMotion(angle, x[:, Z], position_sd, off_sd, 0.0, planar)
    return replace(
        motion, slow_place_sd=slow_sd[1], roll=x[:, ROLL], roll_sd=np.sqrt(covariance[:, ROLL, ROLL])
    )
