"""Messages between a batch run and its workers, and rows of recordings whose worker failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from analyze.batch.archive import Source, SourceFile
from analyze.batch.settings import BatchSettings, analysis_version

ROWS, FAILURES = "recordings", "failures"
"""folders of the results: rows of recordings analysed, and rows of failures"""
OUT_OF_MEMORY, TIME_LIMIT, DIED = "out_of_memory", "time_limit", "died"


@dataclass(frozen=True)
class Request:
    """Request to analyse one recording."""

    source: Source
    settings: BatchSettings
    output: str
    verify: bool = False

    def json(self) -> dict[str, Any]:
        """The request as JSON values."""
        return asdict(self)

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Request:
        """The request from JSON values."""
        files = tuple(SourceFile(**each) for each in fields["source"]["files"])
        return cls(Source(files), BatchSettings(**fields["settings"]), fields["output"], fields["verify"])


@dataclass(frozen=True)
class Outcome:
    """Outcome of one recording's analysis."""

    url: str
    source_id: str
    key: str = ""
    """key of its row of results; "" if it failed"""
    failure: str = ""
    """kind of failure; "" if it succeeded"""
    reason: str = ""
    seconds: float = 0.0
    known: bool = False
    """True if the same content had been analysed before"""
    own_files: list[str] = field(default_factory=list[str])
    """names of the files that belong to its recording"""

    def json(self) -> dict[str, Any]:
        """The outcome as JSON values."""
        return asdict(self)


def write_failure(request: Request, failure: str, reason: str, seconds: float, scratch: Path) -> Outcome:
    """Write the failure row of a recording whose worker ended, and return its outcome."""
    source = request.source
    from analyze.batch.result_rows import write_row  # slow to import, and an unchanged archive needs no row

    part = scratch / "row.parquet"
    write_row(
        {
            "url": source.url,
            "size_bytes": source.size,
            "source_id": source.id,
            "settings": request.settings.digest,
            "analysis_version": analysis_version(),
            "status": "failed",
            "failure": failure,
            "reason": reason,
            "seconds": seconds,
            "analysed_at": datetime.now(UTC).isoformat(timespec="seconds"),
        },
        part,
    )
    part.replace(Path(request.output) / FAILURES / f"{source.id}.parquet")
    return Outcome(source.url, source.id, "", failure, reason, seconds)
