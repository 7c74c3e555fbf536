"""Browsers and scripts that were let in: one-time tokens, cookies, and which of them is the operator."""

from __future__ import annotations

import hashlib
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from acquire.console.web.rate_limit import TokenBucket

MAX_VISITORS = 32
"""browsers and scripts that are remembered; the one that was seen longest ago is forgotten first"""
MAX_TOKENS = 8
"""one-time tokens that may wait for their use"""
LOST_S = 2.0
"""time without an open event stream after which the operator's browser counts as lost [s]"""
READ_LIMIT, ORDER_LIMIT, STOP_LIMIT = (60.0, 200), (10.0, 30), (20.0, 60)
"""requests per second and burst: for reading, for orders, and for stops (20 a second: more than hands do)"""


@dataclass(eq=False)
class Visitor:
    """Browser or script that was let in."""

    key: str
    """SHA-256 of its secret"""
    reading: TokenBucket
    orders: TokenBucket
    stops: TokenBucket
    script: bool = False
    """True for a script, which authenticates with the private key of the console's file"""
    streams: int = 0
    """number of open event streams"""
    seen_s: float = field(default=0.0)
    """monotonic time of its last request, or of the end of its last event stream [s]"""


class Visitors:
    """Register of browsers and scripts; any thread may call its methods.

    Args:
        monotonic_s: function that returns a monotonic time [s].
    """

    def __init__(self, monotonic_s: Callable[[], float] = time.monotonic) -> None:
        self._monotonic_s = monotonic_s
        self._lock = threading.Lock()
        self._tokens: list[str] = []
        self._visitors: dict[str, Visitor] = {}
        self._operator: Visitor | None = None

    def new_token(self) -> str:
        """Make a token that lets one browser in, once; the oldest unused one lapses if there are many."""
        token = secrets.token_urlsafe(24)
        with self._lock:
            self._tokens = [*self._tokens, _digest(token)][-MAX_TOKENS:]
        return token

    def redeem(self, token: str) -> str | None:
        """Exchange a one-time token for the secret of a new visitor; None if the token is not valid."""
        digest = _digest(token)
        with self._lock:
            if digest not in self._tokens:
                return None
            self._tokens.remove(digest)
        return self.add()

    def add(self, *, script: bool = False) -> str:
        """Register a visitor and return its secret."""
        secret = secrets.token_urlsafe(32)
        buckets = (TokenBucket(*limit, self._monotonic_s) for limit in (READ_LIMIT, ORDER_LIMIT, STOP_LIMIT))
        visitor = Visitor(_digest(secret), *buckets, script=script, seen_s=self._monotonic_s())
        with self._lock:
            self._visitors[visitor.key] = visitor
            browsers = [each for each in self._visitors.values() if not each.script and not each.streams]
            if len(self._visitors) > MAX_VISITORS and browsers:
                oldest = min(browsers, key=lambda each: each.seen_s)
                del self._visitors[oldest.key]
            if self._operator is None and not script:
                self._operator = visitor
        return secret

    def find(self, secret: str) -> Visitor | None:
        """Visitor with a secret; None if there is none. Notes that it was seen."""
        visitor = self._visitors.get(_digest(secret))
        if visitor is not None:
            visitor.seen_s = self._monotonic_s()
        return visitor

    # --- roles ---

    def is_operator(self, visitor: Visitor) -> bool:
        """True if the visitor may give orders."""
        return visitor is self._operator

    def take_over(self, visitor: Visitor) -> None:
        """Make the visitor the operator, in place of the one before."""
        with self._lock:
            self._operator = visitor

    def open_stream(self, visitor: Visitor) -> None:
        """Note that the visitor has opened an event stream."""
        with self._lock:
            visitor.streams += 1

    def close_stream(self, visitor: Visitor) -> None:
        """Note that an event stream of the visitor has ended."""
        with self._lock:
            visitor.streams -= 1
            visitor.seen_s = self._monotonic_s()

    @property
    def operator_present(self) -> bool:
        """True while the operator's browser is connected, or was less than LOST_S ago."""
        operator = self._operator
        if operator is None:
            return False
        return operator.streams > 0 or self._monotonic_s() - operator.seen_s < LOST_S

    @property
    def watchers(self) -> int:
        """Number of browsers with an open event stream besides the operator's."""
        with self._lock:
            return sum(each.streams > 0 and each is not self._operator for each in self._visitors.values())


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
