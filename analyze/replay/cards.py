"""Placement cards (pictures that show how to set up each strike) as a recording for the viewer rerun.

One step per strike, with object, line on the table, striker and camera in the world frame W.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from analyze.cards.body import CARD_CELLS
from analyze.cards.page import Card, placement_cards
from analyze.cards.setting import tip_arc
from analyze.geometry.object_model import ObjectModel
from analyze.geometry.rotations import apply
from analyze.replay.body import flat_mesh
from analyze.replay.layout import scene_view, without_panels
from analyze.replay.markdown import as_written, message
from analyze.replay.stream_file import finish_file
from analyze.tags import families
from analyze.tags.sheet import black_rectangles
from analyze.types import Array, CameraModel
from schemas.object_spec import MarkerSpec, ObjectSpec
from schemas.output_file import OutputError, refuse_unwritable
from schemas.strike_plan import StrikePlan
from schemas.wording import counted

STRIKE = "strike"
"""Name of the timeline of the cards; its step 1 is the first strike."""
_APPLICATION = "percuss"
_STRIKER, _PIVOT, _CAMERA = (86, 160, 230), (240, 120, 50), (60, 190, 140)
"""Colours of the printed cards, lightened for a dark background."""
_BODY, _EDGE, _TABLE = (196, 203, 213), (60, 66, 74), (84, 73, 60)
_LIFT = 2e-4
"""Gap [m] between face and tag, and between the tag's card and its black cells; it prevents flicker."""
_IMAGE_PLANE_DISTANCE_M = 0.05
"""Distance [m] from the camera's centre to the image plane, as drawn."""


def write_card_scenes(
    plan: StrikePlan, model: ObjectModel, spec: ObjectSpec, camera: CameraModel, output: Path
) -> None:
    """Write the placement cards of a plan as a file for rerun (.rrd), complete or not at all.

    Args:
        plan: strikes to be drawn, in their order.
        model: exterior of the object.
        spec: object description with its tags.
        camera: camera whose intrinsics are drawn; its pose is taken from each planned strike instead.
        output: path of the file.

    Raises:
        OutputError: the file cannot be written.
    """
    refuse_unwritable(output)
    part = output.with_name(output.name + ".part")
    try:
        with rr.RecordingStream(_APPLICATION, recording_id=f"plan-{plan.object_sha256}") as stream:
            stream.save(part, default_blueprint=_layout(model))
            stream.send_recording_name(f"{plan.object_name}: {counted(len(plan.strikes), 'strike')}")
            log_scenes(stream, plan, model, spec, camera)
            finish_file(stream, part, output)
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error.strerror}: choose another place") from None
    finally:
        part.unlink(missing_ok=True)


def log_scenes(
    stream: rr.RecordingStream, plan: StrikePlan, model: ObjectModel, spec: ObjectSpec, camera: CameraModel
) -> None:
    """Log the scene of each strike's placement card to a stream, one step of the timeline per strike.

    Args:
        stream: destination.
        plan: strikes to be drawn, in their order.
        model: exterior of the object.
        spec: object description with its tags.
        camera: camera whose intrinsics are drawn; its pose is taken from each planned strike instead.
    """
    _log_static(stream, model, spec)
    for card in placement_cards(plan, model, spec):
        stream.set_time(STRIKE, sequence=card.number)
        _strike(stream, card, camera)


def _log_static(stream: rr.RecordingStream, model: ObjectModel, spec: ObjectSpec) -> None:
    """Log the entities that all strikes share: the table, and the object with its tags in frame O.

    O is the object's own frame; tags whose pose is not known are left out.
    """
    size = float(model.extent.max())
    stream.log("/world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    table = rr.Boxes3D(
        centers=[[0, 0, -0.0031]],
        half_sizes=[[1.4 * size, 1.2 * size, 0.003]],
        colors=[_TABLE],
        fill_mode="solid",
    )
    stream.log("/world/table", table, static=True)
    stream.log("/world/object/shape", flat_mesh(model, (*_BODY, 255)), static=True)
    for marker in spec.marker:
        if marker.T_object_marker is not None:
            _tag(stream, f"/world/object/tags/{marker.name}", marker)


def _tag(stream: rr.RecordingStream, path: str, marker: MarkerSpec) -> None:
    code = families.cells(marker.family, marker.id)
    half = marker.size_m / 2
    rim = half * CARD_CELLS / len(code)
    white = _quads(np.array([[-rim, -rim, 2 * rim, 2 * rim]]), _LIFT)
    fields = black_rectangles(code, -half, -half, marker.size_m)
    black = _quads(np.array([[each.x, each.y, each.width, each.height] for each in fields]), 2 * _LIFT)
    for name, quads, tone in (("card", white, 255), ("cells", black, 12)):
        points = apply(np.array(marker.T_object_marker), quads.reshape(-1, 3))
        triangles = 4 * np.arange(len(quads))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
        mesh = rr.Mesh3D(
            vertex_positions=points,
            triangle_indices=triangles.reshape(-1, 3),
            albedo_factor=(tone, tone, tone, 255),
        )
        stream.log(f"{path}/{name}", mesh, static=True)


def _quads(fields: Array, height: float) -> Array:
    """Corners (n, 4, 3) [m] of rectangles in the marker's frame M, at z = `height` [m].

    Args:
        fields: (n, 4) x and y of the corner where both are smallest, width and height of each rectangle [m].
        height: z of all corners [m].
    """
    x, y, width, high = fields.T
    flat = np.stack([[x, y], [x + width, y], [x + width, y + high], [x, y + high]]).transpose(2, 0, 1)
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), height)], axis=2)


