"""Merge of the virtual world's ground truth into a finished recording, under /truth/.

The recording's content_id (hash of all its other messages) does not change.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from acquire.recorder.recover.edit import append_topics, read_manifest
from acquire.virtual.truth_file import read_truth_file
from schemas import topics
from schemas.proto import percuss_pb2 as pb


def merge_truth(recording: Path, truth_file: Path, since_ns: int = 0) -> None:
    """Append the messages of a truth file (true mass properties, poses, contacts) to a finished recording.

    The log time of poses and contacts is world time (host monotonic) plus the recording's offset from it to
    wall time; the mass properties get that of the first pose or contact.

    Args:
        recording: path of the recording, which is rewritten.
        truth_file: path of the virtual world's truth file.
        since_ns: world time from which on poses and contacts are taken [ns]; the file also holds what was
            before this recording.

    Raises:
        RecorderError: the recording is incomplete, holds such messages already, or cannot be rewritten; it is
            unchanged.
        AcquireError: the truth file cannot be read or is cut short.
    """
    anchor = read_manifest(recording).wall_anchor_ns
    append_topics(recording, _messages(truth_file, anchor, since_ns))


def _messages(truth_file: Path, anchor_ns: int, since_ns: int) -> Iterator[tuple[topics.Topic, int, bytes]]:
    """Yield the messages of a truth file as topic, log time [ns] and bytes; the mass properties come last.

    The log time is wall time: world time (host monotonic) plus `anchor_ns`, wall time minus host monotonic
    time [ns]. The mass properties get the log time of the first pose or contact; `anchor_ns` without any.
    Messages of a world time before `since_ns` are left out.
    """
    first_ns = 0
    bodies: list[pb.TruthBody] = []
    for message in read_truth_file(truth_file):
        if isinstance(message, pb.TruthBody):
            bodies.append(message)
            continue
        if message.world_time_ns < since_ns:
            continue
        log_time = message.world_time_ns + anchor_ns
        first_ns = first_ns or log_time
        topic = topics.TRUTH_POSE if isinstance(message, pb.TruthPose) else topics.TRUTH_CONTACT
        yield topic, log_time, message.SerializeToString()
    for body in bodies:
        yield topics.TRUTH_BODY, first_ns or anchor_ns, body.SerializeToString()
