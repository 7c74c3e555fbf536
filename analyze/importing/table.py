"""Prints an import on the terminal: the strikes before writing, and the recording written."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from rich.table import Table

from analyze.tags.side_names import side_name
from schemas.edge_names import edge_names
from schemas.plain_text import echo
from schemas.terminal import Terminal
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.importing.edge_matches import EdgeFit
    from analyze.importing.prepared_import import PreparedImport
    from analyze.importing.windows import Clip, StrikeWindow
    from analyze.importing.write_recording import Written


def render_import(prepared: PreparedImport) -> list[str]:
    """Print a table of the strikes with sources and times [s], frame rate, format, and remarks.

    If the camera's pose was estimated from the object, its scatter is printed, too. Remarks go to standard
    error.

    Returns:
        The remarks that were printed.
    """
    if prepared.sources:
        Terminal().print(_found_table(prepared) if prepared.found is not None else _table(prepared))
        echo(f"strikes assigned {prepared.assignment.value}{_missing(prepared)}")
    if prepared.tosses:
        echo(f"tosses: {', '.join(source.name for source in prepared.tosses)}")
    echo(f"{prepared.rate_hz:.6g} frames per second; {prepared.formats}")
    if prepared.place is not None:
        degrees, millimetres = math.degrees(prepared.place.deviation_rad), 1000 * prepared.place.deviation_m
        scatter = f"{degrees:.2f} deg and {millimetres:.1f} mm"
        if prepared.found is not None:
            scatter = f"{degrees:.2f} deg of the vertical and {millimetres:.1f} mm of the height"
        views = prepared.place.views
        checked = (
            "1 strike, without a check by others"
            if views == 1
            else f"{counted(views, 'strike')}, which agree within {scatter} (rms)"
        )
        echo(f"the camera's pose comes from the object at rest in {checked}")
    if prepared.mat is not None:
        mat, degrees = prepared.mat, math.degrees(prepared.mat.turn_sd)
        what = "strike" if prepared.windows else "toss"
        sds = f"± {degrees:.2f} deg and {1000 * mat.place_sd:.1f} mm"
        echo(f"the camera's pose comes from the mat ({mat.paper}) in {counted(mat.views, what)}, {sds}")
    return _remark(prepared.remarks())


def _table(prepared: PreparedImport) -> Table:
    """Table of planned strikes: source, tags at rest, times of the window and of the first motion [s]."""
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("strike", "source", "tags at rest"):
        table.add_column(name, overflow="fold")
    for name in ("from s", "moves at s", "to s"):
        table.add_column(name, justify="right")
    table.add_column("", overflow="fold")
    for window in prepared.windows:
        clip, onset = prepared.clips[window.clip], window.onset
        seen = "" if onset is None else ", ".join(str(name) for name in onset.markers)
        end_ns = clip.last_ns if window.end_ns is None else window.end_ns
        moves = "" if onset is None else f"{onset.time_ns * 1e-9:.2f}"
        start = f"{(window.start_ns or 0) * 1e-9:.2f}"
        end = "its end" if end_ns is None else f"{end_ns * 1e-9:.2f}"
        table.add_row(
            window.strike_id, clip.path.name, seen, start, moves, end, _note(prepared, clip, window)
        )
    return table


def _found_table(prepared: PreparedImport) -> Table:
    """Table of strikes that nobody planned: source, time [s], face, heading, edge, and how sure they are.

    The differences are those between what is seen and the edge: of the one that was found, and of the one
    that comes next.
    """
    table = Table(box=None, pad_edge=False, header_style="bold")
    for name in ("strike", "source"):
        table.add_column(name, overflow="fold")
    table.add_column("moves at s", justify="right")
    table.add_column("rests on", overflow="fold")
    table.add_column("heading", justify="right")
    for name in ("tips over", "differs by", "next best"):
        table.add_column(name, overflow="fold")
    names, spec = edge_names(prepared.plan.strikes), prepared.object.spec
    for window, strike in zip(prepared.windows, prepared.found or (), strict=True):
        best, following = strike.match.best, strike.match.following
        axis = best.tip.axis
        onset = window.onset
        table.add_row(
            strike.strike_id,
            prepared.clips[window.clip].path.name,
            "" if onset is None else f"{onset.time_ns * 1e-9:.2f}",
            side_name(spec, -axis.plane.up).removeprefix("the "),
            f"{round(math.degrees(strike.heading))}°",
            f"{names[axis.id]} ({axis.id})",
            _difference(best),
            "" if following is None else f"{_difference(following)} ({following.tip.axis.id})",
        )
    return table


def _difference(fit: EdgeFit) -> str:
    """Larger one of the angles between what is seen and an edge with its face, and distance: "0.3° 1 mm"."""
    return f"{math.degrees(max(fit.angle, fit.lean)):.1f}° {1000 * fit.offset:.0f} mm"


def _missing(prepared: PreparedImport) -> str:
    """Words for the planned strikes that no source shows: "; not filmed: s4, s7"; "" if there is none."""
    shown = {window.plan_strike_id for window in prepared.windows}
    missing = [strike.id for strike in prepared.plan.strikes if strike.id not in shown]
    return f"; not filmed: {', '.join(missing)}" if missing else ""


def render_written(written: Written, shown: list[str]) -> None:
    """Print the remarks on a recording that was written, then its path and size and the next command.

    Args:
        written: the recording.
        shown: remarks that were printed before and are not repeated.
    """
    _remark([remark for remark in written.remarks if remark not in shown])
    size = f"{written.size / 1e6:.1f} MB"
    echo(
        f"written: {written.path}: {counted(written.strikes, 'strike')}, "
        f"{counted(written.tosses, 'toss')}, "
        f"{counted(written.images, 'image')}, {size}; next: `analyze estimate {written.path}`"
    )


def _remark(lines: list[str]) -> list[str]:
    """Print remarks on the import, one per line, to standard error, and return them unchanged."""
    for line in lines:
        echo(line, err=True)
    return lines


def _note(prepared: PreparedImport, clip: Clip, window: StrikeWindow) -> str:
    """Note on a strike for the table's last column; "" if there is nothing to note.

    Notes: no tip is seen in a source that was searched; several tips are seen and only the first is used (not
    if the source was split into its strikes); none of the tags that the plan expects is seen at the tip.
    """
    if window.onset is None:
        why = f"no tip is seen, the whole source is used: {clip.why_no_strike}"
        return why if clip.last_ns is not None else ""
    notes: list[str] = []
    if len(clip.onsets) > 1 and not prepared.was_split:
        notes.append(f"{counted(len(clip.onsets), 'tip', 'is')} seen: the first is used")
    planned = next(strike for strike in prepared.plan.strikes if strike.id == window.plan_strike_id)
    if planned.visible_markers and not set(planned.visible_markers) & set(window.onset.markers):
        expected = ", ".join(str(name) for name in planned.visible_markers)
        notes.append(f"the plan expects tag {expected} in view")
    return "; ".join(notes)
