"""Reads a recovered recording back, as proof that it holds what was written."""

from __future__ import annotations

from pathlib import Path

from acquire.errors import RecorderError
from acquire.recorder.recover.recover_report import RecoverReport
from acquire.recorder.recover.rewrite import mapped, read_layout
from schemas.mcap.content_hash import ContentHash
from schemas.mcap.records import ContainerError
from schemas.mcap.walk import walk_chunks
from schemas.wording import counted


def verify(path: Path, report: RecoverReport) -> None:
    """Read the messages of the recovered file `path`, and compare number and hash with the report.

    The report (`RecoverReport`) states the number and the content hash of the messages that were written.

    Raises:
        RecorderError: the file does not hold the messages that were written, or cannot be read.
    """
    digest, count = ContentHash(), 0
    with mapped(path) as data:
        layout = read_layout(path, data)
        topics = layout.topics
        try:
            for messages in walk_chunks(data[: layout.data_end]):
                count += digest.add_chunk(messages, topics)
        except ContainerError as error:
            raise RecorderError(
                f"{report.path}: cannot be read back: {error}: check the disk and try again"
            ) from None
    if count != report.messages or digest.hexdigest() != report.content_id:
        raise RecorderError(
            f"{report.path}: {count} of {counted(report.messages, 'message')} can be read back: check the "
            "disk and try again"
        )
