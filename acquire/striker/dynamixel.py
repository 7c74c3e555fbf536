"""Striker with a Dynamixel servo; one file, because calls, stop and idle thread share one lock and state.

The servo swings the arm, which turns back at contact. It runs in current-based position mode, so that its
torque is limited.

Samples of a swing are published after the arm has turned back, so that nothing delays the retraction after a
contact.
"""

from __future__ import annotations

import contextlib
import threading
import time
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError, StrikerLost, StrikerRefused, StrikerStopped
from acquire.striker.base import (
    ClockSink,
    EventSink,
    SampleSink,
    ServoHealth,
    StrikeOutcome,
    Striker,
    StrikerState,
)
from acquire.striker.contact import fit_contact
from acquire.striker.detector import ContactDetector
from acquire.striker.motion import SLOW_RAD_S, SLOW_RAD_S2, ArmMotion, MotionStopped
from acquire.striker.outcome import strike_outcome
from acquire.striker.sample import Sample
from acquire.striker.servo import RUN_THROUGH_RAD, Servo
from acquire.striker.states import GUARD_S, StrikerStatus, advance, arming_expired, is_overdue, unhomed_status
from acquire.striker.tick import TickClock
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig

IDLE_S = 0.1
"""interval at which the idle thread reads the servo [s]"""
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


