"""What is known of an archive's recordings without opening one: a line per recording and run, appended as soon as its row is written.

The last line on a recording counts. A line that was not finished, because the run was killed, counts for nothing: its recording is looked
at again, and its row found if it was written.
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
    """What became of a recording the last time."""

    url: str
    source_id: str
    settings: str
    analysis_version: str
    key: str
    """"": it failed"""
    failure: str
    reason: str
    own_files: list[str]


def read_ledgers(output: Path) -> dict[str, Entry]:
    """The last entry of each recording by its place, of all ledgers in a folder of results."""
    found: dict[str, tuple[int, Entry]] = {}
    for path in sorted((output / FOLDER).glob("*.jsonl")):
        for line in path.read_bytes().splitlines():
            try:
                told = json.loads(line)
                number = int(told.pop("run"))
                entry = Entry(**told)
            except (ValueError, TypeError, KeyError):
                continue
            if entry.url not in found or number >= found[entry.url][0]:
                found[entry.url] = (number, entry)
    return {url: entry for url, (_, entry) in found.items()}


class Ledger:
    """A run's own ledger; one run at a time may hold it."""

    def __init__(self, output: Path, shard: str, run_ns: int) -> None:
        """Take hold of it.

        Raises:
            ArchiveError: another run holds it, or the folder cannot be written.
        """
        folder = output / FOLDER
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file: IO[bytes] = (folder / f"{shard}.jsonl").open("ab")
        except OSError as error:
            raise ArchiveError(f"{output}: cannot be written ({error.strerror}): choose another folder with --out") from None
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise ArchiveError(f"{output}: another run is writing results there: wait for its end, or use another --out") from None
        self._run_ns = run_ns
        if self._file.tell():
            # A line that a killed run left unfinished ends here.
            self._file.write(b"\n")

    def add(self, entries: Iterable[Entry]) -> None:
        """Write lines; they are on their way to the disk when this returns."""
        for entry in entries:
            self._file.write(json.dumps({"run": self._run_ns, **asdict(entry)}).encode() + b"\n")
        self._file.flush()

    def close(self) -> None:
        """Let go."""
        self._file.close()

    def __enter__(self) -> Ledger:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()
