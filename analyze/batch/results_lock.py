"""Lock on a folder of results: overlapping runs exclude each other, different shards of one count do not.

A shard is one part of an archive that is divided over several runs. Two shards are disjoint only if both runs
divide the archive into the same number of parts.
"""

from __future__ import annotations

import errno
import fcntl
import time
from pathlib import Path
from typing import IO

from analyze.batch.unwritable import cannot_be_written
from analyze.errors import ArchiveError

LOCK_NAME = "lock"
RETRY_S, RETRY_INTERVAL_S = 2.0, 0.02
"""time for which a lock is tried [s], as a run that starts holds it alone for a moment, and pause between"""


def lock_results(folder: Path, output: Path, shards: int) -> IO[bytes]:
    """Lock a folder of results until the returned file is closed, or this process ends.

    An undivided run locks it exclusively. A shard's run shares the lock with runs that divide the archive
    into the same number of shards: the file holds that number, and is written only while it is locked
    exclusively.

    Args:
        folder: folder for the file; must exist.
        output: folder of the results, for messages.
        shards: number of shards into which this run divides the archive.

    Returns:
        The open, locked file.

    Raises:
        ArchiveError: another run that overlaps with this one is active, the file cannot be written, or its
            file system has no locks.
    """
    path = folder / LOCK_NAME
    ends = time.monotonic() + RETRY_S
    try:
        file = path.open("a+b", buffering=0)
    except OSError as error:
        raise cannot_be_written(output, error) from None
    try:
        while not _try_lock(file, shards):
            if time.monotonic() > ends:
                raise ArchiveError(f"{output}: {_other_run(file)}: wait for its end, or use another --out")
            time.sleep(RETRY_INTERVAL_S)
    except OSError as error:
        file.close()
        if error.errno in {errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP}:
            raise cannot_be_locked(output, error) from None
        raise cannot_be_written(output, error) from None
    except BaseException:
        file.close()
        raise
    return file


def cannot_be_locked(output: Path, error: OSError) -> ArchiveError:
    """Error for a folder of results on a file system without locks."""
    return ArchiveError(
        f"{output}: its file system has no locks ({error.strerror}): choose a folder on another with --out"
    )


def _try_lock(file: IO[bytes], shards: int) -> bool:
    """Lock the file if no overlapping run has locked it; False, with the file unlocked, if one has.

    Raises:
        OSError: the file cannot be locked for another reason, or not be written.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if shards == 1:
            return False
    else:
        file.truncate(0)
        file.write(f"{shards}\n".encode())
        if shards == 1:
            return True
    try:
        # Not atomic after an exclusive lock: another run may have come between, and written its number.
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    if _stated_shards(file) == shards:
        return True
    fcntl.flock(file, fcntl.LOCK_UN)
    return False


def _stated_shards(file: IO[bytes]) -> int:
    """Number of shards in the file; 0 if it holds none."""
    file.seek(0)
    text = file.read(20).strip()
    return int(text) if text.isdigit() else 0


def _other_run(file: IO[bytes]) -> str:
    shards = _stated_shards(file)
    what = f"another run, in {shards} shards," if shards > 1 else "another run"
    return f"{what} is writing results there"
