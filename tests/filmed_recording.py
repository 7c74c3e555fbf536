"""Recordings of sessions on the virtual rig without a wall clock, with raw images as the recorder keeps them.

The rig's physics strikes the object, and its renderer films it with the camera's noise. Not in it: striker,
second clock, lost frames, previews.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from acquire.recorder.image import RawImageEncoder
from acquire.virtual.station import G_M_S2
from acquire.virtual.world import World
from schemas import topics
from schemas.document import canonical_json
from schemas.object_spec import object_sha256
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import (
    MANIFEST_NAME,
    PLAN_ATTACHMENT,
    SHAPE_ATTACHMENT_PREFIX,
    CameraCalibrationSpec,
    manifest_entries,
)
from tests.analyze.simulated_session import manifest
from tests.benchmarks.honesty.observed import T0
from tests.benchmarks.print_sessions import SHIFT_SD, YAW_SD, chosen, renderer_of, scene
from tests.benchmarks.print_strikes import Filming, Placement, film, struck
from tests.mcap_writer import McapWriter
from tests.quick_archive import ANCHOR_NS, clock_sample, frame_meta

APART_NS = 6_000_000_000


def filmed_recording(path: Path, name: str, seed: int, strikes: int, road: str = "tags") -> None:
    """Write a recording of a session.

    Args:
        path: recording to write.
        name: object of the virtual rig.
        seed: seed of the object, its placements and the noise.
        strikes: number of strikes.
        road: "tags", or the print of faces without tags (`print_sessions.ROADS`).
    """
    rng = np.random.default_rng((seed, 0xF11, *name.encode()))
    on = scene(name, seed, False, rng)
    shape = on.thing.shape_file
    spec = on.spec if road == "tags" else on.spec.model_copy(update={"marker": []})
    sha256 = object_sha256(spec, None if shape is None else shape[1])
    planned = chosen(on.plan, strikes)
    plan = canonical_json(on.plan.model_copy(update={"object_sha256": sha256, "strikes": planned})).encode()
    attached = {PLAN_ATTACHMENT: plan}
    if shape is not None:
        attached[f"{SHAPE_ATTACHMENT_PREFIX}{shape[0]}"] = shape[1]
    known = manifest(spec)
    calibration = CameraCalibrationSpec(
        width=on.camera.width,
        height=on.camera.height,
        K=on.camera.K.tolist(),
        distortion=on.camera.distortion.tolist(),
        T_world_camera=on.camera.T_world_camera.tolist(),
        strain_sd=on.camera.strain_sd,
    )
    camera = known.cameras[0].model_copy(update={"calibration": calibration})
    known = known.model_copy(
        update={
            "recording_id": f"filmed-{name}-{seed}",
            "g_m_s2": G_M_S2,
            "cameras": [camera],
            "wall_anchor_ns": ANCHOR_NS,
            "object_sha256": sha256,
            "plan_sha256": hashlib.sha256(plan).hexdigest(),
            "hashes": {name: hashlib.sha256(data).hexdigest() for name, data in attached.items()},
        }
    )
    world = World(on.thing, lambda *_: 0.0, table_tilt=(0.0, on.tilt), arm_angle=-2.5)
    renderer = renderer_of(on, road, seed)
    encoder = RawImageEncoder("main", on.camera.width, on.camera.height)
    with McapWriter(path) as writer:
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(known)))
        for name_, data in attached.items():
            writer.attachment(name_, "application/octet-stream", data)
        images, metas = (
            writer.add_topic(topics.raw_image("main")),
            writer.add_topic(topics.frame_meta("main")),
        )
        clock, records = writer.add_topic(topics.CLOCK_SAMPLE), writer.add_topic(topics.SESSION_STRIKE)
        sequence = 0
        for number, strike in enumerate(planned):
            start = ANCHOR_NS + 1_000_000_000 + APART_NS * number
            writer.write(clock, start, clock_sample(start - ANCHOR_NS), sequence=number)
            placed = Placement(*rng.normal(0, (YAW_SD, SHIFT_SD, SHIFT_SD)))
            motion = struck(world, on.thing, strike, placed, (float(rng.uniform(1.05, 1.3)), 0.003))
            frames = film(renderer, motion, strike.heading_rad, Filming(), rng)
            times = [start + 500_000_000 + frame.time_ns - T0 for frame in frames]
            for at, frame in zip(times, frames, strict=True):
                writer.write(images, at, encoder.encode(at, frame.image), sequence=sequence)
                writer.write(metas, at, frame_meta(sequence, at - ANCHOR_NS), sequence=sequence)
                sequence += 1
            record = pb.StrikeRecord(
                strike_id=f"{strike.id}.1",
                plan_strike_id=strike.id,
                attempt=1,
                window_start_ns=times[0],
                window_end_ns=times[-1],
                contact_time_ns=start + 500_000_000,
            )
            writer.write(records, times[-1], record.SerializeToString())
        writer.finish()
