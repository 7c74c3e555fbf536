"""Token bucket: limit of the rate of requests, which permits short bursts."""

from __future__ import annotations

from collections.abc import Callable


class TokenBucket:
    """Bucket that fills at a constant rate; each request takes one token.

    Args:
        rate_hz: tokens added per second.
        burst: number of tokens that a full bucket holds.
        monotonic_s: function that returns a monotonic time [s].
    """

    def __init__(self, rate_hz: float, burst: int, monotonic_s: Callable[[], float]) -> None:
        self._rate_hz, self._burst, self._monotonic_s = rate_hz, float(burst), monotonic_s
        self._tokens, self._filled_s = self._burst, monotonic_s()

    def take(self) -> bool:
        """Take one token; False if there is none."""
        now_s = self._monotonic_s()
        self._tokens = min(self._burst, self._tokens + (now_s - self._filled_s) * self._rate_hz)
        self._filled_s = now_s
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True
