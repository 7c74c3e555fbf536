"""Striker with a Dynamixel servo.

The servo swings the arm, which turns back at contact. It runs in current-based position mode, so that its
torque is limited.

Samples of a swing are published after the arm has turned back, so that nothing delays the retraction after a
contact.
"""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError, StrikerLost, StrikerRefused, StrikerStopped
from acquire.striker.base import (
    ClockSink,
    EventSink,
    SampleSink,
    ServoHealth,
    StrikeOutcome,
    StrikerState,
)
from acquire.striker.contact import fit_contact
from acquire.striker.detector import ContactDetector
from acquire.striker.motion import SLOW_RAD_S, SLOW_RAD_S2, ArmMotion, MotionStopped
from acquire.striker.outcome import strike_outcome
from acquire.striker.sample import Sample
from acquire.striker.sequence import DeviceStriker
from acquire.striker.servo import RUN_THROUGH_RAD, Servo
from acquire.striker.states import GUARD_S, advance, is_overdue, unhomed_status
from acquire.striker.tick import TickClock
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig

HEALTH_NS = 1_000_000_000
"""interval between readings of supply voltage and temperature while nothing moves [ns]"""
RETRACT_RAD = 0.15
"""angle of the first, fast part of the retraction [rad]"""
AT_ONCE_S = 0.02
"""time to speed at full acceleration below which a swing needs no ordered acceleration [s]"""
DAMPED_S = 0.02
"""time for a stopped arm to come to rest before its position is held [s]"""

_NOT_REACHED = "the arm did not reach the impact point; check that it moves freely"
_HOST_PAUSED = "this host paused for 60 ms, and the watchdog stopped the arm; take load off the host"
_Event = pb.StrikerEvent


