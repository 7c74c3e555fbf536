"""The striker that a Dynamixel swings: an arm in current-based position mode that turns back the moment it has touched.

Samples of a swing are handed on after the arm has turned back: nothing that could wait stands between a contact and the retraction.
"""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, Any

from acquire.errors import StrikerError, StrikerFault, StrikerLost, StrikerRefused, StrikerStopped
from acquire.striker.base import ClockSink, EventSink, SampleSink, ServoHealth, StrikeOutcome, Striker, StrikerState
from acquire.striker.contact import Contact, fit_contact
from acquire.striker.detector import ContactDetector, count_contacts
from acquire.striker.servo import RUN_THROUGH_RAD, TICK_RAD, VELOCITY_UNIT_RAD_S, Sample, Servo
from acquire.striker.states import GUARD_S, StrikerStatus, advance, arming_expired, overdue, unhomed
from acquire.striker.tick import TickClock
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.config import StrikerConfig
    from acquire.striker.bus import MonotonicClock

IDLE_S = 0.1
HEALTH_NS = 1_000_000_000
"""between looks at supply and temperature, while nothing moves"""
APPROACH_S = 0.01
"""between reads while the arm moves slowly or settles"""
SWING_NS = 1_000_000
DITHER_NS = 600_000
"""reads of a swing are spread over this much of their period: the servo renews its registers at 1 kHz too, and in step with it every read
could fall on a renewal, so that none would say which of two values it holds"""
GOLDEN = 0.6180339887498949
SLOW_RAD_S = 0.8
SLOW_RAD_S2 = 8.0
SETTLED_TICKS = 4.5
SETTLED_UNITS = 1.5
SETTLED_READS = 20
RETRACT_RAD = 0.15
"""the first, fast part of the way back"""
SILENCE_NS = 200_000_000
"""without an answer in a swing: by then the servo's own watchdog (100 ms) has stopped it, if it was this host that stood still"""
STALE_NS = 80_000_000
"""older reads say nothing of how fast the arm is"""
VELOCITY_LAG_S = 0.003
"""what the velocity register shows is this old, within a millisecond or two (see velocity_register.py)"""
REST_RAD_S = 0.3
"""slower needs no brake"""
DAMPED_S = 0.02
"""a stopped arm is given to come to rest before its place is held"""
GLANCE_S = 0.002
"""pauses end at a stop within this"""

_NOT_REACHED = "the arm did not reach the impact point; check that it moves freely"
_Event = pb.StrikerEvent


class _Stopped(Exception):
    """Somebody called stop."""


