"""The recordings of a command line, estimated or compared with a progress bar."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from analyze.result.answer import Answer
    from analyze.result.comparison import SessionComparison


def estimate_files(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]) -> Answer:
    """Estimate from all recordings together, with a progress bar."""
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.progress import ProgressBar
    from analyze.result.answer import answer_recordings

    with ProgressBar() as progress:
        return answer_recordings(
            files, EstimateOptions(object_path=object_file, exclude=frozenset(exclude)), progress
        )


def compare_files(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]
) -> SessionComparison:
    """Estimate from each recording by itself and compare the estimates, with a progress bar."""
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.progress import ProgressBar
    from analyze.result.comparison import compare_recordings

    with ProgressBar() as progress:
        return compare_recordings(
            files, EstimateOptions(object_path=object_file, exclude=frozenset(exclude)), progress
        )
