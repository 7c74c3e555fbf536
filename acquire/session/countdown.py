"""Countdown before the striker is armed: time for people to step back, or to press stop."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

from acquire.session.progress import ProgressReporter
from schemas.watch_lines import WatchEvent

HANDS_FRACTION: Final = 0.01
"""fraction of the pixels in and around the object that may change between two images before the striker is
armed; hands change more"""
LOOK_S: Final = 0.05
"""interval at which the countdown looks for hands and stops [s]"""


def hands_are_near(event: WatchEvent) -> bool:
    """True if something moves in or beside the object in the newest image."""
    return (event.moving_fraction or 0.0) > HANDS_FRACTION


def count_down(call: Callable[..., Any], status: ProgressReporter, seconds: float) -> bool:
    """Wait before the striker is armed, with the end of the wait in the session's progress.

    It ends at once when the striker is stopped or the session is held, which the next request then tells.

    Args:
        call: function that makes a request (name, parameters) to the daemon.
        status: reporter of the session's progress.
        seconds: length of the wait [s]; 0 for none.

    Returns:
        False if something came near the object meanwhile.
    """
    if seconds <= 0:
        return True
    stops = call("status")["stops"]
    before = _newest(call)
    end_s = time.monotonic() + seconds
    status.count_down(time.time_ns() + round(seconds * 1e9))
    try:
        while (left_s := end_s - time.monotonic()) > 0:
            time.sleep(min(LOOK_S, left_s))
            if call("status")["stops"] != stops or call("hold.status").get("held"):
                return True
            event = _newest(call)
            # An old event says nothing: `analyze watch` may have ended.
            if event is not None and event != before and hands_are_near(event):
                return False
    finally:
        status.count_down(None)
    return True


def _newest(call: Callable[..., Any]) -> WatchEvent | None:
    """Newest report of `analyze watch`; None before the first."""
    event = call("watch.latest")["event"]
    return WatchEvent.model_validate(event) if event else None
