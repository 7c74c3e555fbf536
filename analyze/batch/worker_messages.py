"""Messages between a batch run and its worker processes, and rows of recordings whose worker failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
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
    """recording in the archive"""
    settings: BatchSettings
    """settings of the analysis"""
    output: str
    """path of the folder of results"""
    verify: bool = False
    """True to compare the recording's content with its seal (the hash stored when it was recorded)"""

    @classmethod
    def from_fields(cls, fields: Mapping[str, Any]) -> Request:
        """Build a request from the dict that `dataclasses.asdict` made of it."""
        files = tuple(SourceFile(**each) for each in fields["source"]["files"])
        return cls(Source(files), BatchSettings(**fields["settings"]), fields["output"], fields["verify"])


@dataclass(frozen=True)
class Outcome:
    """Outcome of one recording's analysis: key of its row of results, or why the analysis failed.

    The key is a hash that names the row's file. A failure is stated by kind and reason. The recording's URL
    and hash, and the time taken [s], are held too.
    """

    url: str
    """URL or local path of the recording's first file"""
    source_id: str
    """hash of URL, size and stamp (time of change or ETag) of the recording's files"""
    key: str = ""
    """key of the recording's row of results; "" if the analysis failed"""
    failure: str = ""
    """kind of failure; "" if the analysis succeeded"""
    reason: str = ""
    """reason for the failure, one sentence; "" if the analysis succeeded"""
    seconds: float = 0.0
    """time that the analysis took [s]"""
    known: bool = False
    """True if the same content had been analysed before with these settings, so that no row was written"""
    own_files: list[str] = field(default_factory=list[str])
    """names of the files that belong to the recording; empty if its worker failed"""


def write_failure(request: Request, failure: str, reason: str, seconds: float, scratch: Path) -> Outcome:
    """Write the failure row of a recording whose worker ended or was stopped at its time limit.

    The row is the file `FAILURES`/<source id>.parquet in the request's folder of results; an earlier one is
    replaced.

    Args:
        request: request that was not answered; its folder of results must exist.
        failure: kind of failure.
        reason: reason, one sentence.
        seconds: time that the analysis took [s].
        scratch: folder for the unfinished file, on the disk of the results.

    Returns:
        Outcome with kind and reason of the failure.

    Raises:
        ArchiveError: the row cannot be written.
    """
    source = request.source
    from analyze.batch.result_rows import store_row  # slow to import, and an unchanged archive needs no row

    store_row(
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
        scratch,
        Path(request.output),
        f"{FAILURES}/{source.id}.parquet",
    )
    return Outcome(source.url, source.id, "", failure, reason, seconds)
