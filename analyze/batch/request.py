"""What a worker is asked and what it answers, as plain values, and the row of a recording whose worker could not answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from analyze.batch.archive import Source, SourceFile
from analyze.batch.settings import BatchSettings, analysis_version

ROWS, FAILURES = "recordings", "failures"
"""folders of the results"""
OUT_OF_MEMORY, TIME_LIMIT, DIED = "out_of_memory", "time_limit", "died"


@dataclass(frozen=True)
class Request:
    """What a worker is asked."""

    source: Source
    settings: BatchSettings
    output: str
    verify: bool = False

    def json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    @classmethod
    def of(cls, told: Mapping[str, Any]) -> Request:
        """From plain values."""
        files = tuple(SourceFile(**each) for each in told["source"]["files"])
        return cls(Source(files), BatchSettings(**told["settings"]), told["output"], told["verify"])


@dataclass(frozen=True)
class Outcome:
    """What became of a recording."""

    url: str
    source_id: str
    key: str = ""
    """"": there is no row of results"""
    failure: str = ""
    """"": there is"""
    reason: str = ""
    seconds: float = 0.0
    known: bool = False
    """its content had been analysed before"""
    own_files: list[str] = field(default_factory=list[str])
    """names of the files that its recording has"""

    def json(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)


def failed(request: Request, failure: str, reason: str, seconds: float, scratch: Path) -> Outcome:
    """Write the row of a recording whose worker ended."""
    source = request.source
    from analyze.batch.table import write_row  # a run over an archive that did not change writes none

    part = scratch / "row.parquet"
    write_row(
        {
            "url": source.url, "size_bytes": source.size, "source_id": source.id, "settings": request.settings.digest,
            "analysis_version": analysis_version(), "status": "failed", "failure": failure, "reason": reason, "seconds": seconds,
            "analysed_at": datetime.now(UTC).isoformat(timespec="seconds"),
        },
        part,
    )  # fmt: skip
    part.replace(Path(request.output) / FAILURES / f"{source.id}.parquet")
    return Outcome(source.url, source.id, "", failure, reason, seconds)
