"""Wait for the contacts of a strike, and its outcome as far as a striker board measures it."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from acquire.errors import StrikerStopped
from acquire.striker.base import StrikeOutcome
from acquire.striker.board_clock import BoardClock, host_time
from acquire.striker.board_problem import refuse_ended

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from acquire.clock.reading import ClockReading
    from acquire.striker.board_lines import BoardIdentity, BoardStatus
    from acquire.striker.board_link import BoardLink
    from acquire.striker.bus import MonotonicClock

POLL_S = 0.01
"""interval at which the board is asked for its state during a strike [s]"""
CONTACT_S = 1.4
"""time after the firing within which a contact is expected [s]"""
FURTHER_CONTACTS_S = 0.3
"""time after the first contact in which further ones are counted [s]"""

SPEED_ROUNDING_MM_S = 0.3
"""standard deviation of rounding to 1 mm/s"""


def wait_for_contacts(link: BoardLink, clock: MonotonicClock, stopped: Callable[[], bool]) -> BoardStatus:
    """Board's last report on a strike: 0.3 s after the first contact, or 1.4 s after the firing without one.

    Args:
        link: connection to the board, which has just fired.
        clock: host monotonic time.
        stopped: function that returns True if a stop was requested.

    Raises:
        StrikerStopped: a stop was requested.
        StrikerError: the board does not answer, was reset or is in a fault.
    """
    end_ns = clock.monotonic_ns() + round(CONTACT_S * 1e9)
    touched = False
    while True:
        status = link.status("state")
        now_ns = clock.monotonic_ns()
        if stopped():
            raise StrikerStopped
        refuse_ended(link.port, status)
        if status.contacts and not touched:
            touched, end_ns = True, now_ns + round(FURTHER_CONTACTS_S * 1e9)
        if now_ns > end_ns:
            return status
        time.sleep(POLL_S)


def board_outcome(
    identity: BoardIdentity,
    status: BoardStatus,
    clock: BoardClock,
    readings: Sequence[ClockReading],
    released_ns: int,
    contact_sd_s: float,
) -> StrikeOutcome:
    """Contact time [ns], tip speed [m/s] and number of contacts of one strike.

    What the board does not measure is None: time and speed where it senses no contacts, the speed where it
    has no speed sensor, the impulse always. If it senses contacts and felt none, the speed is 0.

    Args:
        identity: what the board measures.
        status: its last report on the strike.
        clock: its clock.
        readings: readings of the clock before and after the strike.
        released_ns: host monotonic time of the firing [ns]; copied into the outcome.
        contact_sd_s: standard deviation of the contact sensor's delay behind the first touch [s].
    """
    if not identity.senses_contact:
        return StrikeOutcome(None, 0.0, None, 0.0, None, 0.0, 0, released_ns)
    if not status.contacts:
        return StrikeOutcome(None, 0.0, 0.0, 0.0, None, 0.0, 0, released_ns)
    speed, speed_sd = None, 0.0
    if identity.measures_speed and status.speed_mm_s:
        speed = 1e-3 * status.speed_mm_s
        speed_sd = 1e-3 * math.hypot(status.speed_sd_mm_s, SPEED_ROUNDING_MM_S)
    touched = host_time(clock.device_time_ns(status.contact_us), readings)
    if touched is None:  # the clock was reset, or runs wrong: the images give the time
        return StrikeOutcome(None, 0.0, speed, speed_sd, None, 0.0, status.contacts, released_ns)
    contact_ns, clock_sd_ns = touched
    contact_sd_ns = math.hypot(clock_sd_ns, 1e9 * contact_sd_s)
    return StrikeOutcome(contact_ns, contact_sd_ns, speed, speed_sd, None, 0.0, status.contacts, released_ns)
