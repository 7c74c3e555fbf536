"""Page of one strike: tags and fitted pose drawn over its images, curves, phases, and the 3D scene."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from analyze.geometry.rotations import wxyz_from_matrix
from analyze.pipeline.sections import rolling_outline
from analyze.replay import overlay, views
from analyze.replay.body import log_inside, log_shape
from analyze.replay.palette import GREEN, GREY, ORANGE, PHASES, PURPLE, RED, SKY, TABLE, Colour
from analyze.replay.timelines import strike_path
from analyze.replay.words import strike_text

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from analyze.replay.body import SceneInputs
    from analyze.replay.timelines import Timelines
    from analyze.replay.views import DrawnAnswer
    from analyze.tracking.print_points import PrintPoints
    from analyze.tracking.track import TrackingReport
    from analyze.types import Array, IntArray, MarkerTrack, MotionFit, TipAngle, TipMotion
    from schemas.proto import percuss_pb2 as pb
    from schemas.strike_plan import PlannedStrike

_EXPLAINED = 0.5
"""Share of a point's grey value from which it counts as explained."""
_MAX_TABLE_THICKNESS_M = 0.02
"""Greatest half thickness [m] of the drawn table."""


def send_strike(
    timelines: Timelines,
    record: pb.StrikeRecord,
    motion: TipMotion,
    report: TrackingReport | None,
    body: SceneInputs,
    colour: Colour,
) -> None:
    """Send the measured motion of a strike to a replay: tags, curves, phases, overlay and scene.

    The strike's images are sent apart. Without a tipping angle at two or more frames, only text and tags are
    sent; without its entry in the plan, neither overlay nor scene.

    Args:
        timelines: timelines of the stream.
        record: the strike as recorded.
        motion: measured motion of the strike.
        report: tracking of the strike; None if there is none.
        body: object, plan and camera.
        colour: colour of the strike's curve on the page that shows all strikes.
    """
    root, contact = strike_path(record.strike_id), timelines.contact_of(record)
    timelines.log_static(
        f"{root}/text", rr.TextDocument(strike_text(motion, record.choice_text), media_type="text/markdown")
    )
    _tags(timelines, f"{root}/camera", contact, () if report is None else report.tracks)
    if report is not None and report.print_points is not None:
        _print(timelines, f"{root}/camera", contact, report.print_points)
    if motion.angle is None or len(motion.angle.time_ns) < 2:
        return
    _curves(timelines, root, contact, motion, motion.angle)
    every = rr.new_entity_path(["all", motion.strike_id])
    style = rr.SeriesLines(colors=[colour], names=[motion.strike_id], widths=[1.8])
    timelines.send_curve(every, motion.angle.time_ns, contact, np.degrees(motion.angle.theta), style)
    _phases(timelines, f"{root}/phases", contact, motion, motion.angle)
    planned, body = body.planned(record.plan_strike_id), body.seen_from(record.T_world_camera)
    if planned is not None:
        _over_image(timelines, f"{root}/camera", contact, motion, motion.angle, report, body, planned)
        _space(timelines, f"{root}/world", contact, motion.angle, body, planned)


def send_strike_inside(
    timelines: Timelines,
    motion: TipMotion,
    body: SceneInputs,
    answer: DrawnAnswer,
    colours: Mapping[str, Colour],
) -> None:
    """Add the estimate to a strike's scene: equi-plane, centre of mass with its path, interior regions.

    The equi-plane contains the centre of mass and the axis about which the strike tips the object. Nothing is
    sent for a strike without a tipping angle at two or more frames, or one that the plan lacks.

    Args:
        timelines: timelines of the stream.
        motion: motion of the strike.
        body: object, plan and camera.
        answer: estimate to be drawn.
        colours: colour of each strike, by its id.
    """
    planned, angle = body.planned(motion.plan_strike_id), motion.angle
    if planned is None or angle is None or len(angle.time_ns) < 2:
        return
    world = f"{strike_path(motion.strike_id)}/world"
    log_inside(timelines.stream, f"{world}/object", body.model, answer, colours, motion.strike_id)
    R, p = views.object_poses(planned, angle, rolling_outline(body.model, planned))
    path = R @ answer.com.position + p
    timelines.log_static(f"{world}/path_of_c", rr.LineStrips3D([path], colors=[ORANGE], radii=[0.0006]))
    pivot = R[0] @ np.array(planned.pivot.point) + p[0]
    over = np.array([pivot, pivot + np.array([0.0, 0.0, 1.15 * float(path[:, 2].max())])])
    timelines.log_static(f"{world}/plumb", rr.LineStrips3D([over], colors=[GREY], radii=[0.0004]))


# --- over the image


def _tags(timelines: Timelines, root: str, contact_ns: int, tracks: Sequence[MarkerTrack]) -> None:
    """Send the outlines of the detected tags in each frame to the replay, first corners marked.

    Args:
        timelines: timelines of the stream, and the stream.
        root: path of the camera's image in the stream, below which the outlines are put.
        contact_ns: log time of the contact [ns], at which the time shown is 0.
        tracks: tracks of the tags; nothing is sent if they are empty.
    """
    rows = sorted(
        (int(time_ns), number, i)
        for number, track in enumerate(tracks)
        for i, time_ns in enumerate(track.frame_ns)
    )
    if not rows:
        return
    corners = np.array([tracks[number].corners_px[i] for _, number, i in rows])
    send_outlines(timelines, root, contact_ns, np.array([row[0] for row in rows]), corners)


