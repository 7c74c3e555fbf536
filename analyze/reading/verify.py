"""Verifies a recording: the hash of each file's messages must be the one in its seal.

The seal is the checksum record at the end of a file. The records around the messages, too, are checked.
"""

from __future__ import annotations

from pathlib import Path

from analyze.errors import RecordingError
from analyze.reading import indexed_file
from analyze.reading.file_series import find_series_files
from analyze.reading.recording_head import checked_manifest
from analyze.reading.structure import Structure
from schemas.mcap.content_hash import ContentHash
from schemas.session_manifest import SEAL_NAME


def refuse_changed_content(path: Path) -> None:
    """Check that a recording's files are whole, and that their messages are those that were sealed.

    The seal is a file's checksum record, with a hash of all messages but ground truth (topics under /truth/).
    The CRC of a chunk covers those, too. Missing files of a series are no error.

    Args:
        path: any of the recording's files.

    Raises:
        RecordingCut: a file ends early.
        RecordingError: `path` does not exist, or a file is not MCAP, has no seal, is damaged, or has a
            content other than its seal states.
    """
    for name in find_series_files(path).files:
        file = indexed_file.open_finished(name)
        try:
            sealed = file.metadata.get(SEAL_NAME, {}).get("content_id")
            if sealed is None:
                raise RecordingError(f"{name}: has no seal: changes to it cannot be detected: record again")
            checked_manifest(file)
            if sealed != _content_id(file):
                raise RecordingError(
                    f"{name}: damaged: its content is not what was sealed: restore it from a copy"
                )
        finally:
            file.close()


def _content_id(file: indexed_file.IndexedFile) -> str:
    """Hash of a file's messages outside /truth/, in hexadecimal digits.

    Raises:
        RecordingError: the file is damaged.
    """
    digest = ContentHash()
    topics = {number: channel.topic for number, channel in file.channels.items()}
    with file.damage_as_error():
        structure = Structure(file)
        structure.check_records()
        for number, chunk in enumerate(file.chunks):
            messages = file.chunk_messages(number)
            structure.check_chunk(chunk.offset, messages)
            digest.add_chunk(messages, topics)
            file.release_chunk(number)
    return digest.hexdigest()
