"""Questions to the person at the rig: one client asks, all subscribers see it, one answer counts."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable
from typing import Any

from acquire.daemon.server import Connection
from acquire.errors import SessionError

ORDERS = ("placed", "skip", "again", "harder")
"""orders with the answer to a question to place the object: strike it; leave this strike out; repeat the
strike judged last; strike harder at the next attempt of this strike (then the question is asked again)"""

STOPPED = {"ok": False, "text": "stopped on request"}
"""answer to every question after a stop"""


class Prompts:
    """Open questions to the person at the rig, by number.

    Args:
        publish: function that sends an event (name, data) to all clients that subscribed to events.
        stopped: function that returns True while a stop forbids motion: no question is asked then.
    """

    def __init__(
        self, publish: Callable[[str, dict[str, Any]], None], stopped: Callable[[], bool] = lambda: False
    ) -> None:
        self._publish, self._stopped = publish, stopped
        self._numbers = itertools.count(1)
        self._questions: dict[int, dict[str, Any]] = {}
        """content of each question that waits for an answer, by its number"""
        self._answers: dict[int, dict[str, Any] | None] = {}
        """answer of each question that waits for one, by its number; None while it is open"""
        self._changed = threading.Condition()
        self._closed = False

    def ask(self, connection: Connection, params: dict[str, Any]) -> dict[str, Any]:
        """Publish a question as the event "prompt", wait for its answer and return that.

        After a stop it is answered at once, as `stop` answers open questions.

        Args:
            connection: client that asks.
            params: content of the question; its number is added to the event as `prompt_id`.

        Returns:
            The answer: `{"ok": bool, "text": str}`, and `order` if it is another than "placed".

        Raises:
            SessionError: `kind` or `text` of the question is missing; the daemon stops, or the asking client
                leaves, before an answer.
        """
        for key in ("kind", "text"):
            if not isinstance(params.get(key), str):
                raise SessionError(f'a question needs "{key}", a text: {{"kind": "place", "text": "..."}}')
        with self._changed:
            if self._stopped():
                return dict(STOPPED)
            number = next(self._numbers)
            self._answers[number], self._questions[number] = None, {"prompt_id": number, **params}
        self._publish("prompt", self._questions[number])
        with self._changed:
            while (answer := self._answers[number]) is None:
                if self._closed or connection.gone:
                    del self._answers[number], self._questions[number]
                    self._publish("answered", {"prompt_id": number, "ok": False})
                    raise SessionError(
                        "the question was not answered: "
                        "the daemon is stopping, or the client that asked has left"
                    )
                self._changed.wait(0.5)
            del self._answers[number], self._questions[number]
            return answer

    def repeat(self, connection: Connection) -> None:
        """Send the open questions to a client that has just subscribed: it may have missed them."""
        with self._changed:
            for number, answer in self._answers.items():
                if answer is None:
                    connection.publish({"event": "prompt", **self._questions[number]})

    def answer(self, _: Connection, params: dict[str, Any]) -> dict[str, Any]:
        """Answer an open question on behalf of a client.

        Args:
            params: `prompt_id`, number of the question; `ok`, true unless given; `text`, empty unless given;
                `order`, "placed" unless given: see ORDERS.

        Returns:
            An empty JSON object.

        Raises:
            SessionError: the question is not open: it was answered already, never asked, or withdrawn because
                the client that asked has left or the daemon stops.
        """
        number, order = int(params["prompt_id"]), str(params.get("order", "placed"))
        if order not in ORDERS:
            raise SessionError(f"unknown order {order!r}: one of {', '.join(ORDERS)}")
        with self._changed:
            if self._answers.get(number, {}) is not None:
                raise SessionError(f"question {number} is not open: it was answered already")
            ok, text = bool(params.get("ok", True)), str(params.get("text", ""))
            ordered = {} if order == "placed" else {"order": order}
            self._answers[number] = {"ok": ok, "text": text, **ordered}
            self._publish("answered", {"prompt_id": number, "ok": ok})
            self._changed.notify_all()
        return {}

    def stop(self) -> None:
        """Answer every question that is still open with `ok` False and the text "stopped on request"."""
        with self._changed:
            for number, answer in self._answers.items():
                self._answers[number] = answer or dict(STOPPED)
                self._publish("answered", {"prompt_id": number, "ok": False})
            self._changed.notify_all()

    def close(self) -> None:
        """Withdraw all open questions, now and later: `ask` raises SessionError instead of waiting."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