def _print(timelines: Timelines, root: str, contact_ns: int, points: PrintPoints) -> None:
    """Send the points of the print that were followed: green where the image is explained, else red.

    Args:
        timelines: timelines of the stream.
        root: path of the camera's image in the stream, below which the points are put.
        contact_ns: log time of the contact [ns], at which the time shown is 0.
        points: the points in the strike's images.
    """
    columns = timelines.time_columns(points.time_ns, contact_ns)
    explained = points.explained >= _EXPLAINED
    seen = np.isfinite(points.explained)
    for name, colour, drawn in (("print", GREEN, seen & explained), ("misfit", RED, seen & ~explained)):
        places = rr.Points2D.columns(positions=points.pixels[drawn] + 0.5).partition(drawn.sum(axis=1))
        timelines.stream.send_columns(f"{root}/{name}", columns, places)
        timelines.log_static(f"{root}/{name}", rr.Points2D.from_fields(colors=[colour], radii=[-1.2]))


def send_outlines(
    timelines: Timelines, root: str, contact_ns: int, stamps_ns: IntArray, corners_px: Array
) -> None:
    """Send outlines of tags over the images, first corners marked.

    Args:
        timelines: timelines of the stream.
        root: path of the camera's image in the stream, below which the outlines are put.
        contact_ns: log time [ns] at which the time shown is 0.
        stamps_ns: (m,) log times of the outlines [ns], ascending.
        corners_px: (m, 4, 2) corners [px].
    """
    # In rerun the origin is the corner of the first pixel; here pixel centres are integers.
    corners = corners_px + 0.5
    time_ns, counts = np.unique(stamps_ns, return_counts=True)
    columns = timelines.time_columns(time_ns, contact_ns)
    closed = np.concatenate([corners, corners[:, :1]], axis=1)
    timelines.stream.send_columns(
        f"{root}/tags", columns, rr.LineStrips2D.columns(strips=list(closed)).partition(counts)
    )
    timelines.log_static(f"{root}/tags", rr.LineStrips2D.from_fields(colors=[GREEN], radii=[-1.5]))
    timelines.stream.send_columns(
        f"{root}/corners", columns, rr.Points2D.columns(positions=corners[:, 0]).partition(counts)
    )
    timelines.log_static(f"{root}/corners", rr.Points2D.from_fields(colors=[RED], radii=[-3.0]))


def _over_image(
    timelines: Timelines,
    root: str,
    contact_ns: int,
    motion: TipMotion,
    angle: TipAngle,
    report: TrackingReport | None,
    body: SceneInputs,
    planned: PlannedStrike,
) -> None:
    """Send the pivot axis and the object at the fitted angle, as lines over the strike's images.

    Only the axis is sent without a fit, or if the fit has fewer than three frames or no rate constant k of
    the motion theta'' = -k sin(phi - theta), theta the tipping angle, phi the balance angle.
    """
    camera = overlay.camera_of_report(report, body.camera_of(planned))
    tracks = () if report is None else report.tracks
    rest = overlay.pose_at_rest(planned, tracks, body.markers, camera, contact_ns)
    pivot = rest[0] @ np.array(planned.pivot.point) + rest[1]
    half = 0.75 * float(np.ptp(body.model.vertices @ np.array(planned.pivot.direction)))
    axis = overlay.axis_line(camera, pivot, half) + 0.5
    if len(axis):
        timelines.log_static(f"{root}/pivot", rr.LineStrips2D([axis], colors=[RED], radii=[-2.0]))
        timelines.log_static(f"{root}/pivot/near", rr.Points2D(axis[[0]], colors=[RED], radii=[-4.0]))
    fitted = None if motion.fit is None else views.fitted_curves(angle, motion.fit)
    if motion.fit is None or fitted is None:
        return
    fitted_tip = views.fitted_angle(angle, motion.fit, fitted)
    R, p = views.object_poses(planned, fitted_tip, rolling_outline(body.model, planned), rest)
    drawn = overlay.wireframe(body.model, camera, R, p)
    # The overlay ends after the last frame of the fit.
    after = min(motion.fit.window[1], len(angle.time_ns) - 1)
    time_ns = np.append(fitted_tip.time_ns, max(int(angle.time_ns[after]), int(fitted_tip.time_ns[-1]) + 1))
    counts = np.array([*(len(lines) for lines in drawn), 0])
    strips = [line + 0.5 for lines in drawn for line in lines]
    if strips:
        columns = rr.LineStrips2D.columns(strips=strips).partition(counts)
        timelines.stream.send_columns(f"{root}/ghost", timelines.time_columns(time_ns, contact_ns), columns)
        timelines.log_static(f"{root}/ghost", rr.LineStrips2D.from_fields(colors=[SKY], radii=[-1.2]))


