"""Recordings of a catalogue that are copies of each other, or versions of one session."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from analyze.catalogue.index import EXACT, LOSSY, MISSING, OK
from analyze.catalogue.scrub import ALTERED, DAMAGED, WHOLE
from analyze.catalogue.table import Row

SAME_CONTENT, SAME_SESSION = "same content", "same session"


@dataclass(frozen=True)
class CopyGroup:
    """Recordings of which one would do."""

    kind: str
    """"same content": the same messages, or images that `analyze compact` recoded without loss; "same
    session": one recording id with other contents (recovered, cut, or compacted with loss)"""
    best: Row
    """recording to keep: whole, without loss, with the most strikes, and compact"""
    others: tuple[Row, ...]
    """the others, each with its row"""

    @property
    def other_bytes(self) -> int:
        """Size of the others [bytes]."""
        return sum(row["size_bytes"] for row in self.others)


def find_copies(rows: Sequence[Row]) -> list[CopyGroup]:
    """Groups of recordings that are copies of each other or versions of one session, the largest first.

    A recording without a content hash (no seal, or not readable) is compared by the SHA-256 of its files, if
    it was scrubbed. Copies with other object files (`analyze rebase`) are versions of one session. Links to a
    file are no copies of it.

    Args:
        rows: rows of the catalogue; missing recordings are left out.
    """
    present = _without_links([row for row in rows if row["state"] != MISSING])
    groups = [_group(SAME_CONTENT, each) for each in _linked(present, _content_marks)]
    # Of copies one stands for all: the versions of a session differ.
    copies = {row["url"] for group in groups for row in group.others}
    distinct = [row for row in present if row["url"] not in copies]
    groups += [_group(SAME_SESSION, each) for each in _linked(distinct, _session_marks)]
    return sorted(groups, key=lambda group: (-group.other_bytes, group.best["url"]))


def _without_links(rows: Sequence[Row]) -> list[Row]:
    """Rows without those whose file is that of another row: a link, or another spelling of its path."""
    found: dict[object, Row] = {}
    for row in rows:
        file = _file_identity(row["url"])
        if file not in found or _is_link(row) < _is_link(found[file]):
            found[file] = row
    return list(found.values())


def _file_identity(url: str) -> object:
    """Device and number of a local file; its URL if it is not local, or not there."""
    try:
        about = os.stat(url)  # noqa: PTH116 - of thousands of files
    except (OSError, ValueError):
        return url
    # Some network file systems number no files.
    return (about.st_dev, about.st_ino) if about.st_ino else url


def _is_link(row: Row) -> bool:
    return os.path.realpath(row["url"]) != row["url"]


def _content_marks(row: Row) -> Iterator[str]:
    """Texts of which recordings with the same content share one."""
    if row["content_id"]:
        yield f"{row['content_id']} {row['object_sha256']}"
        if row["compaction"] == EXACT and row["source_content_id"]:
            yield f"{row['source_content_id']} {row['object_sha256']}"
    elif row["sha256"]:
        yield " ".join(row["sha256"])


def _session_marks(row: Row) -> Iterator[str]:
    if row["recording_id"]:
        yield row["recording_id"]


def _linked(rows: Sequence[Row], marks: Callable[[Row], Iterator[str]]) -> list[list[Row]]:
    """Sets of two or more rows that share marks, directly or by others between them."""
    parent: dict[str, str] = {}

    def root(mark: str) -> str:
        parent.setdefault(mark, mark)
        while parent[mark] != mark:
            parent[mark] = mark = parent[parent[mark]]
        return mark

    marked = [(row, list(marks(row))) for row in rows]
    for _, own in marked:
        for mark in own[1:]:
            parent[root(mark)] = root(own[0])
    sets: dict[str, list[Row]] = {}
    for row, own in marked:
        if own:
            sets.setdefault(root(own[0]), []).append(row)
    return [each for each in sets.values() if len(each) > 1]


def _group(kind: str, rows: Sequence[Row]) -> CopyGroup:
    ordered = sorted(rows, key=_preference)
    return CopyGroup(kind, ordered[0], tuple(ordered[1:]))


def _preference(row: Row) -> tuple[object, ...]:
    """Sort key: the recording to keep comes first."""
    return (
        row["state"] != OK,
        row["scrub"] in {DAMAGED, ALTERED},
        row["compaction"] == LOSSY,
        row["losses"] or 0,
        -(row["rebases"] or 0),
        -((row["strikes"] or 0) + (row["tosses"] or 0)),
        row["scrub"] != WHOLE,
        row["size_bytes"],
        row["url"],
    )
