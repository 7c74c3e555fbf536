"""Timelines of a replay: `since_contact`, with time 0 at each strike's contact, and `session`.

Times of a recording are log times, in nanoseconds of its common clock.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import rerun as rr

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from analyze.types import IntArray
    from schemas.proto import percuss_pb2 as pb

SINCE_CONTACT, SESSION = "since_contact", "session"


def strike_path(strike_id: str) -> str:
    """Entity path in the replay under which everything of a strike is logged."""
    return rr.new_entity_path(["strike", strike_id])


def toss_path(toss_id: str) -> str:
    """Entity path in the replay under which everything of a toss is logged."""
    return rr.new_entity_path(["toss", toss_id])


class Timelines:
    """Stream of a replay with its timelines `since_contact` and `session`.

    Args:
        stream: destination.
        origin_ns: log time [ns] at which the session's time is 0.
    """

    def __init__(self, stream: rr.RecordingStream, origin_ns: int) -> None:
        self.stream = stream
        self.origin_ns = origin_ns
        self._contacts: dict[str, int] = {}

    def state_contact(self, strike_id: str, contact_ns: int) -> None:
        """Set the log time [ns] of the striker's contact for a strike whose record lacks it."""
        self._contacts[strike_id] = contact_ns

    def contact_of(self, record: pb.StrikeRecord) -> int:
        """Log time [ns] at which the striker touched the object, the zero of the strike's `since_contact`.

        It is the measured time, else the one set with `state_contact`, else the start of the strike's
        window (span of recorded images).
        """
        return record.contact_time_ns or self._contacts.get(record.strike_id, record.window_start_ns)

    def set_time(self, time_ns: int, contact_ns: int | None) -> None:
        """Set the time of all data logged from now on.

        Args:
            time_ns: log time [ns].
            contact_ns: log time of the strike's contact [ns]; None outside a strike, which leaves the
                timeline `since_contact` unset.
        """
        self.stream.reset_time()
        if contact_ns is not None:
            self.stream.set_time(SINCE_CONTACT, duration=(time_ns - contact_ns) * 1e-9)
        self.stream.set_time(SESSION, duration=(time_ns - self.origin_ns) * 1e-9)

    def time_columns(self, time_ns: IntArray, contact_ns: int | None) -> list[rr.TimeColumn]:
        """Times [s] of n rows of data, as rerun's time columns.

        They are `session`, from the timelines' origin, and within a strike `since_contact`, from its contact.

        Args:
            time_ns: (n,) log times of the rows [ns].
            contact_ns: log time of the strike's contact [ns]; None outside a strike.
        """
        zeros = {SESSION: self.origin_ns} | ({} if contact_ns is None else {SINCE_CONTACT: contact_ns})
        return [rr.TimeColumn(name, duration=(time_ns - zero) * 1e-9) for name, zero in zeros.items()]

    def log_static(self, path: str, *components: rr.AsComponents) -> None:
        """Log components of an entity that hold at all times of the replay.

        Args:
            path: the entity.
            components: its components, such as a text or lines.
        """
        self.stream.log(path, *components, static=True)

    def send_curve(
        self,
        path: str,
        time_ns: IntArray,
        contact_ns: int | None,
        values: ArrayLike,
        style: rr.SeriesLines | rr.SeriesPoints,
    ) -> None:
        """Send a curve and its style to the stream; only the style if it has no points.

        Args:
            path: entity of the curve.
            time_ns: (n,) log times [ns].
            contact_ns: log time of the strike's contact [ns]; None outside a strike.
            values: (n,) values.
            style: colour, name and width of its line or points.
        """
        self.log_static(path, style)
        if len(time_ns):
            self.stream.send_columns(
                path,
                indexes=self.time_columns(time_ns, contact_ns),
                columns=rr.Scalars.columns(scalars=np.asarray(values, dtype=np.float64)),
            )

    def name_states(self, path: str, states: dict[str, int]) -> None:
        """Set labels and colours of a state's values, for all times.

        Args:
            path: entity of the state.
            states: colour 0xRRGGBBAA by value; the label is the value with spaces for underscores.
        """
        names = [name.replace("_", " ") for name in states]
        colours = list(states.values())
        self.log_static(path, rr.StateConfiguration(values=list(states), labels=names, colors=colours))

    def change_state(self, path: str, state: str | None, time_ns: int, contact_ns: int | None) -> None:
        """Log a change of a state, such as the phase of a tip or the striker's state.

        Args:
            path: entity of the state.
            state: new value; None ends the state.
            time_ns: log time of the change [ns].
            contact_ns: log time of the strike's contact [ns]; None outside a strike.
        """
        self.set_time(time_ns, contact_ns)
        self.stream.log(
            path,
            rr.StateChange.from_fields(clear_unset=True) if state is None else rr.StateChange(state=state),
        )
