"""Refusal of a request: HTTP status, kind, message and remedy."""

from __future__ import annotations

from acquire import errors
from acquire.errors import AcquireError

STATUS_OF: dict[type[AcquireError], int] = {
    errors.ConfigError: 400,
    errors.DaemonNotRunning: 503,
    errors.DaemonSilent: 504,
    errors.DaemonError: 502,
    errors.DaemonBusy: 409,
    errors.SessionError: 409,
    errors.StrikerError: 409,
}
"""HTTP status of an error and its subclasses; 500 for the others"""


class Refusal(Exception):
    """Request that is refused; the answer is JSON.

    Args:
        status: HTTP status.
        kind: kind of the problem, one word.
        message: the problem in one sentence.
        remedy: what to do.
    """

    def __init__(self, status: int, kind: str, message: str, remedy: str = "") -> None:
        super().__init__(message)
        self.status, self.kind, self.message, self.remedy = status, kind, message, remedy

    @classmethod
    def from_error(cls, error: AcquireError) -> Refusal:
        """Refusal for an error of the rig; the part of its message after the last ": " is the remedy."""
        kinds = type(error).__mro__
        status = next((STATUS_OF[kind] for kind in kinds if kind in STATUS_OF), 500)
        message, _, remedy = str(error).rpartition(": ")
        return cls(status, type(error).__name__, message or remedy, remedy if message else "")

    def body(self) -> dict[str, dict[str, str]]:
        """JSON object of the answer."""
        return {"error": {"kind": self.kind, "message": self.message, "remedy": self.remedy}}
