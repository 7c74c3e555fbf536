"""Sentence on strikes that show different print where they should show one side."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.tags.side_names import axis_name

if TYPE_CHECKING:
    from analyze.tracking.print_likeness import PrintDifference


def print_text(difference: PrintDifference) -> str:
    """Sentence on two strikes that show different print on one side, with the remedy."""
    one, other = difference.strikes
    return (
        f"{one} and {other} show different print on {axis_name(difference.normal)}: in one of them the object"
        " was placed otherwise than its card shows, or it is another strike than stated; look at both, and"
        f" leave it out (--exclude {one})"
    )
