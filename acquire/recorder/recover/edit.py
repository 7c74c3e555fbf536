"""Adds topics to a finished recording, and removes topics from one.

An original to which topics are added is replaced only by a complete new file.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from pydantic import ValidationError

from acquire.errors import RecorderError
from acquire.recorder import atomic
from acquire.recorder.recover.rewrite import Layout, Rewriter, mapped, read_layout
from schemas.mcap import records as container
from schemas.mcap.chunks import ChunkEntry, MessagePlaces, chunk_messages
from schemas.mcap.content_hash import ContentHash
from schemas.mcap.records import ContainerError
from schemas.mcap.walk import walk
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME, SessionManifest
from schemas.topics import TRUTH_PREFIX, Topic


def read_manifest(path: Path) -> SessionManifest:
    """Read the manifest (object, plan, camera and clock of the session) of a finished recording.

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

    The recording is replaced by the new file; its content_id (hash of all other messages) does not change.

    Args:
        path: the recording.
        messages: (topic, log time [ns], serialised message) of each.

    Raises:
        RecorderError: the recording is incomplete, holds such a topic already, or cannot be rewritten, or a
            topic is not below /truth/; the recording is unchanged then.
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
                    raise RecorderError(
                        f"{path}: holds {topic.name} already: remove it with remove_topics first"
                    )
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


def remove_topics(path: Path, out: Path, prefix: str) -> None:
    """Copy the recording `path` to `out` without the topics whose names begin with `prefix`.

    The content_id (hash of the messages outside /truth/) is kept if `prefix` begins with /truth/, and
    computed anew otherwise.

    Raises:
        RecorderError: `path` is incomplete or damaged, or `out` exists or cannot be written; nothing is left
            behind then.
    """
    atomic.refuse_taken(out)
    with mapped(path) as data:
        layout = read_layout(path, data)
        writer = Rewriter(out, out.with_name(f".{out.name}.{os.getpid()}.removing"))
        try:
            writer.records.begin()
            _copy_without(data, layout, prefix, writer)
            writer.finish()
            atomic.publish(writer.part_path, out)
        except ContainerError as error:
            raise RecorderError(f"{path}: damaged: {error}: `acquire recover` it first") from None
        finally:
            writer.close()


def _copy_without(data: memoryview, layout: Layout, prefix: str, writer: Rewriter) -> None:
    removed = {number for number, topic in layout.topics.items() if topic.startswith(prefix)}
    kept = {number: topic for number, topic in layout.topics.items() if number not in removed}
    schemas = {layout.channels[number].schema_id for number in kept}
    for whole in layout.summary.schemas:
        if container.parse_schema(_body(whole)).id in schemas:
            writer.copy_declaration(whole)
    for whole in layout.summary.channels:
        if container.parse_channel(_body(whole)).id in kept:
            writer.copy_declaration(whole)
    digest = ContentHash()
    chunks = {entry.offset: entry for entry in map(ChunkEntry.parse, map(_body, layout.summary.chunks))}
    for opcode, at, body in walk(data[: layout.data_end], len(container.MAGIC)):
        whole = data[at : at + container.RECORD_HEAD + len(body)]
        if opcode == container.ATTACHMENT:
            writer.copy_attachment(whole)
        elif opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            entries = metadata.entries
            if metadata.name == SEAL_NAME and not prefix.startswith(TRUTH_PREFIX):
                entries = {**entries, "content_id": digest.hexdigest()}
            writer.write_metadata(metadata.name, entries)
        elif opcode == container.CHUNK and not _holds_only(chunks.get(at), removed):
            copy_messages(chunk_messages(container.parse_chunk(body)), kept, writer, digest)


def _holds_only(entry: ChunkEntry | None, channels: set[int]) -> bool:
    """True if a chunk's summary entry lists at least one channel, and only some of `channels`.

    False without an entry (None).
    """
    return entry is not None and bool(entry.index_offsets) and set(entry.index_offsets) <= channels


def _body(whole: bytes) -> memoryview:
    return memoryview(whole)[container.RECORD_HEAD :]


def copy_messages(messages: memoryview, topics: dict[int, str], writer: Rewriter, digest: ContentHash) -> int:
    """Copy a chunk's messages whose channel is in `topics`, and add them to `digest`.

    A chunk of which every record is copied stays one chunk; else the messages are gathered in new chunks.

    Args:
        messages: message records of the chunk, decompressed.
        topics: names of the topics to be copied, by channel id.
        writer: writer of the new file.
        digest: content hash of the new file.

    Returns:
        Number of messages copied.

    Raises:
        ContainerError: a message is damaged.
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
        return len(kept)
    for _, message in kept:
        writer.write_message(
            message.channel_id, message.sequence, message.log_time_ns, message.publish_time_ns, message.data
        )
    return len(kept)
