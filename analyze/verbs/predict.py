"""`analyze predict`: strikes and tosses left out of the estimate, simulated and compared with the video."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import click

from analyze.verbs.options import chosen_cache, files_argument, one_line, with_estimate_options
from schemas.document import canonical_json
from schemas.plain_text import echo, json_line

SOME_SKIPPED = 3
"""exit code where some strikes or tosses could not be predicted"""


@click.command()
@files_argument
@with_estimate_options
@click.option(
    "--strike",
    "strikes",
    multiple=True,
    metavar="STRIKE",
    help="Predict this strike only, by its id in the report; may be repeated.",
)
@click.option(
    "--toss",
    "tosses",
    multiple=True,
    metavar="TOSS",
    help="Predict this toss only, by its id in the report; may be repeated.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the errors as JSON.")
@one_line
def predict(
    files: Sequence[Path],
    object_file: Path | None,
    exclude: tuple[str, ...],
    no_cache: bool,
    strikes: tuple[str, ...],
    tosses: tuple[str, ...],
    as_json: bool,
) -> None:
    """Simulate each strike and toss with the body that all others give, and compare it with the video.

    MuJoCo starts just after the impact with the measured angle and rate, and in flight with the measured
    attitude, spin and velocity. The same is done with a body of uniform density and with a shell. Exit code 3
    if some strikes or tosses could not be predicted.
    """
    # The code's version is read before the code is loaded.
    cache = chosen_cache(no_cache)
    from analyze.export.formats import Format
    from analyze.export.read_back import refuse_without_reader
    from analyze.pipeline.estimate import EstimateOptions
    from analyze.predict.document import predictions_document, render_predictions
    from analyze.predict.predict import predict_recordings
    from analyze.progress import ProgressBar

    refuse_without_reader(Format.MJCF)
    options = EstimateOptions(object_path=object_file, exclude=frozenset(exclude))
    with ProgressBar() as progress:
        found = predict_recordings(files, options, (*strikes, *tosses), progress, cache)
    document = predictions_document(found)
    if as_json:
        echo(json_line(canonical_json(document)))
    else:
        render_predictions(document)
    if found.skipped or found.skipped_tosses:
        sys.exit(SOME_SKIPPED)
