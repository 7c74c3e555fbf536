"""Sessions of an archive in order of time, each recording once."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

Row = Mapping[str, Any]
"""row of results by column"""


def start_seconds(created: str | None) -> float:
    """Start time [s since 1970] of a session from its ISO 8601 text, UTC without a zone; NaN if unknown."""
    try:
        moment = datetime.fromisoformat(created or "")
    except ValueError:
        return math.nan
    return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()


def distinct_sessions(rows: Sequence[Row]) -> list[Row]:
    """Rows of sessions by start time, one per recording id; those without a start time are last.

    Of several rows with one recording id (versions of one session, such as a rebased or a recovered one) the
    one with the most strikes counts, of equal ones that analysed last; rows without a recording id all count.
    Sessions that began in the same second are in the order of recording id and URL.

    Args:
        rows: rows of results as dicts by column.
    """
    latest: dict[str, Row] = {}
    alone: list[Row] = []
    for row in rows:
        name = row["recording_id"]
        if not name:
            alone.append(row)
        elif name not in latest or _rank(row) >= _rank(latest[name]):
            latest[name] = row
    return sorted([*latest.values(), *alone], key=_order)


def _rank(row: Row) -> tuple[int, float, str]:
    analysed = _or_first(start_seconds(row["analysed_at"]))
    return row["strikes_recorded"] or 0, analysed, str(row["url"])


def _order(row: Row) -> tuple[bool, float, str, str]:
    start = start_seconds(row["created"])
    return math.isnan(start), _or_first(start), str(row["recording_id"] or ""), str(row["url"])


def _or_first(seconds: float) -> float:
    return -math.inf if math.isnan(seconds) else seconds
