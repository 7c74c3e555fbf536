"""Joint estimate of one object from its recordings: strikes are read, merged and estimated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from analyze.errors import EstimationError
from analyze.pipeline.cached import cached_strike_reader, cached_toss_reader, estimate_with_cache
from analyze.pipeline.estimate import Estimate, EstimateOptions
from analyze.pipeline.merge import (
    by_start_time,
    merge_evidence,
    paths_text,
    refuse_unmergeable,
    resolve_exclusions,
)
from analyze.pipeline.read_evidence import read_evidence, read_head

if TYPE_CHECKING:
    from analyze.cache.results import ResultCache
    from analyze.pipeline.evidence import Evidence, RecordingHead
    from analyze.progress import Progress


def estimate_recordings(
    paths: Sequence[Path],
    options: EstimateOptions | None = None,
    progress: Progress | None = None,
    cache: ResultCache | None = None,
) -> Estimate:
    """Estimate one object's centre of mass, inertia and masses of parts from one or several recordings.

    The order of the recordings does not matter.

    Args:
        paths: one or more recordings (MCAP).
        options: choices of the user; None for the defaults.
        progress: called with (text, done, total) before each strike, and before the estimate.
        cache: cache of strikes read and estimates made before; None to compute all anew.

    Returns:
        The joint estimate: centre of mass, inertia, masses of shell and interior parts, with checks and the
        evidence (fitted strikes).

    Raises:
        RecordingError: a file cannot be read.
        MergeError: the recordings are not of one object, or one is named twice.
        ShapeError: the object's file or shape cannot be used, or a label names a part that it does not have.
        PlanError: a plan is of another object or shape, or lacks a strike that was recorded.
        TrackingError: no marker of any strike of a recording can be tracked.
        EstimationError: fewer than three strikes can be used, an excluded id names no strike or several, or
            parts or filling cannot be estimated.
    """
    heads, options = mergeable_heads(paths, options)
    total = sum(len(head.strike_ids) for head in heads)
    read = read_recordings(heads, options, progress, cache)
    if progress is not None:
        progress("estimating", total, total)
    try:
        return estimate_with_cache(cache, merge_evidence(read), options)
    except EstimationError as error:
        raise EstimationError(f"{paths_text(heads)}: {error}") from None


def mergeable_heads(
    paths: Sequence[Path], options: EstimateOptions | None
) -> tuple[list[RecordingHead], EstimateOptions]:
    """Heads (identity and contents) of recordings of one object by start time, and the options for them.

    Args:
        paths: one or more recordings (MCAP).
        options: choices of the user; None for the defaults.

    Returns:
        The heads, and the options with the ids of excluded strikes as merging names them.

    Raises:
        RecordingError: a file cannot be read.
        MergeError: the recordings are not of one object, or one is named twice.
        EstimationError: an excluded id names no strike or several.
    """
    options = options or EstimateOptions()
    heads = by_start_time([read_head(path) for path in paths])
    if len(heads) > 1:
        refuse_unmergeable(heads, options.object_path is not None)
    return heads, replace(options, exclude=resolve_exclusions(heads, options.exclude))


def read_recordings(
    heads: Sequence[RecordingHead],
    options: EstimateOptions,
    progress: Progress | None,
    cache: ResultCache | None,
    further_steps: int = 0,
) -> list[Evidence]:
    """Evidence (fitted strikes) of each recording, read one after the other.

    Args:
        heads: identity and contents of the recordings.
        options: choices of the user; an object file among them replaces the recordings'.
        progress: called with (text, done, total) before each strike; of several recordings the text names
            the file.
        cache: cache of strikes read before; None to read all anew.
        further_steps: steps of the caller's work that follow, counted in the total.

    Raises:
        RecordingError: a file is damaged.
        ShapeError: the object's file or shape cannot be used.
        PlanError: a plan is of another object or shape, or lacks a strike that was recorded.
        TrackingError: no marker of any strike of a recording can be tracked.
    """
    total, done = sum(len(head.strike_ids) for head in heads) + further_steps, 0
    read: list[Evidence] = []
    for head in heads:
        mine = offset_progress(progress, done, total, f"{head.path.name}, " if len(heads) > 1 else "")
        read.append(
            read_evidence(
                head,
                options.object_path,
                mine,
                reader=cached_strike_reader(cache),
                toss_reader=cached_toss_reader(cache),
            )
        )
        done += len(head.strike_ids)
    return read


def offset_progress(progress: Progress | None, before: int, total: int, prefix: str = "") -> Progress | None:
    """Progress callback for one part of some work, which reports to `progress`, the callback of the whole.

    It adds `before`, the number of the whole's steps done earlier, to the part's number of steps done,
    reports `total` as the number of the whole's steps, and puts `prefix` in front of the part's texts. None
    is returned if `progress` is None.
    """
    if progress is None:
        return None
    return lambda text, done, _: progress(prefix + text, before + done, total)
