"""Stored answers that a newer analysis, file or version of the recording has superseded."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from analyze.batch.ledger import Entry, read_ledgers
from analyze.batch.settings import analysis_version
from analyze.batch.worker_messages import ROWS
from analyze.catalogue.copies import SAME_SESSION, find_copies
from analyze.catalogue.index import MISSING
from analyze.catalogue.table import Row

OLD_ANALYSIS, CHANGED_FILE, GONE, OTHER_VERSION, NO_RECORDING = (
    "older analysis",
    "changed recording",
    "missing recording",
    "other version of the session",
    "no recording",
)
REMEDIES = {
    OLD_ANALYSIS: "run `analyze batch` again: the code or its libraries changed",
    CHANGED_FILE: "run `analyze batch` again: the files changed",
    GONE: "the answer stays; restore the recording, or ignore it",
    OTHER_VERSION: "use the answer of the recording named; if it has none, run `analyze batch` first",
    NO_RECORDING: "the answer of an earlier content or setting: it counts nowhere",
}


@dataclass(frozen=True)
class Superseded:
    """A stored answer that another one should replace."""

    url: str
    """recording; "" if no recording has this answer any more"""
    key: str
    """key of the answer's row in the results"""
    why: str
    """one of the keys of `REMEDIES`"""
    by: str
    """recording whose answer is to be used; "" if there is none"""


def find_superseded(rows: Sequence[Row], output: Path) -> list[Superseded]:
    """Answers in a folder of results that are superseded, with the reason.

    Args:
        rows: rows of the catalogue.
        output: folder of the results.
    """
    ledger = read_ledgers(output)
    by_url = {row["url"]: row for row in rows}
    better = {
        row["url"]: group.best["url"]
        for group in find_copies(rows)
        if group.kind == SAME_SESSION
        for row in group.others
    }
    found = [each for entry in ledger.values() for each in _of_entry(entry, by_url, better)]
    named = {entry.key for entry in ledger.values()}
    stored = sorted(path.stem for path in (output / ROWS).glob("*.parquet"))
    found += [Superseded("", key, NO_RECORDING, "") for key in stored if key not in named]
    return sorted(found, key=lambda each: (each.why, each.url, each.key))


def _of_entry(entry: Entry, rows: Mapping[str, Row], better: Mapping[str, str]) -> Iterator[Superseded]:
    if not entry.key:
        return
    row = rows.get(entry.url)
    if row is not None and row["state"] == MISSING:
        yield Superseded(entry.url, entry.key, GONE, "")
    elif row is not None and row["source_id"] != entry.source_id:
        yield Superseded(entry.url, entry.key, CHANGED_FILE, "")
    elif entry.analysis_version != analysis_version():
        yield Superseded(entry.url, entry.key, OLD_ANALYSIS, "")
    elif entry.url in better:
        yield Superseded(entry.url, entry.key, OTHER_VERSION, better[entry.url])
