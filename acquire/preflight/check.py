"""One line of `acquire check`."""

from __future__ import annotations

import enum
import re
from dataclasses import asdict, dataclass
from typing import Any


class Outcome(enum.Enum):
    """How a check ended. NOT_CHECKED: something else must be put right first, or belongs to a running daemon."""

    PASS = "pass"  # noqa: S105 - a verdict
    FAIL = "fail"
    NOT_CHECKED = "not checked"


@dataclass(frozen=True)
class Measured:
    """The number behind a verdict and the bound it was held against, in `unit` (SI but where named otherwise)."""

    value: float
    limit: float
    unit: str


@dataclass(frozen=True)
class Check:
    """What was looked at, what was found, and what to do where it is not good enough."""

    name: str
    outcome: Outcome
    found: str
    remedy: str = ""
    measured: Measured | None = None

    def text(self) -> str:
        """For people: one line, and one more with the remedy where there is one."""
        mark = {Outcome.PASS: "pass", Outcome.FAIL: "FAIL", Outcome.NOT_CHECKED: "  - "}[self.outcome]
        found = f"not checked: {self.found}" if self.outcome is Outcome.NOT_CHECKED else self.found
        remedy = f"\n{'':24}-> {self.remedy}" if self.remedy else ""
        return f"{mark}  {self.name:18}{found}{remedy}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"outcome": self.outcome.value}


def passed(name: str, found: str, measured: Measured | None = None) -> Check:
    """A check that is all right."""
    return Check(name, Outcome.PASS, found, measured=measured)


def failed(name: str, found: str, remedy: str, measured: Measured | None = None) -> Check:
    """A check that is not, and the remedy."""
    return Check(name, Outcome.FAIL, found, remedy, measured)


def failed_as(name: str, error: Exception) -> Check:
    """A check that an error answers: its message is "thing: what was found: remedy", or "thing: what was found; remedy"."""
    thing = re.match(r"\S+: ", str(error))
    head = thing.group() if thing else ""
    rest = str(error)[len(head) :]
    found, _, remedy = rest.rpartition(": ") if ": " in rest else rest.partition("; ")
    return failed(name, head + found, remedy or "see the message")


def not_checked(name: str, reason: str, remedy: str = "") -> Check:
    """A check that could not be made."""
    return Check(name, Outcome.NOT_CHECKED, reason, remedy)
