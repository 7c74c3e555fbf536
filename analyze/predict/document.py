"""Predictions as a document (JSON) and as a table on the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.predict.assets import ESTIMATED, SHELL, UNIFORM
from analyze.result.digits import number
from analyze.result.rounding import rounded
from schemas.predictions import (
    AngleErrorResult,
    AssetErrors,
    PredictedStrikeResult,
    PredictedTossResult,
    PredictionsResult,
    SkippedStrikeResult,
    SkippedTossResult,
)
from schemas.terminal import Terminal, styled
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.predict.angle_error import AngleError
    from analyze.predict.predict import Predictions

_HEADINGS = ("estimated (°)", "uniform (°)", "shell (°)")


def predictions_document(found: Predictions) -> PredictionsResult:
    """Document of predicted strikes and tosses."""
    strikes = [
        PredictedStrikeResult(
            strike_id=each.strike_id,
            frames=len(each.time) - each.start,
            seconds=float(each.time[-1]),
            friction=each.friction,
            friction_is_bound=each.friction_is_bound,
            errors=AssetErrors(
                estimated=_error(each.error(ESTIMATED)),
                uniform=_error(each.error(UNIFORM)),
                shell=_error(each.error(SHELL)),
            ),
        )
        for each in found.strikes
    ]
    tosses = [
        PredictedTossResult(
            toss_id=each.toss_id,
            frames=len(each.time),
            seconds=float(each.time[-1]),
            measured_sd_rad=float(np.median(each.measured_sd)),
            errors=AssetErrors(
                estimated=_error(each.error(ESTIMATED)),
                uniform=_error(each.error(UNIFORM)),
                shell=_error(each.error(SHELL)),
            ),
        )
        for each in found.tosses
    ]
    return rounded(
        PredictionsResult(
            object=found.name,
            strikes=strikes,
            skipped=[
                SkippedStrikeResult(strike_id=each.strike_id, reason=each.reason) for each in found.skipped
            ],
            median=_median([each.errors for each in strikes]),
            tosses=tosses,
            skipped_tosses=[
                SkippedTossResult(toss_id=each.toss_id, reason=each.reason) for each in found.skipped_tosses
            ],
            toss_median=_median([each.errors for each in tosses]),
        )
    )


def _error(error: AngleError) -> AngleErrorResult:
    return AngleErrorResult(rms_rad=error.rms, largest_rad=error.largest)


def _median(errors: Sequence[AssetErrors]) -> AssetErrors | None:
    """Medians of the errors by body; None without any."""
    if not errors:
        return None

    def over(some: list[AngleErrorResult]) -> AngleErrorResult:
        return AngleErrorResult(
            rms_rad=float(np.median([each.rms_rad for each in some])),
            largest_rad=float(np.median([each.largest_rad for each in some])),
        )

    return AssetErrors(
        estimated=over([each.estimated for each in errors]),
        uniform=over([each.uniform for each in errors]),
        shell=over([each.shell for each in errors]),
    )


def render_predictions(document: PredictionsResult, console: Terminal | None = None) -> None:
    """Print predicted strikes and tosses: the answer in a sentence each, then a table of the errors.

    Args:
        document: the predictions.
        console: console to print on; None for standard output.
    """
    console = console or Terminal()
    if document.median is not None:
        count = counted(len(document.strikes), "strike")
        console.print(styled((document.object, "bold"), _sentence(count, "tipping angle", document.median)))
        console.print(_strike_table(document.strikes, document.median))
    for skipped in document.skipped:
        console.print(styled((skipped.strike_id, "yellow"), f": not predicted: {skipped.reason}"))
    if document.toss_median is not None:
        count = counted(len(document.tosses), "toss")
        console.print(styled((document.object, "bold"), _sentence(count, "attitude", document.toss_median)))
        console.print(_toss_table(document.tosses, document.toss_median))
    for skipped in document.skipped_tosses:
        console.print(styled((skipped.toss_id, "yellow"), f": not predicted: {skipped.reason}"))


def _sentence(count: str, angle: str, median: AssetErrors) -> str:
    return (
        f", {count}, each simulated without knowing it: the {angle} is off by"
        f" {_degrees(median.estimated.rms_rad)}° (median of the rms), with a uniform density by"
        f" {_degrees(median.uniform.rms_rad)}°."
    )


def _strike_table(strikes: Sequence[PredictedStrikeResult], median: AssetErrors) -> Table:
    table = _table("Error of the simulated tipping angle, rms (largest)", "strike", "friction")
    for strike in strikes:
        friction = "default" if strike.friction is None else number(strike.friction, 2)
        table.add_row(
            strike.strike_id,
            str(strike.frames),
            *_cells(strike.errors),
            f"≥ {friction}" if strike.friction_is_bound else friction,
        )
    table.add_row("median", "", *_cells(median), "")
    return table


def _toss_table(tosses: Sequence[PredictedTossResult], median: AssetErrors) -> Table:
    table = _table("Error of the simulated attitude in flight, rms (largest)", "toss", "video (°)")
    for toss in tosses:
        table.add_row(
            toss.toss_id, str(toss.frames), *_cells(toss.errors), f"± {_degrees(toss.measured_sd_rad)}"
        )
    table.add_row("median", "", *_cells(median), "")
    return table


def _table(title: str, first: str, last: str) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD)
    for heading in (first, "frames", *_HEADINGS, last):
        table.add_column(heading, justify="left" if heading == first else "right")
    return table


def _cells(errors: AssetErrors) -> list[str]:
    return [
        f"{_degrees(each.rms_rad)} ({_degrees(each.largest_rad)})"
        for each in (errors.estimated, errors.uniform, errors.shell)
    ]


def _degrees(angle: float) -> str:
    return number(math.degrees(angle), 2 if math.degrees(angle) < 10 else 0)
