"""`analyze score`: the estimate compared with the ground truth of a virtual recording."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import click

from analyze.verbs.estimate_files import estimate_files
from analyze.verbs.options import files_argument, one_line, with_estimate_options
from schemas.plain_text import echo


@click.command()
@files_argument
@with_estimate_options
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def score(
    files: Sequence[Path], object_file: Path | None, exclude: tuple[str, ...], no_cache: bool, as_json: bool
) -> None:
    """Compare the estimate with the ground truth that virtual recordings contain."""
    from analyze.result.score import refuse_without_truth, render_score, score_answer

    refuse_without_truth(files)
    result = score_answer(files[0], estimate_files(files, object_file, exclude, no_cache))
    if as_json:
        echo(json.dumps(result, allow_nan=False))
    else:
        render_score(result)
