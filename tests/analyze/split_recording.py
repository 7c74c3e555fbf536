"""Finished recordings split into several files, as if the process that wrote them had died."""

from __future__ import annotations

from pathlib import Path

from acquire.recorder.recover.edit import append_topics
from analyze.reading.indexed_file import open_finished
from analyze.reading.indexed_series import IndexedSeries
from analyze.reading.recording import open_recording
from schemas import topics
from schemas.document import canonical_json
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from schemas.topics import TRUTH_PREFIX, Topic
from tests.mcap_writer import McapWriter

KNOWN = [
    topics.camera_calibration("main"),
    topics.compressed_image("main"),
    topics.raw_image("main"),
    topics.frame_meta("main"),
    topics.STRIKER_SAMPLE,
    topics.STRIKER_EVENT,
    topics.CLOCK_SAMPLE,
    topics.SESSION_STATE,
    topics.SESSION_STRIKE,
    topics.LOG,
    topics.TRUTH_POSE,
    topics.TRUTH_CONTACT,
    topics.TRUTH_BODY,
]


def split_recording(source: Path, first: Path, at_ns: int) -> list[Path]:
    """Write messages of `source` up to a log time to `first`, the rest to `<first>-0002.mcap`.

    Returns:
        Paths of both files.
    """
    second = first.with_name(f"{first.stem}-0002{first.suffix}")
    _write(source, first, (None, at_ns), (None, at_ns), {"part": 1})
    _write(source, second, (at_ns + 1, None), (at_ns + 1, None), {"part": 2})
    return [first, second]


def as_two_sessions(source: Path, first: Path, second: Path, at_ns: int) -> None:
    """Write messages of `source` up to a log time, and the rest, as two recordings of their own.

    Both contain the true mass properties of the object.
    """
    _write(
        source,
        first,
        (None, at_ns),
        (None, at_ns),
        {"recording_id": "one", "created": "2026-01-01T10:00:00+00:00"},
    )
    _write(
        source,
        second,
        (at_ns + 1, None),
        (None, None),
        {"recording_id": "two", "created": "2026-01-01T11:00:00+00:00"},
    )


def rewritten(source: Path, path: Path, changed: dict[str, object]) -> None:
    """Write all messages of `source` with changed entries in its manifest."""
    _write(source, path, (None, None), (None, None), changed)


Span = tuple[int | None, int | None]


def _write(source: Path, path: Path, span: Span, truth_span: Span, changed: dict[str, object]) -> None:
    with open_recording(source) as recording:
        manifest, attachments = recording.manifest, recording.attachments
    row = IndexedSeries([open_finished(source)])
    here = [
        topic
        for topic in KNOWN
        if (topic.name, topic.schema_name) in {(name, row.schema_of(name)) for name in row.topic_names()}
    ]
    with McapWriter(path) as writer:
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(manifest.model_copy(update=changed))))
        for name, data in attachments.items():
            writer.attachment(name, "application/octet-stream", data)
        for topic in (topic for topic in here if not _is_truth(topic)):
            channel = writer.add_topic(topic)
            # A second session has the clock's samples of the first, which its frame times are mapped with.
            for message in row.messages(topic.name, *(truth_span if topic is topics.CLOCK_SAMPLE else span)):
                writer.write(channel, message.log_time_ns, bytes(message.data), sequence=message.sequence)
    truth = [topic for topic in here if _is_truth(topic)]
    append_topics(
        path,
        [
            (topic, m.log_time_ns, bytes(m.data))
            for topic in truth
            for m in row.messages(topic.name, *truth_span)
        ],
    )
    row.close()


def _is_truth(topic: Topic) -> bool:
    return topic.name.startswith(TRUTH_PREFIX)
