"""A ten-minute session of a gigabyte, made of the sample's four strikes and idle frames between them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acquire.recorder.image import RawImageEncoder
from analyze.reading.recording import Recording, open_recording
from schemas import topics
from schemas.document import canonical_json
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from tests.mcap_writer import McapWriter
from tests.places import FIRST_SAMPLE

STRIKES, SECONDS = 10, 600
LAST_STRIKE = "s2.3"
_PERIOD_NS = 8_333_333
_BEFORE, _AFTER = 110, 64
"""numbers of frames at rest that are added before and after the sample's frames"""
_NOISE = 1.5
"""noise [grey levels, 1 sigma] that distinguishes repeated frames"""


def make_long_session(path: Path) -> None:
    """Write the session, with one strike a minute."""
    rng = np.random.default_rng(1)
    noise = np.rint(rng.normal(0.0, _NOISE, (16, 492, 656))).astype(np.int16)
    with open_recording(FIRST_SAMPLE) as sample, McapWriter(path) as writer:
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(sample.manifest)))
        for name, data in sample.attachments.items():
            writer.attachment(name, "application/octet-stream", data)
        names = (
            topics.raw_image("main"),
            topics.frame_meta("main"),
            topics.STRIKER_EVENT,
            topics.CLOCK_SAMPLE,
            topics.SESSION_STRIKE,
        )
        images, metas, events, clocks, strikes = (writer.add_topic(topic) for topic in names)
        start = sample.strikes[0].window_start_ns
        encoder = RawImageEncoder("camera", 656, 492)
        written = 0

        def frame(time_ns: int, image: np.ndarray) -> None:
            nonlocal written
            noisy = np.clip(image.astype(np.int16) + noise[written % len(noise)], 0, 255).astype(np.uint8)
            meta = pb.FrameMeta(
                sequence=written,
                mid_exposure_host_ns=time_ns - start + 1,
                image_recorded=True,
                mapping_sd_ns=20_000,
            )
            writer.write(images, time_ns, encoder.encode(time_ns, noisy), sequence=written)
            writer.write(metas, time_ns, meta.SerializeToString(), sequence=written)
            written += 1

        for number in range(STRIKES):
            record = sample.strikes[number % len(sample.strikes)]
            found = list(sample.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns))
            begins = start + number * (SECONDS // STRIKES) * 1_000_000_000
            for second in range(SECONDS // STRIKES - 4):
                now = begins + second * 1_000_000_000
                for half in (0, 500_000_000):
                    writer.write(clocks, now + half, _clock(now + half - start))
                frame(now, found[0].image)
            shift = begins + 57_000_000_000 - record.window_start_ns
            for before in range(_BEFORE, 0, -1):
                frame(found[0].time_ns + shift - before * _PERIOD_NS, found[0].image)
            for each in found:
                frame(each.time_ns + shift, each.image)
            for after in range(1, _AFTER):
                frame(found[-1].time_ns + shift + after * _PERIOD_NS, found[-1].image)
            _copy_events(sample, record, writer, events, shift)
            record.strike_id = f"{record.plan_strike_id}.{1 + number // len(sample.strikes)}"
            record.window_start_ns += shift - _BEFORE * _PERIOD_NS
            record.window_end_ns += shift + (_AFTER - 1) * _PERIOD_NS
            record.contact_time_ns += shift
            writer.write(strikes, record.window_end_ns, record.SerializeToString())
            record.window_start_ns -= shift - _BEFORE * _PERIOD_NS
            record.window_end_ns -= shift + (_AFTER - 1) * _PERIOD_NS
            record.contact_time_ns -= shift


def _copy_events(
    sample: Recording, record: pb.StrikeRecord, writer: McapWriter, channel: object, shift: int
) -> None:
    for message in sample.messages(topics.STRIKER_EVENT.name, record.window_start_ns, record.window_end_ns):
        data = bytes(message.data)
        writer.write(channel, message.log_time_ns + shift, data)  # pyright: ignore[reportArgumentType]


def _clock(host_ns: int) -> bytes:
    sample = pb.ClockSample(
        clock="camera/main",
        device_time_ns=host_ns,
        host_before_ns=host_ns - 50_000,
        host_after_ns=host_ns + 50_000,
    )
    return sample.SerializeToString()
