"""One recording analysed: its row written, or the reason why there is none."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2

from analyze.batch.archive import PART_SUFFIX, Source
from analyze.batch.memory import PeakMemory
from analyze.batch.request import FAILURES, OUT_OF_MEMORY, ROWS, Outcome, Request
from analyze.batch.settings import BatchSettings, analysis_version, key_of
from analyze.batch.sparse_copy import sparse_copies
from analyze.batch.table import answer_columns, write_row
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
from analyze.pipeline.estimate import EstimateOptions, estimate_evidence
from analyze.pipeline.evidence import RecordingHead, read_evidence, read_head
from analyze.reading.verify import refuse_changed_content

_NO_STRIKES = "no_strikes"
_KINDS: tuple[tuple[type[Exception], str], ...] = (
    (RecordingCut, "cut"),
    (RecordingForeign, "foreign"),
    (RecordingVersion, "other_version"),
    (RecordingError, "damaged"),
    (ShapeError, "shape"),
    (PlanError, "plan"),
    (TrackingError, "no_marker"),
    (EstimationError, "too_few_strikes"),
    (AnalyzeError, "refused"),
    (MemoryError, OUT_OF_MEMORY),
    (OSError, "unreachable"),
)


def analyse(request: Request, scratch: Path) -> Outcome:
    """Analyse one recording and write its row into the folder of results; never raises for what the recording is like.

    Args:
        request: what to analyse.
        scratch: an empty folder on the same disk as the results, for what is half done.

    Raises:
        OutputError: the results cannot be written.
        ArchiveError: the object file is not the one that the run began with.
    """
    source, output = request.source, Path(request.output)
    request.settings.refuse_changed_object()
    start = time.monotonic()
    common = {
        "url": source.url, "size_bytes": source.size, "source_id": source.id, "settings": request.settings.digest,
        "analysis_version": analysis_version(),
    }  # fmt: skip
    key, files = "", [source.url.rsplit("/", 1)[-1]]
    with PeakMemory() as memory:
        try:
            if source.size == 0:
                raise RecordingCut(f"{source.url}: is empty: nothing of this recording can be saved: record again")
            with _at_hand(source, scratch, whole=request.verify) as path:
                head = read_head(path)
                files, key = list(head.files), key_of(head.content_id, request.settings)
                if request.verify:
                    refuse_changed_content(path)
                if (output / ROWS / f"{key}.parquet").exists():
                    return Outcome(source.url, source.id, key, seconds=time.monotonic() - start, known=True, own_files=files)
                columns = {**_answer(head, request.settings), "status": "ok", "key": key}
        except Exception as error:
            columns = {"status": "failed", **_failure(error, source, scratch), "files": files, "key": None}
            key = ""
    stamps = {
        "seconds": time.monotonic() - start,
        "peak_memory_bytes": memory.peak_bytes,
        "analysed_at": datetime.now(UTC).isoformat(timespec="seconds"),
    }
    row = {**common, **columns, **stamps}
    part = scratch / "row.parquet"
    write_row(row, part)
    folder, name = (ROWS, key) if key else (FAILURES, source.id)
    os.replace(part, output / folder / f"{name}.parquet")  # noqa: PTH105 - Path.replace is the same
    return Outcome(source.url, source.id, key, columns.get("failure", ""), columns.get("reason", ""), stamps["seconds"], own_files=files)


def _answer(head: RecordingHead, settings: BatchSettings) -> dict[str, Any]:
    if not head.strike_ids:
        raise _NoStrikes(f"{head.path}: holds no strike: nothing was struck, or the session ended before")
    evidence = read_evidence(head, Path(settings.object_path) if settings.object_path else None)
    options = EstimateOptions(
        object_path=Path(settings.object_path) if settings.object_path else None, estimator=settings.estimator or None, seed=settings.seed
    )
    return answer_columns(estimate_evidence(evidence, options))


class _NoStrikes(EstimationError):
    """A recording in which nothing was struck."""


def _failure(error: Exception, source: Source, scratch: Path) -> dict[str, str]:
    # What was fetched into the scratch folder is gone when somebody reads this.
    text = " ".join(str(error).split()).replace(f"{scratch}/", source.url.rpartition("/")[0] + "/")
    if isinstance(error, _NoStrikes):
        kind = _NO_STRIKES
    elif isinstance(error, MemoryError) or (isinstance(error, cv2.error) and "memory" in text.lower()):
        kind, text = (
            OUT_OF_MEMORY,
            f"{source.url}: more memory was needed than a worker may have: raise --memory-limit and add --only-failed",
        )
    else:
        kind = next((name for each, name in _KINDS if isinstance(error, each)), "defect")
    if source.is_local and not Path(source.url).exists():
        kind, text = "unreachable", f"{source.url}: is not there: it was removed meanwhile, or is a link to what is not there"
    elif source.files[0].size == 0:
        kind = "empty"
    elif source.url.endswith(PART_SUFFIX) and kind == "cut":
        kind = "unfinished"
    if kind == "defect":
        text = f"{source.url}: {type(error).__name__}: {text}: please report this"
    return {"failure": kind, "reason": text if source.url.rsplit("/", 1)[-1] in text else f"{source.url}: {text}"}


@contextmanager
def _at_hand(source: Source, scratch: Path, *, whole: bool) -> Iterator[Path]:
    if source.is_local:
        yield Path(source.url)
        return
    with sparse_copies(source, scratch, whole=whole) as path:
        yield path
