"""Browsers and scripts that were let in: one-time tokens, cookies, and which of them is the operator."""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

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
    seen_s: float = 0.0
    """monotonic time of its last request [s]"""
    left_s: float = 0.0
    """monotonic time of the end of its last event stream, or since which it is the operator [s]"""


class Visitors:
    """Register of browsers and scripts; any thread may call its methods.

    Args:
        monotonic_s: function that returns a monotonic time [s].
        on_redeemed: called when a one-time token was exchanged for a cookie.
    """

    def __init__(
        self,
        monotonic_s: Callable[[], float] = time.monotonic,
        on_redeemed: Callable[[], object] = lambda: None,
    ) -> None:
        self._monotonic_s, self._on_redeemed = monotonic_s, on_redeemed
        self._lock = threading.Lock()
        self._tokens: list[str] = []
        self._visitors: dict[str, Visitor] = {}
        self._operator: Visitor | None = None
        self._key: str | None = None

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
        secret = self.add()
        self._on_redeemed()
        return secret

    def add(self) -> str:
        """Register a browser and return its secret; the first one is the operator."""
        secret = secrets.token_urlsafe(32)
        with self._lock:
            visitor = self._register(_digest(secret), script=False)
            if self._operator is None:
                self._operator = visitor
        return secret

    def find(self, secret: str) -> Visitor | None:
        """Browser with a secret; None if there is none."""
        visitor = self._visitors.get(_digest(secret))
        return self._seen(visitor) if visitor is not None and not visitor.script else None

    def new_key(self) -> str:
        """Make the key with which scripts of this user authenticate."""
        key = secrets.token_hex(32)
        self._key = _digest(key)
        return key

    def find_script(self, credential: str) -> Visitor | None:
        """Script with a credential (`KEY.NAME`, a name that it chose); None if the key is wrong."""
        key, _, name = credential.partition(".")
        if self._key is None or not name or not hmac.compare_digest(_digest(key), self._key):
            return None
        with self._lock:
            digest = _digest(credential)
            return self._seen(self._visitors.get(digest) or self._register(digest, script=True))

    def _seen(self, visitor: Visitor) -> Visitor:
        visitor.seen_s = self._monotonic_s()
        return visitor

    def _register(self, key: str, *, script: bool) -> Visitor:
        """Register a visitor; one seen long ago, without a stream, is forgotten if there are many."""
        buckets = (TokenBucket(*limit, self._monotonic_s) for limit in (READ_LIMIT, ORDER_LIMIT, STOP_LIMIT))
        visitor = Visitor(key, *buckets, script=script, seen_s=self._monotonic_s())
        visitor.left_s = visitor.seen_s
        self._visitors[key] = visitor
        idle = [
            each
            for each in self._visitors.values()
            if not each.streams and each is not self._operator and each is not visitor
        ]
        if len(self._visitors) > MAX_VISITORS and idle:
            del self._visitors[min(idle, key=lambda each: each.seen_s).key]
        return visitor

    # --- roles ---

    def is_operator(self, visitor: Visitor) -> bool:
        """True if the visitor may give orders."""
        return visitor is self._operator

    def take_over(self, visitor: Visitor) -> None:
        """Make the visitor the operator, in place of the one before."""
        with self._lock:
            self._operator = visitor
            visitor.left_s = self._monotonic_s()

    def open_stream(self, visitor: Visitor) -> None:
        """Note that the visitor has opened an event stream."""
        with self._lock:
            visitor.streams += 1

    def close_stream(self, visitor: Visitor) -> None:
        """Note that an event stream of the visitor has ended."""
        with self._lock:
            visitor.streams -= 1
            visitor.left_s = self._monotonic_s()

    @property
    def operator_present(self) -> bool:
        """True while the operator's browser is connected, or was less than LOST_S ago."""
        operator = self._operator
        if operator is None:
            return False
        return operator.streams > 0 or self._monotonic_s() - operator.left_s < LOST_S

    @property
    def watchers(self) -> int:
        """Number of browsers with an open event stream besides the operator's."""
        with self._lock:
            return sum(each.streams > 0 and each is not self._operator for each in self._visitors.values())


def _digest(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()
