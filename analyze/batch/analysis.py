"""Analyse one recording of a batch: write its row of results, or a failure row with the reason."""

from __future__ import annotations

import time
from contextlib import nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2

from analyze.batch.archive import PART_SUFFIX, Source
from analyze.batch.peak_memory import PeakMemory
from analyze.batch.result_rows import answer_columns, store_row
from analyze.batch.settings import BatchSettings, analysis_version, key_of
from analyze.batch.sparse_copy import sparse_copies
from analyze.batch.unwritable import NO_SPACE, cannot_be_written
from analyze.batch.worker_messages import FAILURES, OUT_OF_MEMORY, ROWS, Outcome, Request
from analyze.errors import (
    AnalyzeError,
    EstimationError,
    PlanError,
    RecordingCut,
    RecordingError,
    RecordingForeign,
    RecordingVersion,
    ShapeError,
    TrackingError,
)
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.evidence import RecordingHead
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.reading.verify import refuse_changed_content
from analyze.result.answer import answer_evidence


class _NoStrikesError(EstimationError):
    """The recording contains no strike, so that there is nothing to estimate from."""


FAILURE_OF_ERROR: tuple[tuple[type[Exception], str], ...] = (
    (RecordingCut, "cut"),
    (RecordingForeign, "foreign"),
    (RecordingVersion, "other_version"),
    (RecordingError, "damaged"),
    (ShapeError, "shape"),
    (PlanError, "plan"),
    (TrackingError, "no_marker"),
    (_NoStrikesError, "no_strikes"),
    (EstimationError, "too_few_strikes"),
    (AnalyzeError, "refused"),
    (OSError, "unreachable"),
)
"""kind of failure by class of the exception; the first class that matches counts, "defect" if none does"""


def analyse(request: Request, scratch: Path) -> Outcome:
    """Analyse one recording and write its row into the folder of results.

    A recording that cannot be analysed gives a failure row with the reason, not an exception. Nothing is
    written for a recording whose content has a result with these settings already.

    Args:
        request: the recording, the settings and the folder of results.
        scratch: folder on the same disk as the results, for unfinished files.

    Returns:
        Outcome with the key of the row (hash that names its file), or with kind and reason of the failure.

    Raises:
        ArchiveError: the results cannot be written, or the object file has changed since the run began.
        ShapeError: the object file can no longer be read.
    """
    source, output = request.source, Path(request.output)
    request.settings.refuse_changed_object()
    start = time.monotonic()
    common = {
        "url": source.url,
        "size_bytes": source.size,
        "source_id": source.id,
        "settings": request.settings.digest,
        "analysis_version": analysis_version(),
    }
    key, files = "", [source.url.rsplit("/", 1)[-1]]
    with PeakMemory() as memory:
        try:
            if source.size == 0:
                raise RecordingCut(f"{source.url}: is empty: nothing of it can be saved: record again")
            local = nullcontext(Path(source.url)) if source.is_local else None
            with local or sparse_copies(source, scratch, whole=request.verify) as path:
                head = read_head(path)
                files, key = list(head.files), key_of(head, request.settings)
                if request.verify:
                    refuse_changed_content(path)
                if (output / ROWS / f"{key}.parquet").exists():
                    return Outcome(
                        source.url,
                        source.id,
                        key,
                        seconds=time.monotonic() - start,
                        known=True,
                        own_files=files,
                    )
                columns = {**_row(head, request.settings), "status": "ok", "key": key}
        except Exception as error:
            if isinstance(error, OSError) and error.errno in NO_SPACE:
                raise cannot_be_written(output, error) from None  # a copy from a bucket
            columns = {"status": "failed", **_failure(error, source, scratch), "files": files, "key": None}
            key = ""
    stamps = {
        "seconds": time.monotonic() - start,
        "peak_memory_bytes": memory.peak_bytes,
        "analysed_at": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    name = f"{ROWS}/{key}.parquet" if key else f"{FAILURES}/{source.id}.parquet"
    store_row({**common, **columns, **stamps}, scratch, output, name)
    return Outcome(
        source.url,
        source.id,
        key,
        columns.get("failure", ""),
        columns.get("reason", ""),
        stamps["seconds"],
        own_files=files,
    )


def failure_kind(error: Exception, source: Source) -> str:
    """Kind of a failure to read or analyse a recording, such as "damaged"; "defect" for an unknown error."""
    if source.files[0].size == 0:
        return "empty"
    kind = next((name for each, name in FAILURE_OF_ERROR if isinstance(error, each)), "defect")
    return "unfinished" if kind == "cut" and source.url.endswith(PART_SUFFIX) else kind


def _row(head: RecordingHead, settings: BatchSettings) -> dict[str, Any]:
    if not head.strike_ids:
        raise _NoStrikesError(f"{head.path}: contains no strike: the session ended before the first one")
    object_path = Path(settings.object_path) if settings.object_path else None
    options = EstimateOptions(object_path, estimator=settings.estimator or None, seed=settings.seed)
    return answer_columns(answer_evidence(read_evidence(head, object_path), options))


def _failure(error: Exception, source: Source, scratch: Path) -> dict[str, str]:
    # Copies in the scratch folder are gone when the message is read: name the file in the archive.
    text = " ".join(str(error).split()).replace(f"{scratch}/", source.url.rpartition("/")[0] + "/")
    kind = failure_kind(error, source)
    if isinstance(error, MemoryError) or (isinstance(error, cv2.error) and "memory" in text.lower()):
        kind = OUT_OF_MEMORY
        remedy = "raise --memory-limit and add --only-failed"
        text = f"{source.url}: needs more memory than a worker may use: {remedy}"
    if source.is_local and not Path(source.url).exists():
        kind = "unreachable"
        text = f"{source.url}: does not exist: it was removed meanwhile, or is a link to a missing file"
    if kind == "defect":
        text = f"{source.url}: {type(error).__name__}: {text}: please report this"
    return {
        "failure": kind,
        "reason": text if source.url.rsplit("/", 1)[-1] in text else f"{source.url}: {text}",
    }
