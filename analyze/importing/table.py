"""What an import is going to write, for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

if TYPE_CHECKING:
    from analyze.importing.run import Import
    from analyze.importing.windows import Film, StrikeWindow
    from analyze.importing.write_recording import Written


def render_import(prepared: Import) -> list[str]:
    """A line per strike: which source became it, and where it lies in that; then what is to be said of sources and camera.

    Returns:
        The sources' remarks that were said.
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("strike", "source", "tags at rest"):
        table.add_column(name, overflow="fold")
    for name in ("from s", "moves at s", "to s"):
        table.add_column(name, justify="right")
    table.add_column("", overflow="fold")
    for window in prepared.windows:
        film, onset = prepared.films[window.film], window.onset
        seen = "" if onset is None else ", ".join(str(name) for name in onset.markers)
        end_ns = film.last_ns if window.end_ns is None else window.end_ns
        moves = "" if onset is None else f"{onset.time_ns * 1e-9:.2f}"
        start, end = f"{(window.start_ns or 0) * 1e-9:.2f}", "its end" if end_ns is None else f"{end_ns * 1e-9:.2f}"
        table.add_row(window.strike_id, escape(film.path.name), seen, start, moves, end, _note(prepared, film, window))
    Console().print(table)
    click.echo(f"{prepared.rate_hz:.6g} frames per second; {prepared.formats}")
    if prepared.place is not None:
        apart = f"{math.degrees(prepared.place.apart_rad):.2f} deg and {1000 * prepared.place.apart_m:.1f} mm"
        views = prepared.place.views
        checked = "1 strike, which no other checks" if views == 1 else f"{views} strikes, which agree within {apart} (rms)"
        click.echo(f"the camera is placed by the object at rest in {checked}")
    return _remark(prepared.remarks())


def render_written(written: Written, said: list[str]) -> None:
    """What came of it, with what was only seen while it was written."""
    _remark([remark for remark in written.remarks if remark not in said])
    size = f"{written.size / 1e6:.1f} MB"
    click.echo(
        f"written: {written.path}: {written.strikes} strikes, {written.images} images, {size}; now `analyze estimate {written.path}`"
    )


def _remark(lines: list[str]) -> list[str]:
    for line in lines:
        click.echo(line, err=True)
    return lines


def _note(prepared: Import, film: Film, window: StrikeWindow) -> str:
    notes: list[str] = []
    if window.onset is None:
        return f"no tip is seen, all of it is taken: {film.why_none}" if film.last_ns is not None else ""
    if len(film.onsets) > 1 and not prepared.was_split:
        notes.append(f"{len(film.onsets)} tips are seen: the first is taken")
    planned = next(strike for strike in prepared.plan.strikes if strike.id == window.plan_strike_id)
    if planned.visible_markers and not set(planned.visible_markers) & set(window.onset.markers):
        notes.append(f"the plan has tag {', '.join(str(name) for name in planned.visible_markers)} in view")
    return "; ".join(notes)
