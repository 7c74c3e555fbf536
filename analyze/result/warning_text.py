"""One warning of the Result document, and lists of names in its sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

from schemas.result import ResultWarning, WarningCode

if TYPE_CHECKING:
    from collections.abc import Sequence

MAX_NAMES = 6
"""most names that a sentence lists; the rest is only counted"""


def warning(code: WarningCode, text: str) -> ResultWarning:
    """Warning as an entry of the Result document: its code and its sentence."""
    return ResultWarning(code=code, text=text)


def names_text(items: Sequence[str]) -> str:
    """Text of names separated by commas; the names after the first `MAX_NAMES` are only counted.

    Example: "s1, s2 and 3 more", if `MAX_NAMES` were 2.
    """
    return (
        ", ".join(items)
        if len(items) <= MAX_NAMES
        else f"{', '.join(items[:MAX_NAMES])} and {len(items) - MAX_NAMES} more"
    )