class DynamixelStriker(Striker):
    """Order of calls as in Striker. Blocking calls belong to one thread at a time; `stop`, `close` and `state` to any.

    Args:
        config: the rig file's section.
        sample_sink, event_sink, clock_sink: called from the calling thread, or from the idle watch's; they must not block for long.
        clock: host monotonic time.
    """

    def __init__(
        self, config: StrikerConfig, sample_sink: SampleSink, event_sink: EventSink, clock_sink: ClockSink, clock: MonotonicClock
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
        self._recent: deque[Sample] = deque(maxlen=3)
        self._stop_requested = False  # a plain flag: setting it is all that a signal handler may do
        self._verb = threading.Lock()  # not re-entrant: a signal handler in the middle of a verb must not get in
        self._closing = threading.Event()
        self._watch: threading.Thread | None = None

    @property
    def state(self) -> StrikerState:
        """Where it stands."""
        return self._status.state

    @property
    def health(self) -> ServoHealth | None:
        """See Striker. Asked about once a second while nothing moves."""
        return self._health

    # --- open and close ---------------------------------------------------------------------------------------------

    def open(self) -> None:
        """See Striker."""
        with self._verb:
            self._servo.open()
            self._closing.clear()
            self._watch = threading.Thread(target=self._watch_idle, name="striker-watch", daemon=True)
            self._watch.start()

    def close(self) -> None:
        """See Striker."""
        self._stop_requested = True  # ends a verb in another thread
        self._closing.set()
        watch, self._watch = self._watch, None
        if watch is not None and watch is not threading.current_thread():
            watch.join()
        with self._verb:
            if self._servo.is_open:
                with contextlib.suppress(StrikerError):
                    self._servo.unguard()
                    self._servo.torque_off()
                self._servo.close()
            self._status = unhomed(self._clock.monotonic_ns())
            self._stop_requested = False

    def stop(self) -> None:
        """See Striker. Only requests, where a call is at work in another thread: it ends within its next read."""
        self._stop_requested = True
        if self._verb.acquire(blocking=False):
            try:
                self._consume_stop()
            finally:
                self._verb.release()

    # --- verbs ------------------------------------------------------------------------------------------------------

    def home(self, stopped: Callable[[], bool] = lambda: False) -> None:
        """See Striker. Also the way out of FAULT: opens the port anew where it was lost."""
        with self._verb:
            self._consume_stop()
            if stopped():
                raise StrikerStopped
            if self._status.state not in {StrikerState.FAULT, StrikerState.HOMED, StrikerState.DISARMED}:
                self._set(StrikerState.DISARMED)
            self._guarded(self._home)

    def _home(self) -> None:
        if not self._servo.is_open:
            self._servo.open()
        if self._servo.clear_hardware_error():
            self._ticks.restart()
        self._servo.torque_on()
        self._servo.guard()
        angle = self._servo.require_sample().position_rad
        self._servo.go(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
        self._settle(2.0 + 2 * abs(angle - self._config.cocked_angle_rad) / SLOW_RAD_S)
        self._servo.unguard()
        self._set(StrikerState.HOMED, _Event.HOMED)

    def arm(self) -> None:
        """See Striker.

        Raises:
            StrikerRefused: not homed, or a strike is under way.
            StrikerFault: the servo reports a hardware error.
        """
        with self._verb:
            self._consume_stop()
            self._expire()
            advance(self._status, StrikerState.ARMED, self._clock.monotonic_ns())
            self._guarded(self._servo.raise_hardware_error)
            self._guarded(self._servo.keep_dead_man)
            self._set(StrikerState.ARMED, _Event.ARMED)

    def cock(self) -> None:
        """See Striker.

        Raises:
            StrikerRefused: not armed, the arming expired, or a stop came in.
            StrikerFault: the servo reports a hardware error, or the arm does not settle.
        """
        with self._verb:
            self._consume_stop()
            self._expire()
            self._set(StrikerState.COCKING)
            self._guarded(self._cock)

    def _cock(self) -> None:
        self._servo.guard()
        self._servo.go(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
        self._settle(min(self._config.arming_expires_s, GUARD_S[StrikerState.COCKING]))
        self._servo.unguard()
        self._set(StrikerState.SETTLED, _Event.COCKED)

    def strike(self, strike_id: str, tip_speed_m_s: float) -> StrikeOutcome:
        """See Striker."""
        with self._verb:
            self._consume_stop()
            self._expire()
            now_ns = self._clock.monotonic_ns()
            advance(self._status, StrikerState.RELEASED, now_ns)
            velocity = self._checked_velocity(tip_speed_m_s)
            self._strike_id = strike_id
            outcome: StrikeOutcome = self._guarded(lambda: self._strike(velocity))
            return outcome

    def _checked_velocity(self, tip_speed_m_s: float) -> float:
        # In terms of the tip, as the plan's limits: no rounding on the way makes a planned speed one that is refused.
        limits = self._config.tip_speeds()
        if not limits.allow(tip_speed_m_s):
            raise StrikerRefused(
                f"a tip speed of {tip_speed_m_s:.3g} m/s is outside {limits.slowest_m_s:.3g} to {limits.fastest_m_s:.3g} m/s; "
                "change velocity_limit_rad_s, cocked_angle_rad or arm_length_m in the rig file"
            )
        return tip_speed_m_s / self._config.arm_length_m

    def _strike(self, velocity: float) -> StrikeOutcome:
        self._servo.guard()
        released_ns = self._clock.monotonic_ns()
        self._set(StrikerState.RELEASED, _Event.RELEASED)
        samples: list[Sample] = []
        detector = ContactDetector(self._config.arm_length_m, velocity)
        try:
            self._servo.go(RUN_THROUGH_RAD, velocity, 0.0)
            reached = self._swing(samples, detector.turn_back)
            stalled = not reached and self._servo.tripped()
            self._servo.go(-RETRACT_RAD, 0.0, 0.0)
            turned_ns = self._clock.monotonic_ns()
            self._status = advance(self._status, StrikerState.CONTACT if reached else StrikerState.MISS, turned_ns)
            self._swing(samples, lambda sample: sample.velocity_rad_s < 0 and sample.position_rad < -0.7 * RETRACT_RAD)
            self._servo.go(self._config.cocked_angle_rad, 2 * SLOW_RAD_S, 2 * SLOW_RAD_S2)
        finally:
            for sample in samples:
                self._publish(sample)
        self._set(StrikerState.CATCH)
        self._settle(GUARD_S[StrikerState.CATCH])
        self._servo.unguard()
        # The fit takes a tenth of a second, as long as the watchdog waits: the arm stands by now.
        contact = fit_contact(samples, turned_ns, self._config.arm_length_m, self._config.restitution) if reached else None
        outcome = self._outcome(contact, samples, released_ns, turned_ns)
        missed = "this host stood still for 100 ms, and the watchdog stopped the arm; take load off it" if stalled else _NOT_REACHED
        self._announce(outcome, missed)
        self._set(StrikerState.VERIFY, _Event.CAUGHT)
        self._servo.raise_hardware_error()
        if outcome.contacts == 1:
            self._emit(_Event.VERIFIED)
        self._set(StrikerState.DISARMED, _Event.DISARMED)
        return outcome

    def _swing(self, samples: list[Sample], ended: Callable[[Sample], bool]) -> bool:
        """Read at 1 kHz until `ended`; False when the guard's time is up first."""
        heard_ns = next_ns = self._clock.monotonic_ns()
        spread = 0.0
        while not overdue(self._status, heard_ns):
            if self._stop_requested:
                self._brake()
                raise _Stopped
            sample = self._servo.sample(self._stop_is_requested)
            now_ns = self._clock.monotonic_ns()
            if sample is not None:
                heard_ns = now_ns
                samples.append(sample)
                self._recent.append(sample)
                if ended(sample):
                    return True
            elif now_ns - heard_ns > SILENCE_NS:
                raise StrikerLost(f"{self._config.port}: the servo fell silent in the swing; its watchdog stops it; check power and cable")
            next_ns = max(next_ns + SWING_NS, now_ns)  # a slow bus is not caught up with
            spread = (spread + GOLDEN) % 1.0
            time.sleep(max(0, next_ns + int(spread * DITHER_NS) - now_ns) * 1e-9)
        return False

    def _settle(self, timeout_s: float) -> None:
        """Wait until the arm rests at the cocked angle."""
        end_ns = self._clock.monotonic_ns() + int(timeout_s * 1e9)
        settled = 0
        angle = math.nan
        while self._clock.monotonic_ns() < end_ns:
            if self._stop_requested:
                self._brake()
                raise _Stopped
            sample = self._servo.sample(self._stop_is_requested)
            if sample is None:
                if self._stop_requested:
                    continue
                sample = self._servo.require_sample()
            self._recent.append(sample)
            self._publish(sample)
            angle = sample.position_rad
            there = abs(angle - self._config.cocked_angle_rad) <= SETTLED_TICKS * TICK_RAD
            still = abs(sample.velocity_rad_s) <= SETTLED_UNITS * VELOCITY_UNIT_RAD_S
            settled = settled + 1 if there and still else 0
            if still and not there and self._servo.tripped():  # this host stood still for 100 ms: on, slowly
                self._servo.guard()
                self._servo.go(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
            if settled >= SETTLED_READS:
                return
            next_ns = self._clock.monotonic_ns() + int(APPROACH_S * 1e9)
            while not self._stop_requested and self._clock.monotonic_ns() < next_ns:
                time.sleep(GLANCE_S)
        raise StrikerFault(
            f"{self._config.port}: the arm does not come to rest at the cocked angle of {self._config.cocked_angle_rad:.3f} rad "
            f"(it is at {angle:.3f}); check that it moves freely, and current_limit_a"
        )

    # --- outcome ----------------------------------------------------------------------------------------------------

    def _outcome(self, contact: Contact | None, samples: list[Sample], released_ns: int, turned_ns: int) -> StrikeOutcome:
        length, mass = self._config.arm_length_m, self._config.effective_mass_kg
        if contact is None:
            return StrikeOutcome(None, 0.0, 0.0, 0.0, None, 0.0, 0, released_ns)
        impulse, impulse_sd = None, 0.0
        if contact.drop is not None:
            impulse = mass * contact.drop * length  # J = (I / r^2) (v - v'), tip speeds
            impulse_sd = math.hypot(self._config.effective_mass_sd_kg * contact.drop, mass * contact.drop_sd) * length
        contacts = count_contacts(samples, contact.time_ns, turned_ns, length)
        speed, speed_sd = contact.velocity * length, contact.velocity_sd * length
        return StrikeOutcome(contact.time_ns, contact.time_sd_ns, speed, speed_sd, impulse, impulse_sd, contacts, released_ns)

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

    # --- states -----------------------------------------------------------------------------------------------------

    def _set(self, state: StrikerState, kind: _Event.Kind | None = None) -> None:
        now_ns = self._clock.monotonic_ns()
        self._status = advance(self._status, state, now_ns)
        if state is StrikerState.DISARMED:
            self._strike_id, strike_id = "", self._strike_id
            if kind is not None:
                self._event_sink(_Event(kind=kind, strike_id=strike_id, host_time_ns=now_ns))
        elif kind is not None:
            self._emit(kind, host_time_ns=now_ns)

    def _guarded(self, action: Callable[[], Any]) -> Any:
        """Carry out; a stop holds the arm where it is, a failure takes the torque off."""
        try:
            return action()
        except _Stopped:
            self._hold()
            raise StrikerStopped from None
        except StrikerRefused:
            raise
        except StrikerError as error:
            self._fault(error)
            raise

    def _hold(self) -> None:
        """End the motion here and now, torque on."""
        self._stop_requested = False
        try:
            time.sleep(DAMPED_S)
            self._servo.hold()
            self._servo.unguard()
        except StrikerError as error:
            self._fault(error)
            return
        finally:
            self._emit(_Event.STOPPED)
        self._status = unhomed(self._clock.monotonic_ns())

    def _stop_is_requested(self) -> bool:
        return self._stop_requested

    def _brake(self) -> None:
        """Bring a moving arm to rest, waiting for as little as can be; `_hold` makes sure of it.

        The last reads tell how fast it is, and the current cap how long full reverse current takes it to rest: so no answer is needed on
        the way, late or lost.
        """
        now_ns = self._clock.monotonic_ns()
        if not self._recent or now_ns - self._recent[-1].time_ns > STALE_NS:
            return
        first, last = self._recent[0], self._recent[-1]
        most = self._servo.full_acceleration_rad_s2
        slope = (last.velocity_rad_s - first.velocity_rad_s) / max(1e-3, (last.time_ns - first.time_ns) * 1e-9)
        age_s = (now_ns - last.time_ns) * 1e-9
        velocity = last.velocity_rad_s + min(most, max(-most, slope)) * (VELOCITY_LAG_S + min(age_s, VELOCITY_LAG_S))
        if abs(velocity) > REST_RAD_S:
            time.sleep(self._servo.push_back(last.position_rad + velocity * age_s, velocity))
        self._servo.damp()

    def _consume_stop(self) -> None:
        """A stop that came while nothing moved: arming is void, the arm stays."""
        if not self._stop_requested:
            return
        self._stop_requested = False
        self._emit(_Event.STOPPED)
        if self._status.armed_ns is not None:
            self._set(StrikerState.DISARMED, _Event.DISARMED)

    def _expire(self) -> None:
        if arming_expired(self._status, self._clock.monotonic_ns(), self._config.arming_expires_s):
            self._set(StrikerState.DISARMED, _Event.DISARMED)

    def _fault(self, error: StrikerError) -> None:
        again = self._status.state is StrikerState.FAULT and str(error) == self._fault_text  # homed in vain
        self._fault_text = str(error)
        self._status = advance(self._status, StrikerState.FAULT, self._clock.monotonic_ns())
        with contextlib.suppress(StrikerError):
            self._servo.torque_off()
        if isinstance(error, StrikerLost):
            self._servo.close()  # only a port opened anew works again after it was unplugged
        if not again:
            self._emit(_Event.FAULT, text=str(error))

    def _watch_idle(self) -> None:
        """Between the verbs: a slow look at servo and clock, and the arming's end."""
        while not self._closing.wait(IDLE_S):
            if not self._verb.acquire(blocking=False):
                continue
            try:
                self._consume_stop()
                self._expire()
                if not self._servo.is_open:
                    self._health = None
                    continue
                self._servo.keep_dead_man()
                if self._status.state is not StrikerState.FAULT:
                    self._publish(self._servo.require_sample())
                if self._health is None or self._clock.monotonic_ns() - self._health.read_ns > HEALTH_NS:
                    self._health = self._servo.health()
            except StrikerError as error:
                if self._status.state is not StrikerState.FAULT:
                    self._fault(error)
                elif isinstance(error, StrikerLost):
                    self._servo.close()
            finally:
                self._verb.release()
