"""Output files: checked before the work, and written so that they appear complete or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

KEPT_SUFFIXES = (".mcap", ".toml")
"""Suffixes of files that no command replaces unless the user asks for it: recordings, whose strikes cannot be
repeated, and settings, which people write. All others are computed from these two, and are replaced."""


class OutputError(Exception):
    """A file that cannot be written; the message is one line: the file, the reason and the remedy."""


def why_unwritable(output: Path, *inputs: Path) -> str | None:
    """Reason why `output` cannot be written or would replace an input; None if neither is the case.

    A missing folder is not created: its name may be misspelt, and the file would not be found again.

    Args:
        output: file to be written; an existing file may be replaced.
        inputs: files that must not be replaced.

    Returns:
        One line (the file, the reason and the remedy), or None.
    """
    folder = output.parent
    if output.is_dir():
        return f"{output}: is a folder: name a file in it"
    if not folder.is_dir():
        return f"{output}: cannot be written: there is no folder {folder}: create it first"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"{output}: cannot be written: no permission to write in {folder}: choose another place"
    for path in inputs:
        if output.exists() and path.exists() and output.samefile(path):
            return f"{output}: is also an input and would be replaced: choose another name for the output"
    return None


def why_taken(output: Path, *, force: bool | None = None) -> str | None:
    """Reason why the file `output` is not replaced; None if it does not exist, or is to be replaced.

    Args:
        output: file to be written.
        force: value of the command's option --force; None if it has none.

    Returns:
        One line (the file, the reason and the remedy), or None.
    """
    if force or not output.exists():
        return None
    remedy = "choose another name" + ("" if force is None else ", or give --force to replace it")
    return f"{output}: exists already: {remedy}"


def refuse_unwritable(output: Path, *inputs: Path) -> None:
    """Raise OutputError if `output` cannot be written or would replace one of the `inputs`.

    Call it before a long computation, so that the computation's result is not lost.
    """
    if (reason := why_unwritable(output, *inputs)) is not None:
        raise OutputError(reason)


def write_text(output: Path, text: str) -> None:
    """Write `text` as UTF-8 to `output`, which appears complete or not at all.

    Raises:
        OutputError: the file cannot be written; an existing `output` stays unchanged.
    """
    write_bytes(output, text.encode("utf-8"))


def write_bytes(output: Path, data: bytes) -> None:
    """Write `data` to a temporary file, fsync it and rename it to `output`.

    An existing `output` is replaced and its permissions are kept. On failure it stays unchanged, and the
    temporary file is removed.

    Raises:
        OutputError: the file cannot be written.
    """
    refuse_unwritable(output)
    part: Path | None = None
    try:
        handle, name = tempfile.mkstemp(dir=output.parent, prefix=f".{output.name}.")
        part = Path(name)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        part.chmod(output.stat().st_mode & 0o777 if output.exists() else 0o644)
        part.replace(output)
    except OSError as error:
        raise OutputError(f"{output}: cannot be written: {error.strerror}: choose another place") from None
    finally:
        if part is not None:
            part.unlink(missing_ok=True)
