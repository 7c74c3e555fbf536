"""Recordings of whole simulated sessions, made fast, for tests of archives of many recordings.

The object tips as a pendulum (Runge-Kutta); the images show one tag on grey. A recording has the form that
the recorder gives it, with PNG images, and a few megabytes. Not modelled: slip, the arm, lens distortion,
noise, other tags than the one that faces the camera.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.timestamp_pb2 import Timestamp

from acquire.recorder.image import RawImageEncoder, png_message
from acquire.virtual.station import Station, station
from analyze.replay.views import object_poses
from analyze.types import TipAngle
from schemas import topics
from schemas.document import canonical_json
from schemas.object_spec import MarkerSpec, ObjectSpec, object_sha256
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME, PLAN_ATTACHMENT, CameraCalibrationSpec, manifest_entries
from schemas.strike_plan import PlannedStrike, StrikePlan
from tests.analyze.estimation.bodies import SIX_AXES, Body, box_body, planned_strike, tip
from tests.analyze.simulated_session import manifest, object_spec, tipping
from tests.mcap_writer import McapWriter

WIDTH, HEIGHT = 656, 492
ANCHOR_NS = 1_780_000_000_000_000_000
PERIOD_NS = 8_333_333
TAG_M = 0.03
DETAIL = 4
"""sub-pixels per pixel, along each axis, over which a drawn tag is averaged"""
SHAPES = ((0.08, 0.06, 0.15), (0.07, 0.05, 0.12), (0.09, 0.07, 0.13))
FIRST, AFTER = 15, 8
"""frame with which a window begins (the strike is at frame 29), and number of frames after the landing"""


@dataclass(frozen=True)
class QuickSession:
    """True mass properties of the object in one recording."""

    path: Path
    com: np.ndarray
    """(3,) centre of mass in O [m]"""
    mass: float


def body_of(number: int) -> Body:
    """Body of the object of one kind; the same at every call."""
    rng = np.random.default_rng((77, number))
    normal = rng.normal(size=3)
    return box_body(
        SHAPES[number % len(SHAPES)],
        (0.03, *rng.uniform(0.004, 0.02, 2)),
        0.005,
        tuple(normal / np.linalg.norm(normal)),
        1e-4,
    )


def quick_session(
    path: Path, body: Body, number: int, strikes: int = 4, *, packed: bool = False, raw: bool = False
) -> QuickSession:
    """Write a recording of a simulated session, and return the object's true mass properties.

    Args:
        path: recording to write.
        body: object that is struck.
        number: number of the session, from which follow its time, its identity and its placement noise.
        strikes: number of strikes, about the axes on which the tag stays in view, in turn.
        packed: True for PNG whose runs of one grey are packed, not as the recorder writes it: a tenth of the
            size, a third of the time.
        raw: True for images as the recorder keeps them by default.
    """
    rng = np.random.default_rng((78, number))
    lens = station(1)
    spec = _with_tags(object_spec(body), body)
    possible = [_seen(planned_strike(body, *axis), spec, lens) for axis in SIX_AXES]
    kept = [strike for strike in possible if _in_view(strike, spec, body, lens)]
    planned = [kept[i % len(kept)].model_copy(update={"id": f"s{i + 1}"}) for i in range(strikes)]
    sha256 = object_sha256(spec, None)
    plan = canonical_json(StrikePlan(object_name=spec.name, object_sha256=sha256, strikes=planned)).encode()
    known = manifest(spec)
    camera = known.cameras[0].model_copy(
        update={
            "calibration": CameraCalibrationSpec(
                width=WIDTH, height=HEIGHT, K=lens.K.tolist(), T_world_camera=lens.T_world_camera.tolist()
            )
        }
    )
    day = f"2026-{1 + number // 28 % 12:02d}-{1 + number % 28:02d}T{8 + number // 336 % 12:02d}:00:00+00:00"
    known = known.model_copy(
        update={
            "recording_id": f"quick-{number}",
            "created": day,
            "cameras": [camera],
            "wall_anchor_ns": ANCHOR_NS,
            "plan_sha256": hashlib.sha256(plan).hexdigest(),
            "hashes": {PLAN_ATTACHMENT: hashlib.sha256(plan).hexdigest()},
        }
    )
    with McapWriter(path) as writer:
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(known)))
        writer.attachment(PLAN_ATTACHMENT, "application/json", plan)
        encode = _raw if raw else _packed if packed else png_message
        topic = (topics.raw_image if raw else topics.compressed_image)("main")
        _write_strikes(writer, planned, spec, body, lens, rng, (topic, encode))
        writer.finish()
    return QuickSession(path, body.com, body.mass)


def _write_strikes(
    writer: McapWriter,
    planned: list[PlannedStrike],
    spec: ObjectSpec,
    body: Body,
    lens: Station,
    rng: np.random.Generator,
    coding: tuple[topics.Topic, Callable[[str, int, np.ndarray], bytes]],
) -> None:
    topic, encode = coding
    images, metas = writer.add_topic(topic), writer.add_topic(topics.frame_meta("main"))
    clock, records = writer.add_topic(topics.CLOCK_SAMPLE), writer.add_topic(topics.SESSION_STRIKE)
    sequence = 0
    for number, strike in enumerate(planned):
        start_ns = ANCHOR_NS + 1_000_000_000 + 4_000_000_000 * number
        writer.write(clock, start_ns, clock_sample(start_ns - ANCHOR_NS), sequence=number)
        truth, _ = tipping(*tip(body, strike), energy=float(rng.uniform(1.05, 1.3)))
        theta = np.array(truth[FIRST:] + [truth[-1]] * AFTER)
        n = len(theta)
        time_ns = start_ns + PERIOD_NS * np.arange(n)
        angle = TipAngle(time_ns, theta, np.zeros(n), np.zeros(n), np.zeros(n))
        for at, (R, p) in zip(time_ns, zip(*object_poses(strike, angle), strict=True), strict=True):
            picture = _picture(spec.marker[int(strike.visible_markers[0])], R, p, lens)
            writer.write(images, int(at), encode("main", int(at), picture), sequence=sequence)
            writer.write(metas, int(at), frame_meta(sequence, int(at) - ANCHOR_NS), sequence=sequence)
            sequence += 1
        record = pb.StrikeRecord(
            strike_id=f"{strike.id}.1",
            plan_strike_id=strike.id,
            attempt=1,
            window_start_ns=int(time_ns[0]),
            window_end_ns=int(time_ns[-1]),
            contact_time_ns=int(time_ns[29 - FIRST]),
        )
        writer.write(records, int(time_ns[-1]), record.SerializeToString())


def clock_sample(host_ns: int) -> bytes:
    """Reading of a camera's clock that runs as the host's does, at a host time [ns]."""
    sample = pb.ClockSample(
        clock="camera/main",
        device_time_ns=host_ns,
        host_before_ns=host_ns - 50_000,
        host_after_ns=host_ns + 50_000,
    )
    return sample.SerializeToString()


def frame_meta(sequence: int, host_ns: int) -> bytes:
    """Metadata of a recorded frame, with the host time of its mid-exposure [ns]."""
    meta = pb.FrameMeta(
        sequence=sequence, mid_exposure_host_ns=host_ns, image_recorded=True, mapping_sd_ns=20_000
    )
    return meta.SerializeToString()


def _with_tags(spec: ObjectSpec, body: Body) -> ObjectSpec:
    """Object file with a tag in the middle of each side, ids 0 to 5."""
    markers: list[MarkerSpec] = []
    for face in range(3):
        for sign in (1.0, -1.0):
            T = np.eye(4)
            T[:3, 2] = sign * np.eye(3)[face]
            T[:3, 1] = np.eye(3)[2 if face != 2 else 1]
            T[:3, 0] = np.cross(T[:3, 1], T[:3, 2])
            T[face, 3] = sign * body.size[face] / 2
            markers.append(MarkerSpec(id=len(markers), size_m=TAG_M, T_object_marker=T.tolist()))
    return spec.model_copy(
        update={
            "name": f"quick box {'x'.join(f'{1000 * each:.0f}' for each in body.size)}",
            "marker": markers,
        }
    )


def _seen(strike: PlannedStrike, spec: ObjectSpec, lens: Station) -> PlannedStrike:
    """Planned strike with the tag that faces the camera as its visible marker."""
    R = np.array(strike.R_world_object)
    towards = [
        float((R @ np.array(marker.T_object_marker)[:3, 2]) @ -lens.T_world_camera[:3, 2])
        for marker in spec.marker
    ]
    return strike.model_copy(update={"visible_markers": [int(np.argmax(towards))]})


def _in_view(strike: PlannedStrike, spec: ObjectSpec, body: Body, lens: Station) -> bool:
    """True if the tag is in the image both at rest and past the balance angle."""
    theta = np.array([0.0, tip(body, strike)[0] + 0.2])
    angle = TipAngle(np.zeros(2, np.int64), theta, np.zeros(2), np.zeros(2), np.zeros(2))
    marker = spec.marker[int(strike.visible_markers[0])]
    pixels = np.array(
        [_corners(marker, R, p, lens, TAG_M / 2) for R, p in zip(*object_poses(strike, angle), strict=True)]
    )
    return bool(np.all(pixels > 6) and np.all(pixels < np.array([WIDTH - 7, HEIGHT - 7])))


def _corners(marker: MarkerSpec, R: np.ndarray, p: np.ndarray, lens: Station, half: float) -> np.ndarray:
    """Corners (4, 2) [px] of a square of half edge `half` [m] around a tag's centre, from the top left."""
    T = np.array(marker.T_object_marker)
    square = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
    world = (square @ T[:3, :3].T + T[:3, 3]) @ R.T + p
    camera = (world - lens.T_world_camera[:3, 3]) @ lens.T_world_camera[:3, :3]
    return camera[:, :2] / camera[:, 2:] * np.diag(lens.K)[:2] + lens.K[:2, 2]


