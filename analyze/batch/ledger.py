"""Ledger of an archive: the outcome of each recording, so that later runs need not open it.

Each run appends a line per recording as soon as its row is written; the last line of a recording counts. An
unfinished line, left by a killed run, is ignored: its recording is analysed again, unless its row exists.
"""

from __future__ import annotations

import fcntl
import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import IO

from analyze.errors import ArchiveError

FOLDER = "ledger"


@dataclass(frozen=True)
class Entry:
    """Outcome of a recording's latest analysis."""

    url: str
    source_id: str
    settings: str
    analysis_version: str
    key: str
    """key of its row of results; "" if it failed"""
    failure: str
    reason: str
    own_files: list[str]


def read_ledgers(output: Path) -> dict[str, Entry]:
    """Latest entry of each recording by its URL, from all ledgers in a folder of results."""
    found: dict[str, tuple[int, Entry]] = {}
    for path in sorted((output / FOLDER).glob("*.jsonl")):
        for line in path.read_bytes().splitlines():
            try:
                fields = json.loads(line)
                number = int(fields.pop("run"))
                entry = Entry(**fields)
            except (ValueError, TypeError, KeyError):
                continue
            if entry.url not in found or number >= found[entry.url][0]:
                found[entry.url] = (number, entry)
    return {url: entry for url, (_, entry) in found.items()}


class Ledger:
    """Ledger that one run appends to; only one run at a time can hold it."""

    def __init__(self, output: Path, shard: str, run_ns: int) -> None:
        """Open and lock the ledger.

        Raises:
            ArchiveError: another run holds it, or the folder cannot be written.
        """
        folder = output / FOLDER
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file: IO[bytes] = (folder / f"{shard}.jsonl").open("ab")
        except OSError as error:
            raise ArchiveError(
                f"{output}: cannot be written ({error.strerror}): choose another folder with --out"
            ) from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise ArchiveError(
                f"{output}: another run is writing results there: wait for its end, or use another --out"
            ) from None
        self._run_ns = run_ns
        if self._file.tell():
            # End a line that a killed run left unfinished.
            self._file.write(b"\n")

    def add(self, entries: Iterable[Entry]) -> None:
        """Append entries and flush them to the operating system."""
        for entry in entries:
            self._file.write(json.dumps({"run": self._run_ns, **asdict(entry)}).encode() + b"\n")
        self._file.flush()

    def close(self) -> None:
        """Close and unlock the ledger."""
        self._file.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
