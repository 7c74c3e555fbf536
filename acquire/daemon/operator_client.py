"""Client of a program that answers the daemon's prompts: it misses none, and loses no answer.

A connection that has sent nothing yet is the first to go when many programs connect (door.py). So this client
subscribes at once, subscribes again if the daemon sent it away, and connects anew for each answer.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from acquire.daemon.client import DaemonClient
from acquire.errors import DaemonBusy, DaemonNotRunning, SessionError

PATIENCE_S: Final = 30.0
"""longest time for which a request is tried again while the daemon serves other programs [s]"""
_RETRY_S: Final = 0.2


class OperatorClient:
    """Subscription to the daemon's events, and answers to its prompts, until `close`.

    Args:
        path: path of the daemon's socket.

    Raises:
        DaemonNotRunning: no daemon listens at `path`.
        DaemonBusy: the daemon took no subscription for PATIENCE_S (30 s).
        DaemonError: the socket belongs to another user, or the daemon hangs.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._closed = False
        self._answered = 0
        self._listener = _requested(path, "subscribe")

    def events(self) -> Iterator[dict[str, Any]]:
        """Yield the daemon's events until it ends or `close` is called; each prompt once, old open ones too.

        Yields:
            Events as JSON objects: `{"event": name, ...}`.

        Raises:
            AcquireError: the daemon takes no subscription any more.
        """
        while not self._closed:
            for event in self._listener.subscribed_events():
                if event["event"] == "prompt":
                    if event["prompt_id"] <= self._answered:
                        continue
                    self._answered = event["prompt_id"]
                yield event
            self._listener.close()
            if self._closed:
                return
            try:
                self._listener = _requested(self._path, "subscribe")
            except DaemonNotRunning:
                return
        self._listener.close()  # closed while it subscribed

    def answer(self, prompt_id: int, *, ok: bool, text: str = "", order: str = "placed") -> None:
        """Answer a prompt; nothing happens if it is no longer open.

        Args:
            prompt_id: number of the prompt.
            ok: True if the object is placed; False ends the session.
            text: reason, if `ok` is False.
            order: one of `ORDERS` (prompts.py).

        Raises:
            AcquireError: the daemon is gone, or took no request for PATIENCE_S (30 s).
        """
        with contextlib.suppress(SessionError):  # answered already, or withdrawn
            _requested(
                self._path, "prompt.answer", prompt_id=prompt_id, ok=ok, text=text, order=order
            ).close()

    def close(self) -> None:
        """End the subscription; any thread may call it, also twice."""
        self._closed = True
        self._listener.close()


def _requested(path: Path, method: str, **params: Any) -> DaemonClient:
    """Client that has made a request, also if the daemon sent it away before, because of other clients."""
    end_s = time.monotonic() + PATIENCE_S
    while True:
        client = DaemonClient(path)
        try:
            client.call(method, **params)
        except (DaemonBusy, DaemonNotRunning):
            client.close()
            if time.monotonic() > end_s:
                raise
            time.sleep(_RETRY_S)
        except BaseException:
            client.close()
            raise
        else:
            return client