def _strike(stream: rr.RecordingStream, card: Card, camera: CameraModel) -> None:
    place, strike = card.place, card.strike
    size = place.size
    stream.log("/world/object", rr.Transform3D(translation=place.body.p, mat3x3=place.body.R))
    edges = [
        place.body.world(edge)
        for edge, sharp in zip(place.body.shape.edges, place.body.shape.creases, strict=True)
        if sharp
    ]
    stream.log("/world/edges", rr.LineStrips3D(edges, colors=[_EDGE], radii=[0.0004]))
    front, back = place.low[1] - 0.4 * size, place.high[1] + 0.4 * size
    stream.log(
        "/world/line", rr.LineStrips3D([[[0, front, 2e-4], [0, back, 2e-4]]], colors=[_PIVOT], radii=[0.0006])
    )
    ends = (0.0, 0.0) if place.edge is None else place.edge
    pivot = rr.LineStrips3D([[[0, ends[0], 5e-4], [0, ends[1], 5e-4]]], colors=[_PIVOT], radii=[0.0024])
    stream.log("/world/pivot", pivot)
    stream.log(
        "/world/pivot/mark",
        rr.Points3D([[0, 0, 5e-4]], colors=[_PIVOT], radii=[0.003 if place.edge is None else 0.0024]),
    )
    tail = place.hit - np.array([0.6 * place.reach, 0, 0])
    words = f"{1000 * place.strike_height:.0f} mm high, {strike.aim.tip_speed_m_s.target:.2f} m/s"
    stream.log(
        "/world/striker",
        rr.Arrows3D(origins=[tail], vectors=[place.hit - tail], colors=[_STRIKER], radii=[0.0022]),
    )
    above = tail + np.array([0, 0, 0.16 * size])
    label = rr.Points3D([above], colors=[_STRIKER], radii=[0.0], labels=[words], show_labels=True)
    stream.log("/world/striker/label", label)
    floor = tail * np.array([1, 1, 0])
    stream.log("/world/striker/height", rr.LineStrips3D([[floor, tail]], colors=[_STRIKER], radii=[0.0004]))
    arc = tip_arc(place)
    stream.log("/world/tips", rr.LineStrips3D([arc], colors=[_PIVOT], radii=[0.0013]))
    stream.log(
        "/world/tips/head",
        rr.Arrows3D(origins=[arc[-2]], vectors=[arc[-1] - arc[-2]], colors=[_PIVOT], radii=[0.002]),
    )
    T_world_camera = np.array(strike.camera_pose)
    stream.log(
        "/world/camera", rr.Transform3D(translation=T_world_camera[:3, 3], mat3x3=T_world_camera[:3, :3])
    )
    pinhole = rr.Pinhole(
        image_from_camera=camera.K,
        resolution=[camera.width, camera.height],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=_IMAGE_PLANE_DISTANCE_M,
        color=_CAMERA,
        line_width=0.001,
    )
    stream.log("/world/camera", pinhole)
    seen = None if place.tag is None else place.body.tag_centre(place.tag)
    sight = [] if seen is None else [[T_world_camera[:3, 3], seen]]
    stream.log("/world/sight", rr.LineStrips3D(sight, colors=[_CAMERA], radii=[0.0004]))
    stream.log("/card", rr.TextDocument(card_text(card), media_type="text/markdown"))


def card_text(card: Card) -> str:
    """Text of a strike's placement card as Markdown: steps, speed, balance angle, friction needed."""
    strike = card.strike
    before = "Put it down as in the picture"
    if card.number > 1:
        before = "Put it back exactly as before" if card.repeated else card.change
    measured_sd = strike.phi_measured_sd_rad
    precision = "" if measured_sd is None else f", measured to ±{np.degrees(measured_sd):.2f}°"
    speed = strike.aim.tip_speed_m_s
    low, aim, high = speed.min, speed.target, speed.max
    phi, phi_sd = np.degrees(strike.phi_predicted_rad), np.degrees(strike.phi_predicted_sd_rad)
    steps = (card.put_down, card.on_line, card.set_striker)
    return (
        f"# {card.number}: {message(before)}\n\n"
        + "".join(f"{number}. {message(step)}\n" for number, step in enumerate(steps, 1))
        + f"\n**{aim:.2f} m/s** ({low:.2f} to {high:.2f}); "
        f"tips over at **{phi:.0f}° ± {phi_sd:.0f}°**{precision}; "
        f"needs friction µ of {strike.aim.friction_needed:.2f} or more.\n\n"
        f"strike {as_written(strike.id)}, {as_written(f'{card.edge_name} ({strike.axis_id})')}\n"
    )


def _layout(model: ObjectModel) -> rrb.Blueprint:
    size = float(model.extent.max())
    # The eye is behind the camera and to its right, so that camera, object and striker are in view.
    eye, target = (1.9 * size, -0.35 - 1.3 * size, 0.08 + 1.1 * size), (-0.1 * size, -0.14, 0.3 * size)
    return without_panels(
        rrb.Horizontal(
            scene_view("/world", "Placement", eye, target),
            rrb.TextDocumentView(origin="/card", name="Card"),
            column_shares=[2.2, 1],
        ),
        rrb.TimePanel(timeline=STRIKE, state="collapsed", play_state="paused"),
    )
