"""Errors for a folder of results that cannot be written, with what to do."""

from __future__ import annotations

import errno
from pathlib import Path

from analyze.errors import ArchiveError
from schemas.output_file import OutputError

NO_SPACE = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})


def cannot_be_written(output: Path, error: OSError | OutputError) -> ArchiveError:
    """Error for a folder of results in which a file cannot be written.

    Args:
        output: folder of the results.
        error: the system's error, or the one that followed from it.
    """
    cause = error.__context__ if isinstance(error, OutputError) else error
    if not isinstance(cause, OSError):
        return ArchiveError(str(error))
    remedy = "choose another folder with --out"
    if cause.errno in NO_SPACE:
        remedy = "free space there, then repeat the same command, which goes on; or choose another with --out"
    return ArchiveError(f"{output}: cannot be written: {cause.strerror}: {remedy}")
