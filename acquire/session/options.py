"""Options of a session beside its files."""

from __future__ import annotations

from dataclasses import dataclass

from acquire.session.adaptive import Target
from acquire.session.earlier import EarlierStrikes
from acquire.session.waits import SERVO_TIMEOUT_S


@dataclass(frozen=True)
class SessionOptions:
    """How a session is carried out."""

    target: Target | None = None
    """precision at which the session stops itself; None to make every planned strike"""
    earlier: EarlierStrikes | None = None
    """strikes of earlier recordings with which the session goes on"""
    note: str = ""
    """remark to write into the recording"""
    countdown_s: float = 0.0
    """wait before every arming [s]"""
    servo_timeout_s: float = SERVO_TIMEOUT_S
    """longest wait for a servo that does not answer [s]"""
    only_tosses: bool = False
    """True to make the plan's tosses and none of its strikes"""


DEFAULT_OPTIONS = SessionOptions()
