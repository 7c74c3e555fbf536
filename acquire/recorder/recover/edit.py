"""Adds topics to a finished recording and takes topics out of one. The original is replaced only by a whole new file, or not at all."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterable
from pathlib import Path

from pydantic import ValidationError

from acquire.errors import RecorderError
from acquire.recorder import atomic
from acquire.recorder.recover.rewrite import Layout, Rewriter, mapped, read_layout
from schemas.mcap import records as container
from schemas.mcap.records import ContainerError, ContentHash
from schemas.mcap.summary import ChunkEntry
from schemas.session_manifest import MANIFEST_NAME, SEAL_NAME, SessionManifest
from schemas.topics import TRUTH_PREFIX, Topic


def read_manifest(path: Path) -> SessionManifest:
    """Manifest of a finished recording.

    Raises:
        RecorderError: it is missing, cut short, or holds none.
    """
    with mapped(path) as data:
        metadata = read_layout(path, data).metadata
    try:
        return SessionManifest.model_validate_json(metadata[MANIFEST_NAME]["json"])
    except (KeyError, ValidationError):
        raise RecorderError(f"{path}: holds no manifest of this version of Percuss") from None


def append_topics(path: Path, messages: Iterable[tuple[Topic, int, bytes]]) -> None:
    """Add messages (topic, log time, data) of new /truth/ topics to a finished recording; its content_id stays what it was.

    Raises:
        RecorderError: the recording is not whole, has such a topic already, or cannot be rewritten; it is left as it was.
    """
    with mapped(path) as data:
        layout = read_layout(path, data)
    taken = {channel.topic for channel in layout.channels.values()}
    number = max(layout.channels, default=0)
    # A schema's number may be higher than any channel's in a file that another program wrote.
    number = max([number, *(container.parse_schema(_body(whole)).id for whole in layout.summary.schemas)])
    new: dict[str, int] = {}
    counts: dict[str, int] = {}
    writer = Rewriter(path, path.with_name(f".{path.name}.{os.getpid()}.adding"))
    try:
        writer.copy_from(path, layout.data_end, layout.summary)
        for topic, log_time_ns, body in messages:
            if topic.name not in new:
                if topic.name in taken:
                    raise RecorderError(f"{path}: holds {topic.name} already: take it out with remove_topics first")
                if not topic.name.startswith(TRUTH_PREFIX):
                    raise RecorderError(
                        f"{path}: {topic.name} is part of what the seal names: only {TRUTH_PREFIX} topics can be added later"
                    )
                number += 1
                writer.add_topic(topic, number)
                new[topic.name], counts[topic.name] = number, 0
            writer.message(new[topic.name], counts[topic.name], log_time_ns, log_time_ns, body)
            counts[topic.name] += 1
        writer.finish()
        writer.part_path.replace(path)
        atomic.sync_folder(path.parent)
    finally:
        writer.close()


def remove_topics(path: Path, out: Path, prefix: str) -> None:
    """Write `path` without the topics whose names begin with `prefix` to `out`.

    The content_id stays where only /truth/ topics go, and is made anew where others do.

    Raises:
        RecorderError: `path` is not whole or damaged, or `out` cannot be written; nothing is left behind.
    """
    atomic.refuse_taken(out)
    with mapped(path) as data:
        layout = read_layout(path, data)
        writer = Rewriter(out, out.with_name(f".{out.name}.{os.getpid()}.removing"))
        try:
            writer.start()
            _copy_without(data, layout, prefix, writer)
            writer.finish()
            atomic.publish(writer.part_path, out)
        except ContainerError as error:
            raise RecorderError(f"{path}: damaged: {error}: `acquire recover` it first") from None
        finally:
            writer.close()


def _copy_without(data: memoryview, layout: Layout, prefix: str, writer: Rewriter) -> None:
    gone = {number for number, channel in layout.channels.items() if channel.topic.startswith(prefix)}
    kept = {number: channel.topic for number, channel in layout.channels.items() if number not in gone}
    schemas = {layout.channels[number].schema_id for number in kept}
    for whole in layout.summary.schemas:
        if container.parse_schema(_body(whole)).id in schemas:
            writer.declare(whole, writer.summary.schemas)
    for whole in layout.summary.channels:
        if container.parse_channel(_body(whole)).id in kept:
            writer.declare(whole, writer.summary.channels)
    digest = ContentHash()
    chunks = {entry.offset: entry for entry in map(ChunkEntry.parse, map(_body, layout.summary.chunks))}
    for opcode, at, body in container.walk(data[: layout.data_end], len(container.MAGIC)):
        whole = data[at : at + container.RECORD_HEAD + len(body)]
        if opcode == container.ATTACHMENT:
            writer.attachment(whole)
        elif opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            entries = metadata.entries
            if metadata.name == SEAL_NAME and not prefix.startswith(TRUTH_PREFIX):
                entries = {**entries, "content_id": digest.hexdigest()}
            writer.metadata(metadata.name, entries)
        elif opcode == container.CHUNK and not _only(chunks.get(at), gone):
            copy_chunk(container.chunk_messages(container.parse_chunk(body)), kept, writer, digest)


def _only(entry: ChunkEntry | None, channels: set[int]) -> bool:
    """Whether a chunk is known to hold nothing but these channels."""
    return entry is not None and bool(entry.index_offsets) and set(entry.index_offsets) <= channels


def _body(whole: bytes) -> memoryview:
    return memoryview(whole)[container.RECORD_HEAD :]


def copy_chunk(messages: memoryview, topics: dict[int, str], writer: Rewriter, digest: ContentHash) -> int:
    """Write those messages of a chunk whose channel is in `topics` and take them into `digest`; returns how many.

    Raises:
        ContainerError: a message is damaged.
    """
    records = list(container.walk(messages))
    found = [(at, container.parse_message(body)) for opcode, at, body in records if opcode == container.MESSAGE]
    kept = [(at, message) for at, message in found if message.channel_id in topics]
    for _, message in kept:
        digest.add(topics[message.channel_id], message.log_time_ns, len(message.data), message.data)
    whole = bool(records) and records[-1][1] + container.RECORD_HEAD + len(records[-1][2]) == len(messages)
    if whole and len(kept) == len(records):
        index: dict[int, list[tuple[int, int]]] = {}
        for at, message in kept:
            index.setdefault(message.channel_id, []).append((message.log_time_ns, at))
        writer.flush()
        writer.chunk(messages, zlib.crc32(messages), index)
        return len(kept)
    for _, message in kept:
        writer.message(message.channel_id, message.sequence, message.log_time_ns, message.publish_time_ns, message.data)
    return len(kept)
