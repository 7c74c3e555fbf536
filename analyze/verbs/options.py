"""What the verbs share: how a problem is told, and the options of those that estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.errors import AnalyzeError
from schemas.command_line import one_line_errors

if TYPE_CHECKING:
    from analyze.pipeline.comparison import SessionComparison
    from analyze.pipeline.estimate import Estimate

one_line = one_line_errors("analyze", AnalyzeError)
files_argument = click.argument("files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
_estimate_options = [
    click.option("--object", "object_file", type=click.Path(path_type=Path), help="Use this object file instead of the recording's."),
    click.option("--exclude", multiple=True, metavar="STRIKE", help="Leave a strike out (id as in the report); may be repeated."),
]


def with_estimate_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """--object and --exclude."""
    for option in reversed(_estimate_options):
        function = option(function)
    return function


def estimated(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]) -> Estimate:
    """What the files tell, with a bar that shows how far it is."""
    from analyze.pipeline.estimate import EstimateOptions, estimate_recordings
    from analyze.progress import StrikeProgress

    with StrikeProgress() as progress:
        return estimate_recordings(files, EstimateOptions(object_path=object_file, exclude=frozenset(exclude)), progress)


def compared(files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...]) -> SessionComparison:
    """What each file tells by itself, and how they agree, with a bar that shows how far it is."""
    from analyze.pipeline.comparison import compare_recordings
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.progress import StrikeProgress

    with StrikeProgress() as progress:
        return compare_recordings(files, EstimateOptions(object_path=object_file, exclude=frozenset(exclude)), progress)
