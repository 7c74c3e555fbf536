"""End of a file that rerun writes (.rrd): its failures are noticed, and the file appears complete."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from schemas.output_file import OutputError

if TYPE_CHECKING:
    import rerun as rr

FLUSH_S = 120.0
"""longest time for which what is left is written [s]; rerun would wait for ever for a dead writer"""
_FOOTER = b"RRF2FOOT"
"""mark that begins the last 12 bytes of a complete file; rerun itself does not report that it is missing"""
_FOOTER_BYTES = 12


def finish_file(stream: rr.RecordingStream, part: Path, output: Path) -> None:
    """Close a stream that is saved to `part`, and rename the file to `output`.

    Raises:
        OutputError: the file could not be written to its end, such as on a full disk.
    """
    try:
        stream.flush(timeout_sec=FLUSH_S)
        stream.disconnect()
        with part.open("rb+") as file:
            file.seek(-_FOOTER_BYTES, os.SEEK_END)
            if not file.read().startswith(_FOOTER):
                raise OutputError(_unwritten(output))
            os.fsync(file.fileno())
        part.replace(output)
    except (RuntimeError, OSError):  # RuntimeError: rerun's writer has ended
        with suppress(RuntimeError):
            stream.disconnect()  # or the stream's end would wait for the writer again
        raise OutputError(_unwritten(output)) from None


def _unwritten(output: Path) -> str:
    return f"{output}: cannot be written to its end: free space on its disk, or choose another place"