class DynamixelStriker(DeviceStriker):
    """Striker with a Dynamixel servo.

    While no call runs, the idle thread reads the servo ten times a second. A swing that does not reach the
    impact point retracts, and its outcome has no contact. A stop brakes the arm at the next read of the servo
    and holds it, torque on; an error brakes it and switches the torque off.

    Args:
        config: section `striker` of the rig file.
        sample_sink: called with every sample of the servo (times, tick, arm angle, velocity, current).
        event_sink: called with the events of a strike: homed, armed, released, contact and so on.
        clock_sink: called with readings of the servo's clock. All three are called from the calling thread or
            from the idle thread, and must not block for long.
        clock: host monotonic time.
    """

    idle_s = 0.1
    speed_remedy = "velocity_limit_rad_s, cocked_angle_rad or arm_length_m"

    def __init__(
        self,
        config: StrikerConfig,
        sample_sink: SampleSink,
        event_sink: EventSink,
        clock_sink: ClockSink,
        clock: MonotonicClock,
    ) -> None:
        super().__init__(config, event_sink, clock)
        self._sample_sink = sample_sink
        self._servo = Servo(config, clock)
        self._ticks = TickClock(clock_sink)
        self._health: ServoHealth | None = None
        self._motion = ArmMotion(config, self._servo, clock, self._stop_is_requested, self._publish)

    @property
    def health(self) -> ServoHealth | None:
        """Supply voltage [V], temperature [deg C] and hardware error of the servo at its last reading.

        It is read about once a second while no call runs. None if it was not read yet, or the port was lost.
        """
        return self._health

    def _open_device(self) -> None:
        self._servo.open()

    def _close_device(self) -> None:
        if self._servo.is_open:
            with contextlib.suppress(StrikerError):
                self._servo.stop_watchdog()
                self._servo.torque_off()
            self._servo.close()

    # --- strike sequence

    def _home(self) -> None:
        if not self._servo.is_open:
            self._servo.open()
        if self._servo.clear_hardware_error():
            self._ticks.restart()
            self._motion.forget()
        self._servo.torque_on()
        self._servo.start_watchdog()
        angle = self._servo.require_sample().position_rad
        self._servo.move_to(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
        self._motion.settle(2.0 + 2 * abs(angle - self._config.cocked_angle_rad) / SLOW_RAD_S)
        self._servo.stop_watchdog()

    def _arm(self) -> None:
        self._servo.raise_hardware_error()
        self._servo.keep_dead_man_switch()

    def _cock(self) -> None:
        self._servo.start_watchdog()
        self._servo.move_to(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
        self._motion.settle(min(self._config.arming_expires_s, GUARD_S[StrikerState.COCKING]))
        self._servo.stop_watchdog()

    def _strike(self, tip_speed_m_s: float) -> StrikeOutcome:
        velocity = tip_speed_m_s / self._config.arm_length_m
        self._servo.start_watchdog()
        released_ns = self._clock.monotonic_ns()
        self._enter(StrikerState.RELEASED, _Event.RELEASED)
        samples: list[Sample] = []
        detector = ContactDetector(self._config.arm_length_m, velocity)
        try:
            self._servo.move_to(RUN_THROUGH_RAD, velocity, self._swing_acceleration(velocity))
            reached = self._motion.swing(samples, detector.must_turn_back, self._is_overdue)
            stalled = not reached and self._servo.watchdog_tripped()
            self._servo.move_to(-RETRACT_RAD, 0.0, 0.0)
            turned_ns = self._clock.monotonic_ns()
            self._status = advance(
                self._status, StrikerState.CONTACT if reached else StrikerState.MISS, turned_ns
            )
            self._motion.swing(samples, _retracted, self._is_overdue)
            self._servo.move_to(self._config.cocked_angle_rad, 2 * SLOW_RAD_S, 2 * SLOW_RAD_S2)
        finally:
            for sample in samples:
                self._publish(sample)
        self._enter(StrikerState.CATCH)
        self._motion.settle(GUARD_S[StrikerState.CATCH])
        self._servo.stop_watchdog()
        # The fit takes a tenth of a second, as long as the watchdog's time: the arm stands still by now.
        impact = None
        if reached:
            impact = fit_contact(samples, turned_ns, self._config.arm_length_m, self._config.restitution)
        outcome = strike_outcome(self._config, impact, samples, released_ns, turned_ns)
        self._announce(outcome, _HOST_PAUSED if stalled else _NOT_REACHED)
        self._enter(StrikerState.VERIFY, _Event.CAUGHT)
        self._servo.raise_hardware_error()
        if outcome.contacts == 1:
            self._emit(_Event.VERIFIED)
        self._enter(StrikerState.DISARMED, _Event.DISARMED)
        return outcome

    def _swing_acceleration(self, velocity: float) -> float:
        """Acceleration to order for a swing [rad/s2]; 0 for none, if the motor reaches the speed at once.

        A weak motor that is ordered to be fast at once lags behind and then overtakes the order.
        """
        at_once = velocity < AT_ONCE_S * self._config.full_acceleration_rad_s2
        return 0.0 if at_once else self._config.swing_acceleration_rad_s2

    # --- outcome

    def _announce(self, outcome: StrikeOutcome, missed: str) -> None:
        if outcome.contact_time_ns is None:
            self._emit(_Event.MISSED, text=missed)
            return
        self._emit(
            _Event.CONTACT,
            host_time_ns=outcome.contact_time_ns,
            time_sd_ns=outcome.contact_time_sd_ns,
            tip_speed_m_s=outcome.tip_speed_m_s,
            tip_speed_sd_m_s=outcome.tip_speed_sd_m_s,
            impulse_n_s=outcome.impulse_n_s or 0.0,
            impulse_sd_n_s=outcome.impulse_sd_n_s,
        )

    def _publish(self, sample: Sample) -> None:
        self._ticks.observe(sample)
        self._sample_sink(
            pb.StrikerSample(
                host_before_ns=sample.host_before_ns,
                host_after_ns=sample.host_after_ns,
                tick_ms=sample.tick_ms,
                position_rad=sample.position_rad,
                velocity_rad_s=sample.velocity_rad_s,
                current_a=sample.current_a,
            )
        )

    # --- states

    def _is_overdue(self, now_ns: int) -> bool:
        return is_overdue(self._status, now_ns)

    def _run_guarded(self, action: Callable[[], Any]) -> Any:
        """Call `action` and return its result; hold the arm after a stop, switch torque off after an error.

        Args:
            action: part of a call, e.g. the motions of a strike.

        Raises:
            StrikerStopped: a stop was requested during the action; the arm is held and the state DISARMED, or
                FAULT if the servo fails.
            StrikerRefused: raised by the action; nothing else happens.
            StrikerError: raised by the action; the torque is switched off if the servo can be reached, and
                the state is FAULT.
        """
        try:
            return action()
        except MotionStopped:
            self._hold()
            raise StrikerStopped from None
        except StrikerRefused:
            raise
        except StrikerError as error:
            self._enter_fault(error)
            raise

    def _hold(self) -> None:
        """Hold the braked arm at its position with torque on; the state is DISARMED and not homed afterwards.

        Called after a stop request, which is cleared and reported as an event. If the servo fails, the state
        is FAULT instead.
        """
        self._stop_requested = False
        try:
            time.sleep(DAMPED_S)
            self._servo.hold()
            self._servo.stop_watchdog()
        except StrikerError as error:
            self._enter_fault(error)
            return
        finally:
            self._emit(_Event.STOPPED)
        self._status = unhomed_status(self._clock.monotonic_ns())

    def _stop_is_requested(self) -> bool:
        return self._stop_requested

    def _secure(self, error: StrikerError) -> None:
        with contextlib.suppress(StrikerError):
            # Without torque a moving arm would run on against its friction alone; the watchdog stops one
            # whose servo is lost.
            if not isinstance(error, StrikerLost):
                self._motion.brake()
                time.sleep(DAMPED_S)
        with contextlib.suppress(StrikerError):
            self._servo.torque_off()
        if isinstance(error, StrikerLost):
            self._servo.close()  # an unplugged port only works after it was opened again

    def _attend(self) -> None:
        """Read servo and clock; restart the process that switches the torque off when this one dies."""
        if not self._servo.is_open:
            self._health = None
            return
        failed = self._status.state is StrikerState.FAULT
        try:
            self._servo.keep_dead_man_switch()
            if not failed:
                self._publish(self._servo.require_sample())
            if self._health is None or self._clock.monotonic_ns() - self._health.read_ns > HEALTH_NS:
                self._health = self._servo.health()
        except StrikerError as error:
            if not failed:
                raise
            if isinstance(error, StrikerLost):
                self._servo.close()


def _retracted(sample: Sample) -> bool:
    return sample.velocity_rad_s < 0 and sample.position_rad < -0.7 * RETRACT_RAD
