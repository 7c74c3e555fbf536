"""Page of one toss: tags and fitted pose drawn over its images, track, angular velocity, residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

from analyze.geometry.rotations import wxyz_from_matrix
from analyze.pipeline.tosses import thrown_body
from analyze.replay import overlay
from analyze.replay.body import log_shape
from analyze.replay.layout import TossPage
from analyze.replay.palette import BLUE, GREEN, ORANGE, PURPLE, RED, SKY
from analyze.replay.strike_scene import send_outlines
from analyze.replay.timelines import toss_path
from analyze.replay.toss_curves import toss_curves
from analyze.replay.words import toss_text
from analyze.tracking.printed_view import VIEW_PREFIX

if TYPE_CHECKING:
    from analyze.flight.toss import TossMotion
    from analyze.pipeline.evidence import StruckObject
    from analyze.replay.body import SceneInputs
    from analyze.replay.timelines import Timelines
    from analyze.replay.toss_curves import TossCurves
    from schemas.session_manifest import SessionManifest

AXES = (("x", RED), ("y", GREEN), ("z", BLUE))
"""names and colours of the axes of the object frame"""


def flight_span(toss: TossMotion) -> tuple[int, int] | None:
    """Log times [ns] of the first and last frame of a toss's free flight; None without one."""
    if toss.flight is None:
        return None
    time_ns = toss.flight.views.time_ns
    return int(time_ns[0]), int(time_ns[-1])


def send_toss(
    timelines: Timelines,
    toss: TossMotion,
    body: SceneInputs,
    struck: StruckObject,
    manifest: SessionManifest,
) -> TossPage:
    """Send the flight of a toss to a replay; only its verdict if there is none. The images are sent apart.

    Args:
        timelines: timelines of the stream.
        toss: toss with its verdict, and its fitted flight.
        body: object and camera.
        struck: object with the markers' masses included.
        manifest: metadata of the recording.

    Returns:
        Page of the toss.
    """
    root, verdict = toss_path(toss.toss_id), toss.verdict.value.replace("_", " ")
    timelines.log_static(f"{root}/text", rr.TextDocument(toss_text(toss), media_type="text/markdown"))
    if toss.flight is None:
        return TossPage(toss.toss_id, verdict)
    thrown, _ = thrown_body(struck.spec, struck.model, manifest)
    curves = toss_curves(toss.flight, thrown, body.camera)
    zero_ns = int(curves.time_ns[0])
    order = np.argsort(curves.view_ns, kind="stable")
    send_outlines(timelines, f"{root}/camera", zero_ns, curves.view_ns[order], curves.corners_px[order])
    _over_image(timelines, f"{root}/camera", zero_ns, curves, body)
    _rates(timelines, root, zero_ns, curves)
    _residuals(timelines, root, zero_ns, curves)
    style = rr.SeriesLines(colors=[ORANGE], names=["c"], widths=[2.0])
    height_mm = 1e3 * curves.p_world_com[:, 2]
    timelines.send_curve(f"{root}/height/com", curves.time_ns, zero_ns, height_mm, style)
    _space(timelines, f"{root}/world", zero_ns, curves, body)
    low, high = curves.p_world_com.min(axis=0), curves.p_world_com.max(axis=0)
    reach = float(np.ptp(curves.p_world_com, axis=0).max()) + float(body.model.extent.max())
    return TossPage(toss.toss_id, verdict, tuple(0.5 * (low + high)), reach)


def _over_image(timelines: Timelines, root: str, zero_ns: int, curves: TossCurves, body: SceneInputs) -> None:
    """Object at the fitted pose, and the fitted track of c, as lines over the images."""
    track = overlay.project_to_pixels(body.camera, curves.p_world_com) + 0.5
    track = track[np.all(np.isfinite(track), axis=1)]
    if len(track) > 1:
        timelines.log_static(f"{root}/track", rr.LineStrips2D([track], colors=[ORANGE], radii=[-1.5]))
    drawn = overlay.wireframe(body.model, body.camera, curves.R_world_object, curves.p_world_object)
    counts = np.array([*(len(lines) for lines in drawn), 0])
    strips = [line + 0.5 for lines in drawn for line in lines]
    if strips:
        # Without the last, empty row the last pose would stay.
        time_ns = np.append(curves.time_ns, 2 * curves.time_ns[-1] - curves.time_ns[-2])
        columns = rr.LineStrips2D.columns(strips=strips).partition(counts)
        timelines.stream.send_columns(f"{root}/ghost", timelines.time_columns(time_ns, zero_ns), columns)
        timelines.log_static(f"{root}/ghost", rr.LineStrips2D.from_fields(colors=[SKY], radii=[-1.2]))


def _rates(timelines: Timelines, root: str, zero_ns: int, curves: TossCurves) -> None:
    """Angular velocity along the object's axes: fitted as lines, by single frames as points [turns/s]."""
    for axis, (name, colour) in enumerate(AXES):
        style = rr.SeriesPoints(colors=[colour], names=[f"{name}, single frames"], marker_sizes=[2.0])
        seen = curves.seen_rate[:, axis] / (2 * np.pi)
        timelines.send_curve(f"{root}/rate/{name}_seen", curves.seen_ns, zero_ns, seen, style)
        line = rr.SeriesLines(colors=[colour], names=[f"{name}, fitted"], widths=[2.0])
        fitted = curves.rate[:, axis] / (2 * np.pi)
        timelines.send_curve(f"{root}/rate/{name}", curves.time_ns, zero_ns, fitted, line)


def _residuals(timelines: Timelines, root: str, zero_ns: int, curves: TossCurves) -> None:
    """Distance of the tags' corners from the fitted flight [px], one set of points per tag."""
    names = sorted(set(curves.tag), key=str)
    cycle = (PURPLE, ORANGE, SKY, GREEN, BLUE, RED)
    for number, name in enumerate(names):
        index = np.array([i for i, each in enumerate(curves.tag) if each == name])
        # Views of the object's print are named by their strike.
        label = name if str(name).startswith(VIEW_PREFIX) else f"tag {name}"
        style = rr.SeriesPoints(colors=[cycle[number % len(cycle)]], names=[label], marker_sizes=[2.5])
        path = f"{root}/residual{rr.new_entity_path([label])}"
        timelines.send_curve(path, curves.view_ns[index], zero_ns, curves.residual_px[index], style)


def _space(timelines: Timelines, world: str, zero_ns: int, curves: TossCurves, body: SceneInputs) -> None:
    """The flight in space: object at the fitted pose, and the track of c with a point per frame."""
    stream = timelines.stream
    stream.log(world, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    quaternion = wxyz_from_matrix(curves.R_world_object)[:, [1, 2, 3, 0]]
    columns = rr.Transform3D.columns(translation=curves.p_world_object, quaternion=quaternion)
    stream.send_columns(f"{world}/object", timelines.time_columns(curves.time_ns, zero_ns), columns)
    log_shape(stream, f"{world}/object", body.model)
    track = curves.p_world_com
    timelines.log_static(f"{world}/track", rr.LineStrips3D([track], colors=[ORANGE], radii=[0.0008]))
    timelines.log_static(f"{world}/frames", rr.Points3D(track, colors=[ORANGE], radii=[0.002]))
