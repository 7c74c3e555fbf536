"""Result of one check of `acquire check`: outcome, finding and remedy."""

from __future__ import annotations

import enum
import re
from dataclasses import asdict, dataclass
from typing import Any


class Outcome(enum.Enum):
    """Outcome of a check.

    NOT_CHECKED if another problem must be solved first, if a daemon holds the device, or if the check cannot
    be made here.
    """

    PASS = "pass"  # noqa: S105 - an outcome, not a password
    FAIL = "fail"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True)
class Measured:
    """Measured value and the limit or target that it is compared with, both in `unit`."""

    value: float
    limit: float
    unit: str


@dataclass(frozen=True)
class Check:
    """Result of one check: name, outcome, finding, a remedy where one is needed, and the measured value."""

    name: str
    """name of the check, "disk space" for example"""
    outcome: Outcome
    found: str
    """finding in words"""
    remedy: str = ""
    """what to do; empty if nothing is to be done"""
    measured: Measured | None = None
    """value behind the outcome; None if nothing was measured"""

    def text(self) -> str:
        """Text of the check for the terminal: one line, and a second with the remedy if there is one."""
        mark = {Outcome.PASS: "pass", Outcome.FAIL: "FAIL", Outcome.NOT_CHECKED: "  - "}[self.outcome]
        found = f"not checked: {self.found}" if self.outcome is Outcome.NOT_CHECKED else self.found
        remedy = f"\n{'':24}-> {self.remedy}" if self.remedy else ""
        return f"{mark}  {self.name:18}{found}{remedy}"

    def as_dict(self) -> dict[str, Any]:
        """JSON object of the check: its fields by name, the outcome as text."""
        return asdict(self) | {"outcome": self.outcome.value}


def passed_check(name: str, found: str, measured: Measured | None = None) -> Check:
    """Result of a check that passed.

    Args:
        name: name of the check.
        found: finding in words.
        measured: measured value and its limit; None if nothing was measured.
    """
    return Check(name, Outcome.PASS, found, measured=measured)


def failed_check(name: str, found: str, remedy: str, measured: Measured | None = None) -> Check:
    """Result of a check that failed.

    Args:
        name: name of the check.
        found: finding in words.
        remedy: advice on how to correct it.
        measured: measured value and its limit; None if nothing was measured.
    """
    return Check(name, Outcome.FAIL, found, remedy, measured)


def failed_by_error(name: str, error: Exception) -> Check:
    """Result of a check that failed with an error, whose message is split into finding and remedy.

    The message has the form "device or file: finding: remedy" or "device or file: finding; remedy". If it
    names no remedy, the check's remedy is "see the message".
    """
    prefix = re.match(r"\S+: ", str(error))
    head = prefix.group() if prefix else ""
    rest = str(error)[len(head) :]
    found, _, remedy = rest.rpartition(": ") if ": " in rest else rest.partition("; ")
    return failed_check(name, head + found, remedy or "see the message")


def skipped_check(name: str, reason: str, remedy: str = "") -> Check:
    """Result of a check that was not made.

    Args:
        name: name of the check.
        reason: reason why it was not made.
        remedy: advice on how to make it possible; "" for none.
    """
    return Check(name, Outcome.NOT_CHECKED, reason, remedy)
