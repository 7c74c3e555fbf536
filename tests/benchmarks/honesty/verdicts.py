"""What the verdict of an answer says of each quantity: trust, doubt or not determined."""

from __future__ import annotations

import re

from analyze.types import TENSOR_ENTRIES, tensor_entry_name
from schemas.result import Result

STATUSES = ("trust", "doubt", "not determined", "not mentioned")
EVERYTHING = "everything"
EXPECTED_DOUBTS = (
    re.compile(r"of the tensor.*from the shape"),
    re.compile(r"region masses|the parts|the masses of|the filling"),
    re.compile(r"not observed"),
    re.compile(r"known only"),
)
"""doubts that are right in a session without disturbance: entries from the shape, regions, open
directions, and what is said to be known only roughly"""


def statuses(result: Result) -> dict[str, str]:
    """Status of "c", of each tensor entry ("Ixx", ...), "regions" and "parts"; sentences are read in order.

    A doubt of everything, or of the moments, overrides what was said before.
    """
    entries = [tensor_entry_name(entry) for entry in TENSOR_ENTRIES]
    names = ["c", *entries, "regions", "parts"]
    found = dict.fromkeys(names, "not mentioned")
    for sentence in result.verdict:
        status = status_of(sentence)
        if status is None:
            continue
        for name in names:
            if _concerns(sentence, name):
                found[name] = status
    return found


def status_of(sentence: str) -> str | None:
    """Status that a sentence gives, by its first words; None if it gives none, as "repeat strike ..."."""
    return next((status for status in STATUSES[:3] if sentence.lower().startswith(status)), None)


def _concerns(sentence: str, name: str) -> bool:
    head = sentence.removeprefix("not determined:").partition(":")[0]
    if EVERYTHING in head:
        return True
    if name == "c":
        return "centre of mass" in head
    if name in ("regions", "parts"):
        return {"regions": "region masses", "parts": "part"}[name] in head
    return re.search(rf"\b{name}\b", head) is not None or "the moments" in head


def false_doubts(result: Result) -> list[str]:
    """Sentences that doubt something without need, in a session whose errors are all stated."""
    return [
        sentence
        for sentence in result.verdict
        if sentence.startswith("doubt") and not any(each.search(sentence) for each in EXPECTED_DOUBTS)
    ]
