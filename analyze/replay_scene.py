"""Writes a replay's entities: pictures, scene, curves, phases, events.

Two timelines: `since_contact`, on which all strikes start together, and `session`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
import rerun as rr

from analyze import replay_views as views
from analyze.geometry.rotations import wxyz_from_matrix
from analyze.sections import section_of
from schemas import topics
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from analyze.recording import Recording
    from analyze.replay_views import ReplayContent
    from analyze.types import Array, EquiPlane, IntArray, MarkerTrack, TipMotion

SINCE_CONTACT, SESSION = "since_contact", "session"
_BLUE, _ORANGE, _GREEN, _RED, _PURPLE, _SKY = (
    (86, 160, 230),
    (240, 170, 40),
    (60, 190, 140),
    (230, 100, 40),
    (215, 130, 180),
    (120, 200, 240),
)
CYCLE = (_BLUE, _ORANGE, _GREEN, _PURPLE, _SKY, _RED)
"""colour-blind safe (Okabe & Ito 2008), lightened for a dark ground"""
_BRIGHT = (255, 64, 54)
_REGION_COLOURS = (_ORANGE, _SKY)
_PHASES = {"rest": 0x5A6470FF, "strike": 0xE6642CFF, "stage_one": 0x3D8FDDFF, "stage_two": 0x2FA97BFF, "landing": 0xC878A8FF}
_FRAME_RATE = 60.0
_QUALITY = 82
_LOWEST_DOT = 0.004
"""m: a smaller ellipsoid could not be seen"""


def strike_path(strike_id: str) -> str:
    """Root of a strike's entities."""
    return rr.new_entity_path(["strike", strike_id])


