"""Files that appear whole or not at all, and are known to have a place before the work for them begins."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from analyze.errors import OutputError
from schemas.output_file import why_unwritable


def refuse_unwritable(output: Path, *inputs: Path) -> None:
    """Say early that `output` cannot be written, or would replace one of the `inputs`.

    Raises:
        OutputError: so it is.
    """
    if (reason := why_unwritable(output, *inputs)) is not None:
        raise OutputError(reason)


def write_text(output: Path, text: str) -> None:
    """Write `text` as UTF-8; on failure what stood there before still stands, and nothing else is left.

    Raises:
        OutputError: the file cannot be written.
    """
    write_bytes(output, text.encode("utf-8"))


def write_bytes(output: Path, data: bytes) -> None:
    """Write `data`, as `write_text` does.

    Raises:
        OutputError: the file cannot be written.
    """
    refuse_unwritable(output)
    name: Path | None = None
    try:
        handle, part = tempfile.mkstemp(dir=output.parent, prefix=f".{output.name}.")
        name = Path(part)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        name.chmod(0o644)
        name.replace(output)
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error.strerror}: choose another place") from None
    finally:
        if name is not None:
            name.unlink(missing_ok=True)
