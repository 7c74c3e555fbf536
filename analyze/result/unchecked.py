"""Sentence on strikes that the other strikes cannot predict, so that nothing confirms them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from analyze.result.warning_text import names_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.checks import LeaveOneOut


def unchecked_text(left_out: Sequence[LeaveOneOut]) -> str | None:
    """Sentence that names strikes whose balance angle the others leave open, with the remedy; None if none.

    Args:
        left_out: leave-one-out predictions of all strikes used.
    """
    names = [each.strike_id for each in left_out if not each.checkable]
    if not names:
        return None
    many = len(names) > 1
    return (
        f"not checked: {'strikes' if many else 'strike'} {names_text(names)}: the other strikes leave"
        f" {'their' if many else 'its'} balance angle open; strike {'those edges' if many else 'that edge'}"
        " again, or other edges"
    )