# --- curves


def _curves(timelines: Timelines, root: str, contact_ns: int, motion: TipMotion, angle: TipAngle) -> None:
    def send(path: str, time_ns: IntArray, values: Array, style: rr.SeriesLines | rr.SeriesPoints) -> None:
        timelines.send_curve(f"{root}/{path}", time_ns, contact_ns, np.degrees(values), style)

    measured = views.measured_curves(angle)
    points = rr.SeriesPoints(colors=[ORANGE], names=["measured"], marker_sizes=[2.2])
    for name, values in (("theta", measured.theta), ("omega", measured.omega), ("alpha", measured.alpha)):
        send(f"{name}/measured", measured.time_ns, values, points)
    at_contact = float(np.interp(contact_ns, measured.time_ns, measured.theta))
    _mark(timelines, f"{root}/theta/contact", contact_ns, contact_ns, at_contact, "contact", RED)
    fitted = None if motion.fit is None else views.fitted_curves(angle, motion.fit)
    if motion.fit is None or fitted is None:
        return
    line = rr.SeriesLines(colors=[SKY], names=["fitted"], widths=[2.0])
    for name, values in (("theta", fitted.theta), ("omega", fitted.omega), ("alpha", fitted.alpha)):
        send(f"{name}/fitted", fitted.time_ns, values, line)
    points = rr.SeriesPoints(colors=[PURPLE], names=["residual"], marker_sizes=[2.0])
    send("residual/value", fitted.time_ns, fitted.residual, points)
    ends = measured.time_ns[[0, -1]]
    send("residual/zero", ends, np.zeros(2), rr.SeriesLines(colors=[GREY], names=["zero"], widths=[0.7]))
    line = rr.SeriesLines(colors=[GREEN], names=["φ: c above the edge"], widths=[1.0])
    send("theta/phi", ends, np.full(2, motion.fit.phi), line)
    _passage(timelines, f"{root}/theta/passage", contact_ns, motion.fit, fitted)


def _passage(
    timelines: Timelines, path: str, contact_ns: int, fit: MotionFit, fitted: views.FittedCurves
) -> None:
    """Show in a replay the time at which the fitted motion first passes the balance angle.

    Nothing is shown if the motion does not reach that angle, or starts beyond it.
    """
    above = np.flatnonzero(fitted.theta >= fit.phi)
    if not len(above) or above[0] == 0:
        return
    i = int(above[0])
    share = float((fit.phi - fitted.theta[i - 1]) / (fitted.theta[i] - fitted.theta[i - 1]))
    time_ns = int(fitted.time_ns[i - 1] + share * (fitted.time_ns[i] - fitted.time_ns[i - 1]))
    _mark(timelines, path, contact_ns, time_ns, fit.phi, "passes the balance", GREEN)


def _mark(
    timelines: Timelines, path: str, contact_ns: int, time_ns: int, theta: float, name: str, colour: Colour
) -> None:
    style = rr.SeriesPoints(colors=[colour], names=[name], markers=["diamond"], marker_sizes=[6.0])
    timelines.send_curve(path, np.array([time_ns]), contact_ns, np.degrees([theta]), style)


def _phases(timelines: Timelines, path: str, contact_ns: int, motion: TipMotion, angle: TipAngle) -> None:
    if motion.phases is None:
        return
    timelines.name_states(path, PHASES)
    for name, (first, last) in motion.phases.spans().items():
        timelines.change_state(path, name, int(angle.time_ns[first]), contact_ns)
        if last < len(angle.time_ns):
            timelines.change_state(path, None, int(angle.time_ns[last]), contact_ns)


# --- space


def _space(
    timelines: Timelines,
    world: str,
    contact_ns: int,
    angle: TipAngle,
    body: SceneInputs,
    planned: PlannedStrike,
) -> None:
    stream, model = timelines.stream, body.model
    reach = float(model.extent.max())
    stream.log(world, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    thick = min(_MAX_TABLE_THICKNESS_M, 0.02 * reach)
    half = [[1.35 * reach, 0.7 * reach, thick]]
    table = rr.Boxes3D(
        centers=[[0.15 * reach, 0.0, -thick - 1e-4]], half_sizes=half, colors=[TABLE], fill_mode="solid"
    )
    stream.log(f"{world}/table", table, static=True)
    R, p = views.object_poses(planned, angle, rolling_outline(model, planned))
    quaternion = wxyz_from_matrix(R)[:, [1, 2, 3, 0]]
    columns = rr.Transform3D.columns(translation=p, quaternion=quaternion)
    stream.send_columns(f"{world}/object", timelines.time_columns(angle.time_ns, contact_ns), columns)
    log_shape(stream, f"{world}/object", model)
    pivot = R[0] @ np.array(planned.pivot.point) + p[0]
    length = 0.75 * float(np.ptp(model.vertices @ np.array(planned.pivot.direction)))
    ends: Array = pivot + np.outer([-length, length], [0.0, 1.0, 0.0])
    stream.log(f"{world}/pivot", rr.LineStrips3D([ends], colors=[RED], radii=[0.0012]), static=True)
