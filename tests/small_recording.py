"""Small recording with one strike, written by the recorder itself.

Every message can be computed from its number.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from acquire.recorder.image import RawImageEncoder, png_message
from acquire.recorder.seal import Seal
from schemas import topics
from schemas.document import canonical_json
from schemas.object_spec import Box, MarkerSpec, ObjectSpec, Shape
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import (
    MANIFEST_NAME,
    CameraCalibrationSpec,
    ManifestCamera,
    SessionManifest,
    TimeSource,
    manifest_entries,
)
from tests.mcap_writer import McapWriter

WIDTH, HEIGHT = 96, 64
ANCHOR_NS = 1_700_000_000_000_000_000
START_NS = ANCHOR_NS + 1_000_000_000
PERIOD_NS = 8_333_333
FRAMES = 24
SAMPLES = 200
CALIBRATION = CameraCalibrationSpec(
    width=WIDTH, height=HEIGHT, K=[[100, 0, 48], [0, 100, 32], [0, 0, 1]], T_world_camera=np.eye(4).tolist()
)
PLAN = b'{"schema_version": "1.0"}'
SHAPE = b"solid"


def image(number: int) -> np.ndarray:
    return np.random.default_rng(number).integers(0, 255, (HEIGHT, WIDTH), dtype=np.uint8)


def frame_time(number: int) -> int:
    return START_NS + number * PERIOD_NS


def hashes(plan: bytes) -> dict[str, str]:
    """Hashes of the attached files."""
    files = {"plan.json": plan, "shape/box.stl": SHAPE}
    return {name: hashlib.sha256(data).hexdigest() for name, data in files.items()}


def manifest(**changes: object) -> SessionManifest:
    spec = ObjectSpec(
        name="box",
        mass_kg=0.05,
        mass_sd_kg=1e-4,
        shape=Shape(box=Box(size_m=[0.1, 0.1, 0.1])),
        marker=[MarkerSpec(id=1, size_m=0.03)],
    )
    plain = SessionManifest(
        recording_id="r1",
        created="2024-01-01T00:00:00+00:00",
        software="test",
        wall_anchor_ns=ANCHOR_NS,
        time_source=TimeSource.DEVICE_MAPPED,
        time_source_sd_ns=30_000,
        g_m_s2=9.81,
        g_sd_m_s2=0.001,
        gravity_tilt_sd_rad=0.003,
        cameras=[
            ManifestCamera(
                name="main", frame_rate_hz=1e9 / PERIOD_NS, exposure_us=1500, calibration=CALIBRATION
            )
        ],
        object=spec,
        object_sha256="0",
        plan_sha256="0",
        hashes=hashes(PLAN),
    )
    return plain.model_copy(update=changes)


def write_head(writer: McapWriter, manifest_json: str | None = None, plan: bytes = PLAN) -> None:
    whole = manifest(hashes=hashes(plan))
    text = canonical_json(whole) if manifest_json is None else manifest_json
    writer.metadata(MANIFEST_NAME, manifest_entries(text))
    writer.attachment("plan.json", "application/json", plan)
    writer.attachment("shape/box.stl", "model/stl", SHAPE)


def write_body(
    writer: McapWriter, *, png: bool = False, missing: tuple[int, ...] = (), clocks: bool = True
) -> None:
    images = writer.add_topic(topics.compressed_image("main") if png else topics.raw_image("main"))
    metas, samples = writer.add_topic(topics.frame_meta("main")), writer.add_topic(topics.STRIKER_SAMPLE)
    clock, strikes = writer.add_topic(topics.CLOCK_SAMPLE), writer.add_topic(topics.SESSION_STRIKE)
    encoder = RawImageEncoder("camera", WIDTH, HEIGHT)
    if clocks:
        for number in range(2):
            host = frame_time(number * (FRAMES - 1)) - ANCHOR_NS
            sample = pb.ClockSample(
                clock="camera/main",
                device_time_ns=host,
                host_before_ns=host - 50_000,
                host_after_ns=host + 50_000,
            )
            writer.write(clock, ANCHOR_NS + host, sample.SerializeToString(), sequence=number)
    for number in range(FRAMES):
        time = frame_time(number)
        meta = pb.FrameMeta(
            sequence=number,
            mid_exposure_host_ns=time - ANCHOR_NS,
            host_time_ns=time - ANCHOR_NS + 2_000_000,
            mapping_sd_ns=20_000,
        )
        if number not in missing:
            meta.image_recorded = True
            data = png_message("camera", time, image(number)) if png else encoder.encode(time, image(number))
            writer.write(images, time, data, sequence=number)
        writer.write(metas, time, meta.SerializeToString(), sequence=number)
    for number in range(SAMPLES):
        writer.write(
            samples,
            START_NS + number * 1_000_000,
            pb.StrikerSample(tick_ms=number).SerializeToString(),
            sequence=number,
        )
    record = pb.StrikeRecord(
        strike_id="s1.1",
        plan_strike_id="s1",
        attempt=1,
        window_start_ns=frame_time(0),
        window_end_ns=frame_time(FRAMES - 1),
        verdict_code="good",
    )
    writer.write(strikes, frame_time(FRAMES), record.SerializeToString())


def write_toss(writer: McapWriter, toss_id: str = "t1.1") -> None:
    """Write the record of a toss whose window is the whole recording's."""
    record = pb.TossRecord(
        toss_id=toss_id,
        plan_toss_id=toss_id.partition(".")[0],
        attempt=1,
        window_start_ns=frame_time(0),
        window_end_ns=frame_time(FRAMES - 1),
    )
    topic = writer.add_topic(topics.SESSION_TOSS)
    writer.write(topic, frame_time(FRAMES), record.SerializeToString())


def write_recording(
    path: Path,
    *,
    png: bool = False,
    missing: tuple[int, ...] = (),
    clocks: bool = True,
    manifest_json: str | None = None,
    plan: bytes = PLAN,
) -> Seal:
    writer = McapWriter(path)
    write_head(writer, manifest_json, plan)
    write_body(writer, png=png, missing=missing, clocks=clocks)
    return writer.finish()
