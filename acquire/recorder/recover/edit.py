"""Adds topics of ground truth (of a simulation) to a finished recording, and copies chosen topics.

The recording is replaced only by a complete new file.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pydantic import ValidationError

from acquire.errors import RecorderError
from acquire.recorder import atomic
from acquire.recorder.recover.rewrite import Rewriter, mapped, read_layout
from schemas.mcap import records as container
from schemas.mcap.chunks import MessagePlaces
from schemas.mcap.content_hash import ContentHash
from schemas.mcap.records import MessageRecord
from schemas.mcap.walk import walk
from schemas.session_manifest import MANIFEST_NAME, SessionManifest
from schemas.topics import TRUTH_PREFIX, Topic


def read_manifest(path: Path) -> SessionManifest:
    """Manifest of a finished recording: object, hash of the plan, camera and clock of its session.

    Raises:
        RecorderError: the recording is missing, cut short, or holds no manifest that this version reads.
    """
    with mapped(path) as data:
        metadata = read_layout(path, data).metadata
    try:
        return SessionManifest.model_validate_json(metadata[MANIFEST_NAME]["json"])
    except (KeyError, ValidationError):
        raise RecorderError(f"{path}: holds no manifest that this version of Percuss reads") from None


def append_topics(path: Path, messages: Iterable[tuple[Topic, int, bytes]]) -> None:
    """Add messages of new topics below /truth/ (ground truth of a simulation) to a finished recording.

    The recording is replaced by a new file. Its content_id (hash of all messages outside /truth/) does not
    change.

    Args:
        path: the recording.
        messages: (topic, log time [ns], serialised message) of each, in the order in which they are added.

    Raises:
        RecorderError: the recording is missing or incomplete, holds such a topic already, or cannot be
            rewritten, or a topic is not below /truth/; the recording is unchanged then.
    """
    with mapped(path) as data:
        layout = read_layout(path, data)
    taken = {channel.topic for channel in layout.channels.values()}
    number = max(layout.channels, default=0)
    # In a file that another program wrote, a schema's number may be higher than any channel's.
    number = max([number, *(container.parse_schema(_body(whole)).id for whole in layout.summary.schemas)])
    new: dict[str, int] = {}
    counts: dict[str, int] = {}
    writer = Rewriter(path, path.with_name(f".{path.name}.{os.getpid()}.adding"))
    try:
        writer.copy_from(path, layout.data_end, layout.summary)
        for topic, log_time_ns, body in messages:
            if topic.name not in new:
                if topic.name in taken:
                    raise RecorderError(f"{path}: holds {topic.name} already: a topic can be added once")
                if not topic.name.startswith(TRUTH_PREFIX):
                    raise RecorderError(
                        f"{path}: {topic.name} is part of the sealed content: only {TRUTH_PREFIX} topics "
                        "can be added later"
                    )
                number += 1
                writer.add_topic(topic, number)
                new[topic.name], counts[topic.name] = number, 0
            writer.write_message(new[topic.name], counts[topic.name], log_time_ns, log_time_ns, body)
            counts[topic.name] += 1
        writer.finish()
        writer.part_path.replace(path)
        atomic.sync_folder(path.parent)
    finally:
        writer.close()


def _body(whole: bytes) -> memoryview:
    return memoryview(whole)[container.RECORD_HEAD :]


def copy_messages(
    messages: memoryview, topics: dict[int, str], writer: Rewriter, digest: ContentHash
) -> list[MessageRecord]:
    """Copy those messages of an MCAP chunk whose topic is in `topics` to a new file, and hash them.

    A chunk of which every record is copied stays one chunk; else the messages are gathered in new chunks.

    Args:
        messages: message records of the chunk, decompressed.
        topics: names of the topics to be copied, by channel id.
        writer: writer of the new file.
        digest: content hash of the new file, to which the messages are added.

    Returns:
        The messages that were copied, in the file's order.

    Raises:
        ContainerError: a message is damaged.
        RecorderError: the disk refuses.
    """
    records = list(walk(messages))
    found = [
        (at, container.parse_message(body)) for opcode, at, body in records if opcode == container.MESSAGE
    ]
    kept = [(at, message) for at, message in found if message.channel_id in topics]
    for _, message in kept:
        digest.add(topics[message.channel_id], message.log_time_ns, len(message.data), message.data)
    whole = bool(records) and records[-1][1] + container.RECORD_HEAD + len(records[-1][2]) == len(messages)
    if whole and len(kept) == len(records):
        places: MessagePlaces = {}
        for at, message in kept:
            places.setdefault(message.channel_id, []).append((message.log_time_ns, at))
        writer.copy_chunk(messages, places)
        return [message for _, message in kept]
    for _, message in kept:
        writer.write_message(
            message.channel_id, message.sequence, message.log_time_ns, message.publish_time_ns, message.data
        )
    return [message for _, message in kept]
