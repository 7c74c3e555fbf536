"""Maker of the small sample recording in the repository.

`python tests/make_sample.py SESSION.mcap recordings/sample-1.0.mcap`

Takes a demo session, keeps the frames around each good strike, and stores them as PNG. Around the markers
every pixel is as it was recorded, noise included; the rest of each image is smoothed and cut to a few grey
levels, which PNG packs to a tenth. All other topics stay as they are, but for what lies outside the kept
windows.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from google.protobuf.timestamp_pb2 import Timestamp

from acquire.recorder.recover.edit import append_topics
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from analyze.types import ImageFrame
from schemas import topics
from schemas.document import canonical_json
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from schemas.strike_result import Verdict
from tests.mcap_writer import McapWriter

BEFORE_NS, AFTER_NS = 120_000_000, 620_000_000
MARGIN_PX = 14
SMALL = [topics.STRIKER_EVENT, topics.CLOCK_SAMPLE, topics.SESSION_STATE, topics.LOG]


def main(source: Path, target: Path) -> None:
    """Write the sample recording `target`, a shortened copy of the recording `source`."""
    target.unlink(missing_ok=True)
    with open_recording(source) as recording, McapWriter(target) as writer:
        camera = recording.camera
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(recording.manifest)))
        for name, data in recording.attachments.items():
            writer.attachment(name, "application/octet-stream", data)
        kept = [r for r in recording.strikes if r.verdict_code == Verdict.GOOD.value]
        spans = [
            (
                max(r.window_start_ns, r.contact_time_ns - BEFORE_NS),
                min(r.window_end_ns, r.contact_time_ns + AFTER_NS),
            )
            for r in kept
        ]

        image_channel = writer.add_topic(topics.compressed_image(camera))
        meta_channel = writer.add_topic(topics.frame_meta(camera))
        for start, end in spans:
            frames = list(recording.images(camera, start, end))
            metas = {meta.sequence: meta for meta in recording.frame_meta(camera, start, end)}
            for frame in frames:
                packed = _packed(camera, frame)
                writer.write(image_channel, frame.time_ns, packed, sequence=frame.sequence)
                writer.write(
                    meta_channel,
                    frame.time_ns,
                    metas[frame.sequence].SerializeToString(),
                    sequence=frame.sequence,
                )
        for topic in [topics.camera_calibration(camera), *SMALL]:
            channel = writer.add_topic(topic)
            for message in recording.messages(topic.name):
                writer.write(channel, message.log_time_ns, bytes(message.data))
        samples = writer.add_topic(topics.STRIKER_SAMPLE)
        for start, end in spans:
            for message in recording.messages(topics.STRIKER_SAMPLE.name, start, end):
                writer.write(samples, message.log_time_ns, bytes(message.data))
        strikes = writer.add_topic(topics.SESSION_STRIKE)
        for record, (start, end) in zip(kept, spans, strict=True):
            record.window_start_ns, record.window_end_ns = start, end
            writer.write(strikes, end, record.SerializeToString())
    append_topics(target, _truth(source, spans))


def _truth(source: Path, spans: list[tuple[int, int]]) -> Iterator[tuple[topics.Topic, int, bytes]]:
    truth = read_truth(source)
    yield topics.TRUTH_BODY, spans[0][0], truth.body.SerializeToString()
    for topic, times, messages in (
        (topics.TRUTH_POSE, truth.pose_time_ns, truth.poses),
        (topics.TRUTH_CONTACT, truth.contact_time_ns, truth.contacts),
    ):
        for time_ns, message in zip(times.tolist(), messages, strict=True):
            if any(start <= time_ns <= end for start, end in spans):
                yield topic, time_ns, message.SerializeToString()


def _packed(camera: str, frame: ImageFrame) -> bytes:
    """PNG of a frame as a message, with settings for a small file; the recorder's own are for speed."""
    done, data = cv2.imencode(".png", _simplified(frame.image), (cv2.IMWRITE_PNG_COMPRESSION, 9))
    assert done
    stamp = Timestamp(seconds=frame.time_ns // 10**9, nanos=frame.time_ns % 10**9)
    return CompressedImage(
        timestamp=stamp, frame_id=camera, data=data.tobytes(), format="png"
    ).SerializeToString()


def _simplified(image: np.ndarray) -> np.ndarray:
    background = (
        (np.round(cv2.GaussianBlur(image.astype(np.float32), (0, 0), 2.5) / 12) * 12)
        .clip(0, 255)
        .astype(np.uint8)
    )
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11))
    corners, ids, _ = detector.detectMarkers(image)
    mask = np.zeros(image.shape, np.uint8)
    for quad in corners if ids is not None else []:
        cv2.fillConvexPoly(mask, np.round(quad[0]).astype(np.int32), 255)
    size = 2 * MARGIN_PX + 1
    return np.where(cv2.dilate(mask, np.ones((size, size), np.uint8)) > 0, image, background)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
