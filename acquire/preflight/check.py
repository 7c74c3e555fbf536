"""Result of one check of `acquire check`: outcome, finding and remedy."""

from __future__ import annotations

import enum
import re
from dataclasses import asdict, dataclass
from typing import Any


class Outcome(enum.Enum):
    """Outcome of a check; NOT_CHECKED if another problem comes first or a daemon holds the device."""

    PASS = "pass"  # noqa: S105 - an outcome, not a password
    FAIL = "fail"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True)
class Measured:
    """Measured value and its limit, in `unit`."""

    value: float
    limit: float
    unit: str


@dataclass(frozen=True)
class Check:
    """Result of one check, with the remedy if it failed."""

    name: str
    """name of the line, as "disk space\""""
    outcome: Outcome
    found: str
    """finding in words"""
    remedy: str = ""
    """what to do; empty if nothing is to be done"""
    measured: Measured | None = None
    """value behind the outcome; None if nothing was measured"""

    def text(self) -> str:
        """Line for the terminal, followed by a line with the remedy if there is one."""
        mark = {Outcome.PASS: "pass", Outcome.FAIL: "FAIL", Outcome.NOT_CHECKED: "  - "}[self.outcome]
        found = f"not checked: {self.found}" if self.outcome is Outcome.NOT_CHECKED else self.found
        remedy = f"\n{'':24}-> {self.remedy}" if self.remedy else ""
        return f"{mark}  {self.name:18}{found}{remedy}"

    def as_dict(self) -> dict[str, Any]:
        """JSON object of the check."""
        return asdict(self) | {"outcome": self.outcome.value}


def passed_check(name: str, found: str, measured: Measured | None = None) -> Check:
    """Check that passed."""
    return Check(name, Outcome.PASS, found, measured=measured)


def failed_check(name: str, found: str, remedy: str, measured: Measured | None = None) -> Check:
    """Check that failed, with its remedy."""
    return Check(name, Outcome.FAIL, found, remedy, measured)


def failed_by_error(name: str, error: Exception) -> Check:
    """Check that failed with an error.

    The error's message has the form "device or file: finding: remedy" or "device or file: finding; remedy".
    """
    prefix = re.match(r"\S+: ", str(error))
    head = prefix.group() if prefix else ""
    rest = str(error)[len(head) :]
    found, _, remedy = rest.rpartition(": ") if ": " in rest else rest.partition("; ")
    return failed_check(name, head + found, remedy or "see the message")


def skipped_check(name: str, reason: str, remedy: str = "") -> Check:
    """Check that could not be made."""
    return Check(name, Outcome.NOT_CHECKED, reason, remedy)