def _picture(marker: MarkerSpec, R: np.ndarray, p: np.ndarray, lens: Station) -> np.ndarray:
    """Image (HEIGHT, WIDTH), uint8, of the tag with a white rim on grey."""
    code = _code(int(marker.id))
    cells = len(code)
    # The picture of the code has a rim one cell wide: the tag's edge is the black border's outer one.
    pixels = _corners(marker, R, p, lens, TAG_M / 2 * cells / (cells - 2))
    low = np.floor(pixels.min(axis=0)).astype(int) - 3
    size = np.ceil(pixels.max(axis=0)).astype(int) + 4 - low
    # Pixels are centred on integers, and so are their DETAIL x DETAIL parts.
    fine = DETAIL * (pixels - low + 0.5) - 0.5
    corners = np.array([[0, 0], [cells, 0], [cells, cells], [0, cells]], dtype=np.float64) * 16 - 0.5
    homography = cv2.getPerspectiveTransform(corners.astype(np.float32), fine.astype(np.float32))
    large = cv2.warpPerspective(
        code.repeat(16, 0).repeat(16, 1),
        homography,
        (int(DETAIL * size[0]), int(DETAIL * size[1])),
        borderValue=90,
    )
    small = cv2.resize(large, (int(size[0]), int(size[1])), interpolation=cv2.INTER_AREA)
    image = np.full((HEIGHT, WIDTH), 90, np.uint8)
    x, y = np.maximum(low, 0), np.minimum(low + size, (WIDTH, HEIGHT))
    image[x[1] : y[1], x[0] : y[0]] = small[x[1] - low[1] : y[1] - low[1], x[0] - low[0] : y[0] - low[0]]
    return image


def _raw(camera: str, time_ns: int, image: np.ndarray) -> bytes:
    return b"".join(RawImageEncoder(camera, WIDTH, HEIGHT).encode(time_ns, image))


def _packed(camera: str, log_time_ns: int, image: np.ndarray) -> bytes:
    _, data = cv2.imencode(".png", image, (cv2.IMWRITE_PNG_COMPRESSION, 1))
    stamp = Timestamp(seconds=log_time_ns // 10**9, nanos=log_time_ns % 10**9)
    return CompressedImage(
        timestamp=stamp, frame_id=camera, data=data.tobytes(), format="png"
    ).SerializeToString()


@cache
def _code(marker_id: int) -> np.ndarray:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    inner = cv2.aruco.generateImageMarker(dictionary, marker_id, dictionary.markerSize + 2)
    return np.pad(np.where(inner > 127, 225, 25).astype(np.uint8), 1, constant_values=225)
