"""Ledger of an archive: the outcome of each recording, so that later runs need not open it.

Each run appends a line of JSON per recording as soon as its row of results is written; the line of the latest
run counts. An unfinished line, left by a killed run, is ignored: its recording is analysed again, unless its
row exists.
"""

from __future__ import annotations

import errno
import fcntl
import json
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

from pydantic import TypeAdapter

from analyze.batch.results_lock import lock_results
from analyze.batch.unwritable import cannot_be_written
from analyze.errors import ArchiveError

FOLDER = "ledger"


@dataclass(frozen=True)
class Entry:
    """Outcome of a recording's latest analysis: one line of a ledger."""

    url: str
    """URL or local path of the recording's first file"""
    source_id: str
    """hash of URL, size and stamp (time of change or ETag) of the recording's files"""
    settings: str
    """hash of the settings of the analysis"""
    analysis_version: str
    """hash of the code and libraries that computed the result"""
    key: str
    """key of the recording's row of results; "" if the analysis failed"""
    failure: str
    """kind of failure; "" if the analysis succeeded"""
    reason: str
    """reason for the failure, one sentence; "" if the analysis succeeded"""
    own_files: list[str]
    """names of the files that belong to the recording"""


_ENTRY = TypeAdapter(Entry)


def read_ledgers(output: Path) -> dict[str, Entry]:
    """Read all ledgers in a folder of results.

    Args:
        output: folder of the results; need not exist.

    Returns:
        Latest entry of each recording by its URL; lines that cannot be read are skipped.
    """
    found: dict[str, tuple[int, Entry]] = {}
    for path in sorted((output / FOLDER).glob("*.jsonl")):
        for line in path.read_bytes().splitlines():
            try:
                fields = json.loads(line)
                number, entry = int(fields["run"]), _ENTRY.validate_python(fields)
            except (ValueError, TypeError, KeyError, OverflowError, RecursionError):
                continue
            if entry.url not in found or number >= found[entry.url][0]:
                found[entry.url] = (number, entry)
    return {url: entry for url, (_, entry) in found.items()}


class Ledger:
    """File to which a batch run appends the outcome of each recording's analysis, a line per recording.

    An outcome is a result or a failure. The folder of the results is locked against runs that overlap with
    this one: all but those of other shards of the same count. A shard is one part of an archive of recordings
    that is divided over several runs. A context manager that closes and unlocks the file.
    """

    def __init__(self, output: Path, shard: tuple[int, int], run_ns: int) -> None:
        """Open and lock the ledger; missing folders are created.

        Args:
            output: folder of the results.
            shard: number of the shard, from 1, and number of shards; its ledger is
                `ledger/<number>-of-<shards>.jsonl`, that of an undivided run `ledger/all.jsonl`.
            run_ns: start of the run [ns since 1970], which orders the entries of several runs.

        Raises:
            ArchiveError: another run has locked the ledger or the folder, the folder cannot be written, or
                its file system has no locks.
        """
        folder = output / FOLDER
        number, shards = shard
        name = "all" if shards == 1 else f"{number}-of-{shards}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            # Unbuffered: what is left in a buffer on a full disk would fail once more as the file is closed.
            self._file: IO[bytes] = (folder / f"{name}.jsonl").open("ab", buffering=0)
        except OSError as error:
            raise cannot_be_written(output, error) from None
        try:
            self._results = lock_results(folder, output, shards)
        except ArchiveError:
            self._file.close()
            raise
        try:
            # Two runs of one shard share the lock above.
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self.__exit__()
            raise ArchiveError(
                f"{output}: another run of shard {number}/{shards} is writing results there: wait for its "
                "end, or use another --out"
            ) from None
        self._run_ns, self._output = run_ns, output
        if self._file.tell():
            # End a line that a killed run left unfinished.
            try:
                self._file.write(b"\n")
            except OSError as error:
                self.__exit__()
                raise cannot_be_written(output, error) from None

    def add(self, entries: Iterable[Entry]) -> None:
        """Append entries, one line each, and flush them to the operating system.

        Raises:
            ArchiveError: the file cannot be written.
        """
        try:
            for entry in entries:
                line = json.dumps({"run": self._run_ns, **asdict(entry)}).encode() + b"\n"
                if self._file.write(line) < len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:
            raise cannot_be_written(self._output, error) from None

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._results.close()
