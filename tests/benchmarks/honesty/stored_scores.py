"""Scores kept in a file, one session per line, so that an interrupted trial goes on where it stopped."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

from tests.benchmarks.honesty.scores import Score, SessionScore


def read_scores(path: Path | None) -> list[SessionScore]:
    """Scores of the sessions in a file; none if there is no such file."""
    if path is None or not path.exists():
        return []
    found = []
    for line in path.read_text(encoding="utf-8").splitlines():
        entries = json.loads(line)
        scores = [Score(*each.values()) for each in entries.pop("scores")]
        found.append(SessionScore(**entries, scores=scores))
    return found


def append_scores(path: Path | None, sessions: Iterable[SessionScore]) -> None:
    """Append sessions to a file; nothing without a path."""
    if path is None:
        return
    with path.open("a", encoding="utf-8") as file:
        for session in sessions:
            file.write(json.dumps(asdict(session), default=float) + "\n")
