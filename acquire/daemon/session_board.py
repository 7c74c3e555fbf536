"""Progress of the session, kept for clients that connect late, and the curves of its strikes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Final

from pydantic import ValidationError

from acquire.errors import SessionError
from schemas.session_status import SessionStatus
from schemas.watch_lines import StrikeCurve, StrikeVerdict

MAX_CURVES: Final = 400
"""strikes whose curves are kept"""


class SessionBoard:
    """Last report of the session that runs, or of the last one.

    Args:
        publish: function that sends an event (name, data) to all clients that subscribed to events.
    """

    def __init__(self, publish: Callable[[str, dict[str, Any]], None]) -> None:
        self._publish = publish
        self._lock = threading.Lock()
        self._status: SessionStatus | None = None
        self._curves: dict[str, StrikeCurve] = {}

    def begin_session(self) -> None:
        """Forget the last session."""
        with self._lock:
            self._status = None
            self._curves.clear()

    def report(self, _: object, params: dict[str, Any]) -> dict[str, Any]:
        """Take the session's progress, and publish it as the event "session".

        Args:
            params: members of SessionStatus.

        Raises:
            SessionError: a member is missing, unknown or of a wrong type.
        """
        try:
            status = SessionStatus.model_validate(params)
        except ValidationError as error:
            first = error.errors()[0]
            place = ".".join(map(str, first["loc"]))
            raise SessionError(f"session.report: {place}: {first['msg']}") from None
        with self._lock:
            self._status = status
        self._publish("session", {"session": status.model_dump(mode="json")})
        return {}

    def keep_curve(self, verdict: StrikeVerdict | None) -> None:
        """Keep the curve of a strike that was judged, if the verdict has one."""
        if verdict is not None and verdict.curve is not None:
            with self._lock:
                self._curves[verdict.strike_id] = verdict.curve
                while len(self._curves) > MAX_CURVES:
                    del self._curves[next(iter(self._curves))]

    def status(self, *_: object) -> dict[str, Any]:
        """Progress of the session that runs or ran last (null before the first), and strikes with a curve."""
        with self._lock:
            shown = None if self._status is None else self._status.model_dump(mode="json")
            return {"session": shown, "curves": list(self._curves)}

    def curve(self, _: object, params: dict[str, Any]) -> dict[str, Any]:
        """Curve of a strike.

        Args:
            params: `strike_id`.

        Raises:
            SessionError: there is none.
        """
        strike_id = str(params.get("strike_id", ""))
        with self._lock:
            found = self._curves.get(strike_id)
        if found is None:
            raise SessionError(f"strike {strike_id}: no curve was fitted: see the strike's verdict")
        return found.model_dump(mode="json")