class Scene:
    """Writes one recording's replay to a stream."""

    def __init__(self, stream: rr.RecordingStream, recording: Recording, content: ReplayContent) -> None:
        self._stream, self._recording, self._content = stream, recording, content
        starts = [record.window_start_ns for record in recording.strikes]
        self._origin_ns = min(starts) if starts else 0

    def write(self) -> None:
        """Everything."""
        self._stream.log(
            "/summary", rr.TextDocument(views.summary(self._content.result, self._recording.path), media_type="text/markdown"), static=True
        )
        self._body("/result", self._content.planes)
        self._stream.log("/result", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        records = {record.strike_id: record for record in self._recording.strikes}
        for number, motion in enumerate(self._content.motions):
            record = records.get(motion.strike_id)
            if record is not None:
                self._strike(motion, record, CYCLE[number % len(CYCLE)])
        self._events()

    def _strike(self, motion: TipMotion, record: pb.StrikeRecord, colour: tuple[int, int, int]) -> None:
        root = strike_path(motion.strike_id)
        contact = record.contact_time_ns or record.window_start_ns
        self._pictures(f"{root}/camera", record, contact, self._content.tracks.get(motion.strike_id, ()))
        self._stream.log(f"{root}/text", rr.TextDocument(views.strike_text(motion), media_type="text/markdown"), static=True)
        if motion.angle is None or len(motion.angle.time_ns) == 0:
            return
        self._curves(motion, root, contact, colour)
        self._world(motion, root, contact)

    # --- pictures -------------------------------------------------------------------------------------------------

    def _pictures(self, root: str, record: pb.StrikeRecord, contact_ns: int, tracks: tuple[MarkerTrack, ...]) -> None:
        shown_ns = -(1 << 62)
        for frame in self._recording.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns):
            if frame.time_ns - shown_ns < 0.9e9 / _FRAME_RATE:
                continue
            shown_ns = frame.time_ns
            done, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
            if not done:
                continue
            self._at(frame.time_ns, contact_ns)
            self._stream.log(f"{root}/image", rr.EncodedImage(contents=jpeg.tobytes(), media_type="image/jpeg"))
            seen = _rows_at(tracks, frame.time_ns)
            # rerun's pixels begin at their corner, ours are centred on integers
            outlines = [np.vstack([track.corners_px[i], track.corners_px[i, :1]]) + 0.5 for track, i in seen]
            self._stream.log(f"{root}/tags", rr.LineStrips2D(outlines, colors=[_GREEN], radii=[-1.5]))
            self._stream.log(f"{root}/corners", rr.Points2D([line[0] for line in outlines], colors=[_RED], radii=[-3.0]))

    # --- curves ---------------------------------------------------------------------------------------------------

    def _curves(self, motion: TipMotion, root: str, contact_ns: int, colour: tuple[int, int, int]) -> None:
        angle = motion.angle
        assert angle is not None  # noqa: S101 - the caller looked
        measured = views.curves(angle)
        for name, values in (("theta", measured.theta), ("omega", measured.omega)):
            self._series(f"{root}/{name}/measured", measured.time_ns, contact_ns, np.degrees(values))
            self._stream.log(
                f"{root}/{name}/measured", rr.SeriesPoints(colors=[_ORANGE], names=["measured"], marker_sizes=[2.2]), static=True
            )
        self._series(rr.new_entity_path(["all", motion.strike_id]), measured.time_ns, contact_ns, np.degrees(measured.theta))
        self._stream.log(
            rr.new_entity_path(["all", motion.strike_id]),
            rr.SeriesLines(colors=[colour], names=[motion.strike_id], widths=[1.5]),
            static=True,
        )
        fitted = None if motion.fit is None else views.fitted_curves(angle, motion.fit)
        if motion.fit is not None and fitted is not None:
            for name, values in (("theta", fitted.theta), ("omega", fitted.omega)):
                self._series(f"{root}/{name}/fitted", fitted.time_ns, contact_ns, np.degrees(values))
                self._stream.log(f"{root}/{name}/fitted", rr.SeriesLines(colors=[_SKY], names=["fitted"], widths=[2.0]), static=True)
            self._series(f"{root}/residual", fitted.time_ns, contact_ns, np.degrees(fitted.residual))
            self._stream.log(f"{root}/residual", rr.SeriesPoints(colors=[_PURPLE], names=["residual"], marker_sizes=[2.0]), static=True)
            ends = measured.time_ns[[0, -1]]
            self._series(f"{root}/theta/phi", ends, contact_ns, np.degrees(np.full(2, motion.fit.phi)))
            self._stream.log(f"{root}/theta/phi", rr.SeriesLines(colors=[_GREEN], names=["φ: c above the edge"], widths=[1.0]), static=True)
        if motion.phases is None:
            return
        lane = f"{root}/phases"
        self._stream.log(
            lane,
            rr.StateConfiguration(values=list(_PHASES), labels=[name.replace("_", " ") for name in _PHASES], colors=list(_PHASES.values())),
            static=True,
        )
        for name, first, last in views.spans(motion.phases):
            self._at(int(angle.time_ns[first]), contact_ns)
            self._stream.log(lane, rr.StateChange(state=name))
            if last >= len(angle.time_ns):
                continue
            self._at(int(angle.time_ns[last]), contact_ns)
            self._stream.log(lane, rr.StateChange.from_fields(clear_unset=True))

    def _series(self, path: str, time_ns: IntArray, contact_ns: int, values: Array) -> None:
        self._stream.send_columns(path, indexes=self._columns(time_ns, contact_ns), columns=rr.Scalars.columns(scalars=values))

    # --- scene ----------------------------------------------------------------------------------------------------

    def _world(self, motion: TipMotion, root: str, contact_ns: int) -> None:
        planned, angle = self._content.planned(motion), motion.angle
        if planned is None or angle is None:
            return
        world, body = f"{root}/world", f"{root}/world/object"
        self._stream.log(world, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        table = rr.Boxes3D(centers=[[0.02, 0.0, -0.003]], half_sizes=[[0.2, 0.1, 0.0029]], colors=[(96, 82, 66)], fill_mode="solid")
        self._stream.log(f"{world}/table", table, static=True)
        R, p = views.object_poses(planned, angle, section_of(self._content.model, planned))
        quaternion = wxyz_from_matrix(R)[:, [1, 2, 3, 0]]
        self._stream.send_columns(
            body, indexes=self._columns(angle.time_ns, contact_ns), columns=rr.Transform3D.columns(translation=p, quaternion=quaternion)
        )
        own = tuple(plane for plane in self._content.planes if plane.strike_id == motion.strike_id)
        self._body(body, own)
        pivot = np.array(planned.R_world_object) @ np.array(planned.pivot.point) + np.array(planned.p_world_object)
        half = 0.75 * float(np.ptp(self._content.model.vertices @ np.array(planned.pivot.direction)))
        ends = pivot + np.outer([-half, half], [0.0, 1.0, 0.0])
        self._stream.log(f"{world}/pivot", rr.LineStrips3D([ends], colors=[_RED], radii=[0.0012]), static=True)
        if self._content.com is None:
            return
        path = R @ self._content.com.position + p
        self._stream.log(f"{world}/path_of_c", rr.LineStrips3D([path], colors=[_ORANGE], radii=[0.0006]), static=True)
        over = np.array([pivot, pivot + np.array([0.0, 0.0, 1.15 * float(path[:, 2].max())])])
        self._stream.log(f"{world}/plumb", rr.LineStrips3D([over], colors=[(170, 178, 190)], radii=[0.0004]), static=True)

    def _body(self, root: str, planes: tuple[EquiPlane, ...]) -> None:
        """Object, equi-planes, centre of mass and regions in O; never changes."""
        model, com = self._content.model, self._content.com
        corners = model.vertices[model.faces].reshape(-1, 3)
        normals = np.repeat(np.cross(corners[1::3] - corners[::3], corners[2::3] - corners[::3]), 3, axis=0)
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        mesh = rr.Mesh3D(
            vertex_positions=corners,
            triangle_indices=np.arange(len(corners)).reshape(-1, 3),
            vertex_normals=normals,
            albedo_factor=(190, 200, 215, 45),
        )
        self._stream.log(f"{root}/shape", mesh, static=True)
        self._stream.log(
            f"{root}/edges",
            rr.LineStrips3D(_sharp_edges(model.vertices, model.faces), colors=[(175, 185, 200)], radii=[0.0004]),
            static=True,
        )
        for number, plane in enumerate(planes):
            cut = views.section(model, plane.point, plane.normal)
            if len(cut) == 0:
                continue
            colour = CYCLE[number % len(CYCLE)]
            quad = rr.Mesh3D(vertex_positions=cut, triangle_indices=views.fan(cut), albedo_factor=(*colour, 42))
            self._stream.log(
                f"{root}/planes{rr.new_entity_path([plane.strike_id])}",
                quad,
                rr.LineStrips3D([np.vstack([cut, cut[:1]])], colors=[colour], radii=[0.0004]),
                static=True,
            )
        if com is not None:
            half, axes = views.ellipsoid(com.covariance, _LOWEST_DOT)
            ball = rr.Ellipsoids3D(
                centers=[com.position],
                half_sizes=[half],
                quaternions=[wxyz_from_matrix(axes)[[1, 2, 3, 0]]],
                colors=[_BRIGHT],
                fill_mode="solid",
            )
            self._stream.log(f"{root}/centre_of_mass", ball, static=True)
        # the first region is the wall: the shape itself shows it
        for region, colour in zip(self._content.regions[1:], _REGION_COLOURS, strict=False):
            self._stream.log(
                f"{root}/regions{rr.new_entity_path([region.name])}",
                rr.Points3D(region.points, colors=[colour], radii=[0.0007]),
                static=True,
            )

    # --- events ---------------------------------------------------------------------------------------------------

    def _events(self) -> None:
        contacts = [(r.window_start_ns, r.window_end_ns, r.contact_time_ns or r.window_start_ns) for r in self._recording.strikes]
        for message, event in self._recording.decoded(topics.STRIKER_EVENT.name, pb.StrikerEvent):
            text = f"{pb.StrikerEvent.Kind.Name(event.kind).lower()} {event.strike_id} {event.text}".strip()
            if event.tip_speed_m_s:
                text += f" at {event.tip_speed_m_s:.3f} m/s"
            self._note("/log/striker", message.log_time_ns, text, contacts)
        for message, state in self._recording.decoded(topics.SESSION_STATE.name, pb.SessionState):
            text = f"{pb.SessionState.State.Name(state.state).lower().replace('_', ' ')} {state.strike_id} {state.text}".strip()
            self._note("/log/session", message.log_time_ns, text, contacts)
        for message, line in self._recording.decoded(topics.LOG.name, topics.LOG.message):
            self._note("/log/text", message.log_time_ns, str(getattr(line, "message", "")), contacts)

    def _note(self, path: str, time_ns: int, text: str, contacts: list[tuple[int, int, int]]) -> None:
        self._stream.reset_time()
        self._stream.set_time(SESSION, duration=(time_ns - self._origin_ns) * 1e-9)
        inside = next((contact for start, end, contact in contacts if start <= time_ns <= end), None)
        if inside is not None:
            self._stream.set_time(SINCE_CONTACT, duration=(time_ns - inside) * 1e-9)
        self._stream.log(path, rr.TextLog(text, level=rr.TextLogLevel.INFO))

    # --- time -----------------------------------------------------------------------------------------------------

    def _at(self, time_ns: int, contact_ns: int) -> None:
        self._stream.set_time(SINCE_CONTACT, duration=(time_ns - contact_ns) * 1e-9)
        self._stream.set_time(SESSION, duration=(time_ns - self._origin_ns) * 1e-9)

    def _columns(self, time_ns: IntArray, contact_ns: int) -> list[rr.TimeColumn]:
        return [
            rr.TimeColumn(SINCE_CONTACT, duration=(time_ns - contact_ns) * 1e-9),
            rr.TimeColumn(SESSION, duration=(time_ns - self._origin_ns) * 1e-9),
        ]


def _rows_at(tracks: tuple[MarkerTrack, ...], time_ns: int) -> list[tuple[MarkerTrack, int]]:
    found = [(track, int(np.searchsorted(track.time_ns, time_ns))) for track in tracks]
    return [(track, i) for track, i in found if i < len(track.time_ns) and track.time_ns[i] == time_ns]


def _sharp_edges(vertices: Array, faces: IntArray) -> list[Array]:
    """Edges (2, 3) between faces that meet at more than 20 degrees."""
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    owner = {(int(face[i]), int(face[(i + 1) % 3])): f for f, face in enumerate(faces) for i in range(3)}
    found = []
    for (a, b), f in owner.items():
        across = owner.get((b, a))
        if a < b and (across is None or normal[f] @ normal[across] < np.cos(np.radians(20.0))):
            found.append(vertices[[a, b]])
    return found