class DynamixelStriker(Striker):
    """Striker with a Dynamixel servo.

    Order of calls: open, home, then arm, cock and strike for each strike, close. Blocking calls may come from
    one thread at a time; `stop`, `close` and `state` from any. While no call runs, an idle thread reads the
    servo ten times a second.

    Args:
        config: section `striker` of the rig file.
        sample_sink: called with every sample of the servo (times, tick, arm angle, velocity, current).
        event_sink: called with the events of a strike: homed, armed, released, contact and so on.
        clock_sink: called with readings of the servo's clock. All three are called from the calling thread or
            from the idle thread, and must not block for long.
        clock: host monotonic time.
    """

    def __init__(
        self,
        config: StrikerConfig,
        sample_sink: SampleSink,
        event_sink: EventSink,
        clock_sink: ClockSink,
        clock: MonotonicClock,
    ) -> None:
        self._config = config
        self._sample_sink, self._event_sink = sample_sink, event_sink
        self._clock = clock
        self._servo = Servo(config, clock)
        self._ticks = TickClock(clock_sink)
        self._status = StrikerStatus(StrikerState.DISARMED, clock.monotonic_ns())
        self._strike_id = ""
        self._fault_text = ""
        self._health: ServoHealth | None = None
        self._stop_requested = False  # a plain flag: a signal handler may do no more than set it
        self._call_lock = threading.Lock()  # not re-entrant: a signal handler must not enter during a call
        self._motion = ArmMotion(config, self._servo, clock, self._stop_is_requested, self._publish)
        self._closing = threading.Event()
        self._watch: threading.Thread | None = None

    @property
    def state(self) -> StrikerState:
        """Current state of the striker, e.g. DISARMED, HOMED, ARMED or FAULT."""
        return self._status.state

    @property
    def health(self) -> ServoHealth | None:
        """Supply voltage [V], temperature [deg C] and hardware error of the servo at its last reading.

        It is read about once a second while no call runs. None if it was not read yet, or the port was lost.
        """
        return self._health

    # --- open and close

    def open(self) -> None:
        """Open the port, find the servo, write its limits and read them back; start the idle thread.

        Raises:
            StrikerNotFound: no such port, port in use, or no servo of a known model on it.
            StrikerError: a limit is refused or reads back differently, the servo no longer answers, or the
                process that switches the torque off when this one dies does not start.
        """
        with self._call_lock:
            self._servo.open()
            self._closing.clear()
            self._watch = threading.Thread(target=self._watch_idle, name="striker-watch", daemon=True)
            self._watch.start()

    def close(self) -> None:
        """End a running call and the idle thread, switch torque off and release the port. Always safe.

        The state is DISARMED and not homed afterwards.
        """
        self._stop_requested = True  # ends a call that runs in another thread
        self._closing.set()
        watch, self._watch = self._watch, None
        if watch is not None and watch is not threading.current_thread():
            watch.join()
        with self._call_lock:
            if self._servo.is_open:
                with contextlib.suppress(StrikerError):
                    self._servo.stop_watchdog()
                    self._servo.torque_off()
                self._servo.close()
            self._status = unhomed_status(self._clock.monotonic_ns())
            self._stop_requested = False

    def stop(self) -> None:
        """Request an immediate stop: motion ends, and no strike is allowed any longer.

        Never blocks. If a call in another thread is moving the arm, that call brakes the arm at its next
        read of the servo and raises StrikerStopped.
        """
        self._stop_requested = True
        if self._call_lock.acquire(blocking=False):
            try:
                self._consume_stop()
            finally:
                self._call_lock.release()

    # --- strike sequence

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """Clear a fault, switch the torque on, and move slowly to the cocked (raised) angle.

        The state is HOMED afterwards. A port that was lost is opened again.

        Args:
            stopped: function that returns True if a stop was requested after this homing was ordered; called
                after the stop requests received so far were cleared.

        Raises:
            StrikerStopped: a stop was requested after this homing was ordered, or while the arm moves.
            StrikerError: the servo is not found, does not answer, reports a hardware error again, or the arm
                does not come to rest; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            if stopped():
                raise StrikerStopped
            if self._status.state not in {StrikerState.FAULT, StrikerState.HOMED, StrikerState.DISARMED}:
                self._enter(StrikerState.DISARMED)
            self._run_guarded(self._home)

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
        self._enter(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """Allow one strike, for the time `arming_expires_s` of the rig file. The state is ARMED afterwards.

        Raises:
            StrikerRefused: not homed, or a strike is allowed or running already.
            StrikerError: the servo reports a hardware error or does not answer, or the process that switches
                the torque off when this one dies does not start; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            advance(self._status, StrikerState.ARMED, self._clock.monotonic_ns())
            self._run_guarded(self._servo.raise_hardware_error)
            self._run_guarded(self._servo.keep_dead_man_switch)
            self._enter(StrikerState.ARMED, _Event.ARMED)

    def cock(self) -> None:
        """Move to the cocked (raised) angle and settle there. The state is SETTLED afterwards.

        Raises:
            StrikerRefused: not armed, or the arming expired.
            StrikerStopped: a stop was requested; it is a StrikerRefused.
            StrikerError: the servo reports a hardware error, refuses an order or does not answer, or the arm
                does not settle; the state is FAULT then.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            self._enter(StrikerState.COCKING)
            self._run_guarded(self._cock)

    def _cock(self) -> None:
        self._servo.start_watchdog()
        self._servo.move_to(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
        self._motion.settle(min(self._config.arming_expires_s, GUARD_S[StrikerState.COCKING]))
        self._servo.stop_watchdog()
        self._enter(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """Swing once, retract after the contact, count the contacts, and disarm; return the measurements.

        If the arm does not reach the impact point, it retracts, and the outcome has no contact.

        Args:
            strike_id: id of the strike in the events.
            tip_speed_m_s: tip speed to command [m/s].

        Returns:
            Contact time (host monotonic) [ns], tip speed before contact [m/s], impulse [N s] and number of
            contacts. Without a contact, time and impulse are None, the others 0. The impulse is also None if
            no significant loss of speed was measured.

        Raises:
            StrikerRefused: not armed, not settled, the arming expired, or the speed is outside the limits.
            StrikerStopped: a stop was requested; it is a StrikerRefused.
            StrikerError: the servo reports a hardware error, refuses an order or does not answer, or the arm
                does not settle; the state is FAULT then, and the torque is off if the servo can be reached.
        """
        with self._call_lock:
            self._consume_stop()
            self._disarm_if_expired()
            now_ns = self._clock.monotonic_ns()
            advance(self._status, StrikerState.RELEASED, now_ns)
            velocity = self._checked_velocity(tip_speed_m_s)
            self._strike_id = strike_id
            outcome: StrikeOutcome = self._run_guarded(lambda: self._strike(velocity))
            return outcome

    def _checked_velocity(self, tip_speed_m_s: float) -> float:
        # Compared as tip speed, like the plan's limits, so that rounding never makes a planned speed a
        # refused one.
        if problem := self._config.tip_speeds().problem(tip_speed_m_s):
            raise StrikerRefused(
                f"{problem}; change velocity_limit_rad_s, cocked_angle_rad or arm_length_m in the rig file"
            )
        return tip_speed_m_s / self._config.arm_length_m

    def _strike(self, velocity: float) -> StrikeOutcome:
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

    def _emit(self, kind: _Event.Kind, **fields: Any) -> None:
        fields.setdefault("host_time_ns", self._clock.monotonic_ns())
        self._event_sink(_Event(kind=kind, strike_id=self._strike_id, **fields))

    # --- states

    def _is_overdue(self, now_ns: int) -> bool:
        return is_overdue(self._status, now_ns)

    def _enter(self, state: StrikerState, kind: _Event.Kind | None = None) -> None:
        now_ns = self._clock.monotonic_ns()
        self._status = advance(self._status, state, now_ns)
        if state is StrikerState.DISARMED:
            self._strike_id, strike_id = "", self._strike_id
            if kind is not None:
                self._event_sink(_Event(kind=kind, strike_id=strike_id, host_time_ns=now_ns))
        elif kind is not None:
            self._emit(kind, host_time_ns=now_ns)

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

    def _consume_stop(self) -> None:
        """Clear a stop that was requested while nothing moved, and report it as an event.

        A strike is no longer allowed then, and the arm stays where it is. Without a request nothing happens.
        """
        if not self._stop_requested:
            return
        self._stop_requested = False
        self._emit(_Event.STOPPED)
        if self._status.armed_ns is not None:
            self._enter(StrikerState.DISARMED, _Event.DISARMED)

    def _disarm_if_expired(self) -> None:
        if arming_expired(self._status, self._clock.monotonic_ns(), self._config.arming_expires_s):
            self._enter(StrikerState.DISARMED, _Event.DISARMED)

    def _enter_fault(self, error: StrikerError) -> None:
        # The same fault again after homing is not announced twice.
        again = self._status.state is StrikerState.FAULT and str(error) == self._fault_text
        self._fault_text = str(error)
        self._status = advance(self._status, StrikerState.FAULT, self._clock.monotonic_ns())
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
        if not again:
            self._emit(_Event.FAULT, text=str(error))

    def _watch_idle(self) -> None:
        """Run the idle thread: read servo and clock while no call runs, disarm when the arming expires.

        It also restarts the process that switches the torque off when this one dies. If the servo fails, the
        state is FAULT. The thread ends when the striker is closed.
        """
        while not self._closing.wait(IDLE_S):
            if not self._call_lock.acquire(blocking=False):
                continue
            try:
                self._consume_stop()
                self._disarm_if_expired()
                if not self._servo.is_open:
                    self._health = None
                    continue
                self._servo.keep_dead_man_switch()
                if self._status.state is not StrikerState.FAULT:
                    self._publish(self._servo.require_sample())
                if self._health is None or self._clock.monotonic_ns() - self._health.read_ns > HEALTH_NS:
                    self._health = self._servo.health()
            except StrikerError as error:
                if self._status.state is not StrikerState.FAULT:
                    self._enter_fault(error)
                elif isinstance(error, StrikerLost):
                    self._servo.close()
            finally:
                self._call_lock.release()


def _retracted(sample: Sample) -> bool:
    return sample.velocity_rad_s < 0 and sample.position_rad < -0.7 * RETRACT_RAD
