"""Interface of a striker: home, arm, cock, strike once, stop.

Arm angle 0 is vertical, at the impact point; positive towards the object. The daemon chooses the class by
the rig file's `striker.kind` (acquire/striker/kinds.py).
"""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from schemas.proto import percuss_pb2 as pb


class StrikerState(enum.Enum):
    """State of the striker; the states of a strike are listed in their order.

    DISARMED: no strike allowed. HOMED: at a known place, torque on. ARMED: one strike allowed. COCKING:
    moving to the cocked (raised) angle. SETTLED: at rest there. RELEASED: swinging. CONTACT: retracting after
    a contact, or because the tip is beyond the impact point. MISS: retracting because neither happened within
    the time limit of RELEASED. CATCH: returning to the cocked angle. VERIFY: checking the servo;
    DISARMED follows. Any state can go to FAULT, and only `home` and `close` leave it.
    """

    DISARMED = "disarmed"
    HOMED = "homed"
    ARMED = "armed"
    COCKING = "cocking"
    SETTLED = "settled"
    RELEASED = "released"
    CONTACT = "contact"
    MISS = "miss"
    CATCH = "catch"
    VERIFY = "verify"
    FAULT = "fault"


@dataclass(frozen=True)
class StrikeOutcome:
    """Measurements of one strike: contact time [ns], tip speed [m/s], impulse [N s], number of contacts.

    The tip speed is that just before contact. Contact time (host monotonic), speed and impulse are None if
    the striker did not measure them. Time, speed and impulse have standard deviations.
    """

    contact_time_ns: int | None
    """host monotonic time of first contact [ns]; None if no contact was measured"""
    contact_time_sd_ns: float
    """standard deviation of the contact time [ns]; 0 if no contact was measured"""
    tip_speed_m_s: float | None
    """tip speed just before contact [m/s]; 0 after a miss; None if the striker does not measure it"""
    tip_speed_sd_m_s: float
    """standard deviation of the tip speed [m/s]; 0 after a miss, or if it was not measured"""
    impulse_n_s: float | None
    """impulse on the object [N s]; None if no contact or no significant loss of speed was measured"""
    impulse_sd_n_s: float
    """standard deviation of the impulse [N s]; 0 if it is None"""
    contacts: int
    """number of contacts that may have occurred; 0 if no contact was measured"""
    released_ns: int
    """host monotonic time [ns] at which the swing, or the wait for the person's strike, began"""

    @property
    def missed(self) -> bool:
        """True if the striker found that it met nothing; False also if it cannot find that out."""
        return self.contact_time_ns is None and self.tip_speed_m_s == 0


@dataclass(frozen=True)
class ServoHealth:
    """Model, supply voltage [V], temperature [deg C] and hardware error of the servo at one reading.

    The hardware error is a text that describes it, or None if the servo reports none.
    """

    read_ns: int
    """host monotonic time of the reading [ns]"""
    model: int
    """model number of the servo"""
    voltage_v: float
    """supply voltage [V]"""
    temperature_c: int
    """temperature inside the servo [deg C]"""
    hardware_error: str | None
    """description of the hardware error; None if there is none"""


SampleSink = Callable[[pb.StrikerSample], None]
EventSink = Callable[[pb.StrikerEvent], None]
ClockSink = Callable[[pb.ClockSample], None]


class Striker(ABC):
    """Device that strikes the object once per arming (permission for one strike).

    Order of calls: open, home, then arm, cock and strike for each strike, close. `stop` and `close` may be
    called at any time, from any thread.
    """

    @property
    @abstractmethod
    def state(self) -> StrikerState:
        """Current state of the striker, e.g. DISARMED, HOMED, ARMED or FAULT."""

    @property
    def health(self) -> ServoHealth | None:
        """Supply voltage [V], temperature [deg C] and hardware error of the servo at its last reading.

        None without a servo, before the first reading, or if the servo's port was lost.
        """
        return None

    @abstractmethod
    def open(self) -> None:
        """Open the striker's port, find the servo, write its limits and read them back.

        The limits are those of current, velocity, position and temperature. A striker without a servo has
        nothing to open.

        Raises:
            StrikerNotFound: no such port, port in use, or no known servo on it.
            StrikerError: the servo does not take a limit, or no longer answers.
        """

    @abstractmethod
    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Clear faults and watchdog, switch the torque on, and move slowly to the cocked (raised) angle.

        The state is HOMED afterwards.

        Args:
            stopped: function that returns True if a stop was requested after this homing was ordered; called
                after the stop requests received so far were cleared.

        Raises:
            StrikerStopped: a stop was requested after this homing was ordered, or while the arm moves.
            StrikerRefused: a strike is allowed or running (the manual striker only).
            StrikerError: the servo failed.
        """

    @abstractmethod
    def arm(self) -> None:
        """Allow one strike, for the time `arming_expires_s` of the rig file. The state is ARMED afterwards.

        Raises:
            StrikerRefused: not homed, or a strike is allowed or running already.
            StrikerError: the servo failed.
        """

    @abstractmethod
    def cock(self) -> None:
        """Move to the cocked (raised) angle and settle there.

        Requires state ARMED; the state is SETTLED afterwards.

        Raises:
            StrikerRefused: not armed, or the arming expired (with a servo).
            StrikerStopped: a stop was requested.
            StrikerError: the servo failed.
        """

    @abstractmethod
    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Swing once, retract after the contact, count the contacts, and disarm; return the measurements.

        Args:
            strike_id: id of the strike in the events.
            tip_speed_m_s: tip speed to command [m/s].

        Returns:
            Contact time (host monotonic) [ns], tip speed before contact [m/s], impulse [N s] and number of
            contacts; time and impulse are None if they were not measured.

        Raises:
            StrikerRefused: not armed, not settled, the arming expired, or the speed is outside the servo's
                limits.
            StrikerStopped: a stop was requested.
            StrikerError: the servo failed; its torque is off if it can be reached.
        """

    @abstractmethod
    def stop(self) -> None:
        """Request an immediate stop: motion ends, and no strike is allowed any longer."""

    @abstractmethod
    def close(self) -> None:
        """Switch torque off and release the port. Safe in any state, also if nothing is open."""
