"""Whether a recording's content is still what it was when it was sealed: every message is read and hashed."""

from __future__ import annotations

from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading import indexed_file
from analyze.reading.file_series import row_of
from schemas.mcap import records as container
from schemas.mcap.records import ContentHash
from schemas.session_manifest import SEAL_NAME


def refuse_changed_content(path: Path) -> None:
    """Read a recording, all files of its row, and compare its content with its seal.

    Raises:
        RecordingError: it is damaged, or not what was sealed.
    """
    for name in row_of(path).files:
        file = indexed_file.open_finished(name)
        try:
            sealed = file.metadata.get(SEAL_NAME, {}).get("content_id")
            if sealed is None:
                raise RecordingError(f"{name}: has no seal: nobody can say whether it was changed: record again")
            if sealed != _content_id(file):
                raise RecordingError(f"{name}: damaged: its content is not what was sealed: restore it from a copy")
        finally:
            file.close()


def _content_id(file: indexed_file.IndexedFile) -> str:
    digest = ContentHash()
    with file.guarded():
        for number in range(len(file.chunks)):
            messages = file.chunk_messages(number)
            for opcode, _, body in container.walk(messages):
                if opcode == container.MESSAGE:
                    message = container.parse_message(body)
                    digest.add(file.channels[message.channel_id].topic, message.log_time_ns, len(message.data), message.data)
            file.forget_chunk(number)
    return digest.hexdigest()
