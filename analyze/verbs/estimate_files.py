"""Estimate or comparison of the recordings that a command line names, with a progress bar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from analyze.verbs.options import chosen_cache

if TYPE_CHECKING:
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.result.answer import Answer
    from analyze.result.comparison import SessionComparison


def estimate_files(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], no_cache: bool
) -> Answer:
    """Estimate one object from the strikes of all recordings together, with a progress bar.

    Args:
        files: recordings of the object.
        object_file: object file to use instead of the recordings'; None for the recordings' own.
        exclude: ids of strikes to leave out.
        no_cache: True to use and keep no results of earlier commands.

    Returns:
        One value with the estimate and its Result, the document that `analyze estimate --json` prints.

    Raises:
        AnalyzeError: a recording or the object cannot be used, or the strikes do not suffice.
    """
    # The code's version is read before the code is loaded.
    cache = chosen_cache(no_cache)
    from analyze.progress import ProgressBar
    from analyze.result.answer import answer_recordings

    with ProgressBar() as progress:
        return answer_recordings(files, _options(object_file, exclude), progress, cache)


def compare_files(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], no_cache: bool
) -> SessionComparison:
    """Estimate one object from each recording by itself and from all together, with a progress bar.

    Args:
        files: two or more recordings of the object, each one session.
        object_file: object file to use instead of the recordings'; None for the recordings' own.
        exclude: ids of strikes to leave out.
        no_cache: True to use and keep no results of earlier commands.

    Returns:
        Answer of each session, joint answer, and tests of their agreement.

    Raises:
        AnalyzeError: a recording or the object cannot be used, or the strikes of one do not suffice.
    """
    # The code's version is read before the code is loaded.
    cache = chosen_cache(no_cache)
    from analyze.progress import ProgressBar
    from analyze.result.comparison import compare_recordings

    with ProgressBar() as progress:
        return compare_recordings(files, _options(object_file, exclude), progress, cache)


def _options(object_file: Path | None, exclude: tuple[str, ...]) -> EstimateOptions:
    from analyze.pipeline.estimate import EstimateOptions

    return EstimateOptions(object_path=object_file, exclude=frozenset(exclude))
