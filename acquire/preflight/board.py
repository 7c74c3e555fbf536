"""Check of a striker board on a serial port: identity, speeds, state and clock. Nothing is armed or fired."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from acquire.errors import StrikerError
from acquire.preflight.check import Check, Measured, failed_by_error, failed_check, passed_check
from schemas.software import extra_command

if TYPE_CHECKING:
    from acquire.clock.clock import Clock
    from schemas.rig import StrikerConfig

BOARD_LINE = "striker board"
"""name of the board's check, which is made in place of those of a servo"""
MAX_ROUND_TRIP_MS = 5.0
"""longest time for a reading of the board's clock [ms]: half of it is the error of a contact time"""
READINGS = 16
"""number of readings, of which the shortest counts"""


@dataclass(frozen=True)
class BoardFacts:
    """Name of the board, what it measures, and the shortest time for a reading of its clock [ms]."""

    name: str
    """name that the board's program gives itself"""
    measures: str
    """what it measures, in words"""
    round_trip_ms: float
    """shortest time from request to reply [ms]"""


ReadBoard = Callable[["StrikerConfig"], BoardFacts]


def read_board(config: StrikerConfig, clock: Clock) -> BoardFacts:
    """Open the port of a striker board, read its identity, state and clock, and close the port again.

    Args:
        config: the rig file's settings of the striker.
        clock: clock of the host.

    Raises:
        StrikerError: no port, no board, other speeds than in the rig file, a fault, no answer, or the serial
            port's library is missing.
    """
    try:
        from acquire.striker.board_link import BoardLink
        from acquire.striker.board_problem import refuse_fault, refuse_other_speeds
    except ImportError as error:
        raise StrikerError(
            f"{config.port}: the serial port's library is missing ({error}): {extra_command('rig')}"
        ) from None
    link = BoardLink(config.port, config.baud_rate, clock)
    identity = link.open()
    try:
        refuse_other_speeds(config, identity)
        refuse_fault(config.port, link.status("state"))
        trips = [after - before for _, before, after in (link.read_time() for _ in range(READINGS))]
    finally:
        link.close()
    measures = "contact time" if identity.senses_contact else "no contact: the images give its time"
    if identity.measures_speed:
        measures += " and speed"
    return BoardFacts(identity.name, measures, 1e-6 * min(trips))


def check_board(read: ReadBoard, config: StrikerConfig) -> Check:
    """Check a striker board that no daemon holds.

    Args:
        read: function that reads the board.
        config: the rig file's settings of the striker.
    """
    try:
        facts = read(config)
    except StrikerError as error:
        return failed_by_error(BOARD_LINE, error)
    limits = config.tip_speeds()
    found = (
        f"{facts.name}, {limits.slowest_m_s:g} to {limits.fastest_m_s:g} m/s, measures {facts.measures}; its "
        f"clock is read in {facts.round_trip_ms:.2g} ms"
    )
    measured = Measured(facts.round_trip_ms, MAX_ROUND_TRIP_MS, "ms")
    if facts.round_trip_ms > MAX_ROUND_TRIP_MS:
        remedy = f"set the adapter's latency timer to 1 ms (at most {MAX_ROUND_TRIP_MS:g} ms)"
        return failed_check(BOARD_LINE, found, remedy, measured)
    return passed_check(BOARD_LINE, found, measured)


def check_held_board(state: str, trouble: str = "") -> Check:
    """Check a striker board that a daemon holds, by the state of the daemon's striker.

    Args:
        state: state of the daemon's striker, for example "homed" or "fault".
        trouble: reason of the striker's fault, if it is in one.
    """
    if state == "fault":
        remedy = "correct the fault; the next session homes the striker"
        return failed_check(BOARD_LINE, f"the daemon's striker is in a fault: {trouble}", remedy)
    return passed_check(BOARD_LINE, f"held by the daemon, {state}")
