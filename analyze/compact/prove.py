"""Proof that a copy holds all of its original: message by message, attachments, metadata, counts and seal."""

from __future__ import annotations

from contextlib import closing
from itertools import zip_longest
from typing import TYPE_CHECKING

from analyze.compact.copy_file import stored_messages
from analyze.compact.images import COMPRESSED, RAW, is_recoded
from analyze.errors import CompactError
from analyze.reading.indexed_file import open_finished
from schemas.compaction import COMPACTED_NAME
from schemas.mcap.content_hash import ContentHash
from schemas.session_manifest import SEAL_NAME

if TYPE_CHECKING:
    from pathlib import Path

    from analyze.compact.codings import Codings
    from analyze.progress import Progress
    from analyze.reading.indexed_file import IndexedFile
    from schemas.mcap.records import MessageRecord

ORIGINAL_STAYS = "it stays as it is"
"""end of a message: the original was not replaced"""
_REMADE = {COMPACTED_NAME, SEAL_NAME}
"""metadata that a copy has of its own"""


def prove(file: IndexedFile, part: Path, codings: Codings, progress: Progress) -> None:
    """Compare a copy, as the disk has it, with its original, and both with their seals.

    Args:
        file: the original.
        part: the copy.
        codings: coding of the images.
        progress: callback.

    Raises:
        CompactError: they differ, or the original is not what was sealed.
        RecordingError: one of them is damaged.
    """
    with closing(open_finished(part)) as copy, file.damage_as_error():
        digests = ContentHash(), ContentHash()
        total = sum(file.message_counts.values())
        number = -1
        pairs = zip_longest(stored_messages(file.data), stored_messages(copy.data))
        for number, (one, other) in enumerate(pairs):
            if one is None or other is None or not _is_same(file, one, other, codings):
                raise CompactError(
                    f"{file.path}: message {number} of its copy differs: {ORIGINAL_STAYS}; report this"
                )
            for digest, (topic, message) in zip(digests, (one, other), strict=True):
                digest.add(topic, message.log_time_ns, len(message.data), message.data)
            progress(f"comparing {file.path.name}", number, total)
        if file.message_counts != copy.message_counts or total != number + 1:
            raise CompactError(f"{file.path}: its messages are not all in chunks: {ORIGINAL_STAYS}")
        sealed = (each.metadata.get(SEAL_NAME, {}).get("content_id") for each in (file, copy))
        for stated, digest in zip(sealed, digests, strict=True):
            if stated not in {None, digest.hexdigest()}:
                raise CompactError(
                    f"{file.path}: its content is not what was sealed: {ORIGINAL_STAYS};"
                    " restore it from a copy"
                )
        refuse_other_head(file, copy)


def refuse_other_head(file: IndexedFile, copy: IndexedFile) -> None:
    """Compare channels, attachments and metadata of a copy with the original's.

    Raises:
        CompactError: they differ.
    """
    heads = [
        (
            {number: (each.topic, each.encoding) for number, each in one.channels.items()},
            one.attachments,
            {name: entries for name, entries in one.metadata.items() if name not in _REMADE},
        )
        for one in (file, copy)
    ]
    if heads[0] != heads[1]:
        raise CompactError(f"{file.path}: its copy differs from it: {ORIGINAL_STAYS}; report this")


def _is_same(
    file: IndexedFile, one: tuple[str, MessageRecord], other: tuple[str, MessageRecord], codings: Codings
) -> bool:
    """True if two messages are the same, or the same image in the coding that it was to have."""
    (topic, original), (copied_topic, copied) = one, other
    if topic != copied_topic or original[:4] != copied[:4]:
        return False
    if original.data == copied.data:
        return True
    schema = file.schemas.get(file.channels[original.channel_id].schema_id, "")
    coding = codings.coding_at(topic, original.log_time_ns)
    return schema in {RAW, COMPRESSED} and is_recoded(schema, original.data, copied.data, coding)
