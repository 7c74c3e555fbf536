"""Predictions as a document (JSON) and as a table on the terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.predict.assets import ESTIMATED, SHELL, UNIFORM
from analyze.result.digits import number
from analyze.result.rounding import rounded
from schemas.predictions import (
    AngleErrorResult,
    AssetErrors,
    PredictedStrikeResult,
    PredictionsResult,
    SkippedStrikeResult,
)
from schemas.terminal import Terminal, styled
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.predict.predict import AngleError, Predictions

_HEADINGS = {ESTIMATED: "estimated (°)", UNIFORM: "uniform (°)", SHELL: "shell (°)"}


def predictions_document(found: Predictions) -> PredictionsResult:
    """Document of predicted strikes."""
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
    median = {
        name: AngleErrorResult(rms_rad=found.median_rms(name), largest_rad=found.median_largest(name))
        for name in _HEADINGS
    }
    return rounded(
        PredictionsResult(
            object=found.name,
            strikes=strikes,
            skipped=[
                SkippedStrikeResult(strike_id=each.strike_id, reason=each.reason) for each in found.skipped
            ],
            median=AssetErrors(estimated=median[ESTIMATED], uniform=median[UNIFORM], shell=median[SHELL]),
        )
    )


def _error(error: AngleError) -> AngleErrorResult:
    return AngleErrorResult(rms_rad=error.rms, largest_rad=error.largest)


def render_predictions(document: PredictionsResult, console: Terminal | None = None) -> None:
    """Print predicted strikes: the answer in a sentence, then a table of the errors.

    Args:
        document: the predictions.
        console: console to print on; None for standard output.
    """
    console = console or Terminal()
    own, uniform = document.median.estimated.rms_rad, document.median.uniform.rms_rad
    console.print(
        styled(
            (document.object, "bold"),
            f", {counted(len(document.strikes), 'strike')}, each simulated without knowing it: the tipping"
            f" angle is off by {_degrees(own)}° (median of the rms), with a uniform density by"
            f" {_degrees(uniform)}°.",
        )
    )
    table = Table(
        title="Error of the simulated tipping angle, rms (largest)", title_justify="left", box=SIMPLE_HEAD
    )
    for heading in ("strike", "frames", *_HEADINGS.values(), "friction"):
        table.add_column(heading, justify="left" if heading == "strike" else "right")
    for strike in document.strikes:
        friction = "default" if strike.friction is None else number(strike.friction, 2)
        table.add_row(
            strike.strike_id,
            str(strike.frames),
            *_cells(strike.errors),
            f"≥ {friction}" if strike.friction_is_bound else friction,
        )
    table.add_row("median", "", *_cells(document.median), "")
    console.print(table)
    for skipped in document.skipped:
        console.print(styled((skipped.strike_id, "yellow"), f": not predicted: {skipped.reason}"))


def _cells(errors: AssetErrors) -> list[str]:
    return [
        f"{_degrees(each.rms_rad)} ({_degrees(each.largest_rad)})"
        for each in (errors.estimated, errors.uniform, errors.shell)
    ]


def _degrees(angle: float) -> str:
    return number(math.degrees(angle), 2 if math.degrees(angle) < 10 else 0)
