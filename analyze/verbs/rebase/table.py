"""Differences between a recorded and an edited object file as a table on the terminal and as JSON."""

from __future__ import annotations

import math
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.rebase.rebase import Rebase
from schemas.document import SCHEMA_VERSION
from schemas.terminal import Terminal
from schemas.wording import counted


def render_rebase(rebase: Rebase, console: Terminal | None = None) -> None:
    """Print the entries that differ with what they change, and the displacements of the struck edges.

    Args:
        rebase: recording and edited object file.
        console: where to print; None for standard output.
    """
    console = console or Terminal()
    if not rebase.changes:
        console.print(f"{rebase.object_path}: describes the object as {rebase.recording} does")
        return
    table = Table(
        "entry",
        "recorded",
        "edited",
        "changes",
        title=f"{rebase.files.spec.name}: {counted(len(rebase.changes), 'entry')} of the object file changed",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for change in rebase.changes:
        table.add_row(change.entry, change.before, change.after, change.effect)
    console.print(table)
    if not rebase.shifts:
        return
    edges = Table(
        "strike",
        "edge",
        "displaced (mm)",
        "allowed (mm)",
        "face turned (deg)",
        "allowed (deg)",
        title="struck edges on the edited shape, allowed by 3 sigma of the shapes",
        title_justify="left",
        box=SIMPLE_HEAD,
    )
    for shift in rebase.shifts:
        edges.add_row(
            shift.strike_id,
            shift.axis_id,
            f"{1000 * shift.shift_m:.3f}",
            f"{1000 * shift.allowed_m:.3f}",
            f"{math.degrees(shift.turn_rad):.3f}",
            f"{math.degrees(shift.allowed_rad):.3f}",
        )
    console.print(edges)


def rebase_json(rebase: Rebase) -> dict[str, Any]:
    """Changed entries and displacements of the struck edges as JSON values, lengths in m, angles in rad."""
    return {
        "schema_version": SCHEMA_VERSION,
        "object_name": rebase.files.spec.name,
        "object_sha256": rebase.files.sha256,
        "changes": [
            {"entry": each.entry, "before": each.before, "after": each.after, "effect": each.effect}
            for each in rebase.changes
        ],
        "edges": [
            {
                "strike": each.strike_id,
                "axis_id": each.axis_id,
                "shift_m": each.shift_m,
                "allowed_m": each.allowed_m,
                "turn_rad": each.turn_rad,
                "allowed_rad": each.allowed_rad,
                "is_same_edge": each.is_same_edge,
            }
            for each in rebase.shifts
        ],
        "plan_holds": all(each.is_same_edge for each in rebase.shifts),
    }
