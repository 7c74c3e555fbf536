"""What an attack finds, and the tally of its tries."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Finding:
    """One failure: its kind, what was tried, and what was seen."""

    kind: str
    what: str
    text: str


@dataclass(frozen=True)
class Tally:
    """Tries of one kind: their number, largest memory and time, and what they found."""

    kind: str
    tries: int = 0
    memory_bytes: int = 0
    """largest memory of one try [bytes]"""
    longest_s: float = 0.0
    """time of the longest try [s]"""
    findings: list[Finding] = field(default_factory=list)

    def __add__(self, other: Tally) -> Tally:
        return Tally(
            self.kind,
            self.tries + other.tries,
            max(self.memory_bytes, other.memory_bytes),
            max(self.longest_s, other.longest_s),
            self.findings + other.findings,
        )
