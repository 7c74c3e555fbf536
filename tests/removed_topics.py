"""Copies of recordings without some of their topics, such as the ground truth."""

from __future__ import annotations

from pathlib import Path

from acquire.recorder.recover.edit import copy_messages
from acquire.recorder.recover.rewrite import Layout, Rewriter, mapped, read_layout
from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages
from schemas.mcap.content_hash import ContentHash
from schemas.mcap.walk import walk
from schemas.session_manifest import SEAL_NAME
from schemas.topics import TRUTH_PREFIX


def remove_topics(path: Path, out: Path, prefix: str) -> None:
    """Copy the recording `path` to `out` without the topics whose names begin with `prefix`.

    The content_id (hash of the messages outside /truth/) is kept if `prefix` begins with /truth/, and
    computed anew otherwise.

    Raises:
        RecorderError: `path` is incomplete, or `out` cannot be written.
    """
    with mapped(path) as data:
        layout = read_layout(path, data)
        writer = Rewriter(out, out.with_name(f".{out.name}.removing"))
        try:
            writer.records.begin()
            _copy_without(data, layout, prefix, writer)
            writer.finish()
            writer.part_path.rename(out)
        finally:
            writer.close()


def _copy_without(data: memoryview, layout: Layout, prefix: str, writer: Rewriter) -> None:
    kept = {number: topic for number, topic in layout.topics.items() if not topic.startswith(prefix)}
    schemas = {layout.channels[number].schema_id for number in kept}
    for whole in layout.summary.schemas:
        if container.parse_schema(memoryview(whole)[container.RECORD_HEAD :]).id in schemas:
            writer.copy_declaration(whole)
    for whole in layout.summary.channels:
        if container.parse_channel(memoryview(whole)[container.RECORD_HEAD :]).id in kept:
            writer.copy_declaration(whole)
    digest = ContentHash()
    for opcode, at, body in walk(data[: layout.data_end], len(container.MAGIC)):
        if opcode == container.ATTACHMENT:
            writer.copy_attachment(data[at : at + container.RECORD_HEAD + len(body)])
        elif opcode == container.METADATA:
            metadata = container.parse_metadata(body)
            entries = metadata.entries
            if metadata.name == SEAL_NAME and not prefix.startswith(TRUTH_PREFIX):
                entries = {**entries, "content_id": digest.hexdigest()}
            writer.write_metadata(metadata.name, entries)
        elif opcode == container.CHUNK:
            copy_messages(chunk_messages(container.parse_chunk(body)), kept, writer, digest)
