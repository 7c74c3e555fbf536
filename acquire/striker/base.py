"""What every striker does: home, arm, cock, strike once, stop. Angle 0 = arm vertical at the impact point, + towards the object."""

from __future__ import annotations

import enum
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from schemas.proto import percuss_pb2 as pb


class StrikerState(enum.Enum):
    """States of one strike; FAULT is reached from anywhere, and only `home` leaves it."""

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
    """What the striker itself knows of a strike."""

    contact_time_ns: int | None
    """host monotonic, first touch; None: no contact"""
    contact_time_sd_ns: float
    tip_speed_m_s: float
    """just before contact"""
    tip_speed_sd_m_s: float
    impulse_n_s: float | None
    impulse_sd_n_s: float
    contacts: int
    released_ns: int
    """host monotonic, when the swing began"""


@dataclass(frozen=True)
class ServoHealth:
    """How the servo is, as it was last asked."""

    read_ns: int
    """host monotonic"""
    model: int
    voltage_v: float
    temperature_c: int
    hardware_error: str | None
    """in words; None: all is well"""


SampleSink = Callable[[pb.StrikerSample], None]
EventSink = Callable[[pb.StrikerEvent], None]
ClockSink = Callable[[pb.ClockSample], None]


class Striker(ABC):
    """Order of calls: open, home, (arm, cock, strike)*, close. `stop` and `close` may be called at any time, from any thread."""

    @property
    @abstractmethod
    def state(self) -> StrikerState:
        """Where it stands."""

    @property
    def health(self) -> ServoHealth | None:
        """How its servo is; None: it has none, or it was not asked yet."""
        return None

    @abstractmethod
    def open(self) -> None:
        """Take the port, find the servo, write limits and read them back.

        Raises:
            StrikerNotFound: no such port, port in use, or no servo on it.
        """

    @abstractmethod
    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Clear faults and watchdog, torque on, move slowly to the parked (cocked) angle. Leaves state HOMED.

        Args:
            stopped: asked when older stops are forgotten: whether one came after this was ordered.

        Raises:
            StrikerStopped: one did, or does while the arm moves.
        """

    @abstractmethod
    def arm(self) -> None:
        """Allow one strike, for a limited time."""

    @abstractmethod
    def cock(self) -> None:
        """Go to the cocked angle and settle there. Needs ARMED; leaves SETTLED."""

    @abstractmethod
    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Swing once, catch after the contact, verify exactly one contact, disarm.

        Raises:
            StrikerRefused: not armed and settled, or the speed is outside the limits.
            StrikerStopped: a stop came in.
            StrikerFault, StrikerLost: the servo failed; torque is off where it can be reached.
        """

    @abstractmethod
    def stop(self) -> None:
        """Request an immediate stop: motion ends, arming is void."""

    @abstractmethod
    def close(self) -> None:
        """Torque off, port released. Always safe."""
