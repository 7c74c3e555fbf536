"""The two timelines of a replay: `since_contact`, on which all strikes start together, and `session`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

if TYPE_CHECKING:
    from analyze.types import Array, IntArray
    from schemas.proto import percuss_pb2 as pb

SINCE_CONTACT, SESSION = "since_contact", "session"


def contact_of(record: pb.StrikeRecord) -> int:
    """Log time [ns] at which a strike's own time is 0."""
    return record.contact_time_ns or record.window_start_ns


def strike_path(strike_id: str) -> str:
    """Root of a strike's entities."""
    return rr.new_entity_path(["strike", strike_id])


class Timelines:
    """Puts things into a stream at their times.

    Args:
        stream: where to.
        origin_ns: log time at which the session's time is 0.
    """

    def __init__(self, stream: rr.RecordingStream, origin_ns: int) -> None:
        self.stream = stream
        self.origin_ns = origin_ns

    def at(self, time_ns: int, contact_ns: int | None) -> None:
        """What is logged next happened then, in a strike where there is a contact."""
        self.stream.reset_time()
        if contact_ns is not None:
            self.stream.set_time(SINCE_CONTACT, duration=(time_ns - contact_ns) * 1e-9)
        self.stream.set_time(SESSION, duration=(time_ns - self.origin_ns) * 1e-9)

    def columns(self, time_ns: IntArray, contact_ns: int | None) -> list[rr.TimeColumn]:
        """Times (n,) of rows."""
        session = rr.TimeColumn(SESSION, duration=(time_ns - self.origin_ns) * 1e-9)
        return [session] if contact_ns is None else [rr.TimeColumn(SINCE_CONTACT, duration=(time_ns - contact_ns) * 1e-9), session]

    def series(self, path: str, time_ns: IntArray, contact_ns: int | None, values: Array) -> None:
        """A curve (n,)."""
        if len(time_ns):
            values = np.asarray(values, dtype=np.float64)
            self.stream.send_columns(path, indexes=self.columns(time_ns, contact_ns), columns=rr.Scalars.columns(scalars=values))

    def lane(self, path: str, states: dict[str, int]) -> None:
        """Colours (RGBA) and names of a lane of bands."""
        names = [name.replace("_", " ") for name in states]
        self.stream.log(path, rr.StateConfiguration(values=list(states), labels=names, colors=list(states.values())), static=True)

    def band(self, path: str, state: str | None, time_ns: int, contact_ns: int | None) -> None:
        """A lane's state from then on; None ends it."""
        self.at(time_ns, contact_ns)
        self.stream.log(path, rr.StateChange.from_fields(clear_unset=True) if state is None else rr.StateChange(state=state))
