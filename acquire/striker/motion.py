"""Supervised motion of the striker's arm: reads samples while it moves, brakes it on request."""

from __future__ import annotations

import math
import time
from collections import deque
from typing import TYPE_CHECKING

from acquire.errors import StrikerFault, StrikerLost
from acquire.striker.sample import TICK_RAD, TICK_WRAP, VELOCITY_UNIT_RAD_S, Sample
from acquire.striker.servo import Servo

if TYPE_CHECKING:
    from collections.abc import Callable

    from acquire.striker.bus import MonotonicClock
    from schemas.rig import StrikerConfig

SLOW_RAD_S, SLOW_RAD_S2 = 0.8, 8.0
"""velocity [rad/s] and acceleration [rad/s2] of a slow motion"""
SLOW_READ_PERIOD_S = 0.01
"""interval between reads while the arm moves slowly or settles [s]"""
SWING_READ_PERIOD_NS = 1_000_000
"""interval between reads of a swing [ns]"""
DITHER_NS = 600_000
"""range over which the reads of a swing are shifted within their period [ns]: the servo renews its registers
at 1 kHz too, and in step with it every read could fall on a renewal, so that its value would be ambiguous"""
GOLDEN_RATIO_FRACTION = 0.6180339887498949
"""increment of the shift, as a fraction of its range: spreads any number of reads evenly"""
SETTLED_TICKS = 4.5
SETTLED_UNITS = 1.5
SETTLED_READS = 20
"""number of consecutive reads, all near the goal and at rest, after which the arm is settled: within
SETTLED_TICKS of the goal and SETTLED_UNITS of rest, in units of the position and velocity registers"""
MAX_SILENCE_NS = 200_000_000
"""longest time without an answer in a swing [ns]: by then the servo's own watchdog (60 ms) has stopped it,
if this host paused"""
MAX_UNWATCHED_NS = 1_000_000_000
"""time between two samples from which on they say nothing about a restart [ns]"""
MAX_TICK_JUMP_MS = 300
"""difference between the passing of the servo's time and the host's above which the servo has restarted [ms]:
answers may be late by MAX_SILENCE_NS"""
MAX_SAMPLE_AGE_NS = 80_000_000
"""age above which a sample is useless for the arm's velocity [ns]"""
VELOCITY_LAG_S = 0.003
"""age of the velocity register's value [s], within a millisecond or two (see velocity_register.py)"""
REST_RAD_S = 0.3
"""velocity below which no brake is needed [rad/s]"""
POLL_S = 0.002
"""interval at which pauses check for a stop [s]"""


class MotionStopped(Exception):
    """Exception: a stop was requested while the arm moved; the arm has been braked."""


class ArmMotion:
    """Reading and braking of the striker's arm while it moves.

    Args:
        config: section `striker` of the rig file.
        servo: the arm's servo.
        clock: host monotonic time.
        stop_requested: returns True once somebody has requested a stop.
        publish: called with every sample of a slow motion.
    """

    def __init__(
        self,
        config: StrikerConfig,
        servo: Servo,
        clock: MonotonicClock,
        stop_requested: Callable[[], bool],
        publish: Callable[[Sample], None],
    ) -> None:
        self._config, self._servo, self._clock = config, servo, clock
        self._stop_requested, self._publish = stop_requested, publish
        self._recent: deque[Sample] = deque(maxlen=3)

    def swing(
        self, samples: list[Sample], is_last: Callable[[Sample], bool], is_overdue: Callable[[int], bool]
    ) -> bool:
        """Read samples at 1 kHz during a swing until `is_last` is true, and append them to `samples`.

        Args:
            samples: list to which the samples are appended.
            is_last: called with every sample; True ends the reading.
            is_overdue: called with the host monotonic time [ns] of the servo's last answer; True once the
                time limit has passed.

        Returns:
            True once `is_last` was true; False if `is_overdue` was true before.

        Raises:
            MotionStopped: a stop was requested.
            StrikerLost: the servo no longer answers.
            StrikerFault: the servo reports a hardware error, or has restarted.
        """
        answered_ns = next_ns = self._clock.monotonic_ns()
        spread = 0.0
        while not is_overdue(answered_ns):
            self._brake_if_stopped()
            sample = self._servo.sample(self._stop_requested)
            now_ns = self._clock.monotonic_ns()
            if sample is not None:
                answered_ns = now_ns
                samples.append(sample)
                self._note(sample)
                if is_last(sample):
                    return True
            elif now_ns - answered_ns > MAX_SILENCE_NS:
                raise StrikerLost(
                    f"{self._config.port}: the servo stopped answering during the swing; its watchdog "
                    "stops the arm; check power and cable"
                )
            next_ns = max(next_ns + SWING_READ_PERIOD_NS, now_ns)  # time lost on a slow bus is not caught up
            spread = (spread + GOLDEN_RATIO_FRACTION) % 1.0
            time.sleep(max(0, next_ns + int(spread * DITHER_NS) - now_ns) * 1e-9)
        return False

    def forget(self) -> None:
        """Drop the samples kept for a brake: the servo was restarted, or the arm has not been watched."""
        self._recent.clear()

    def _note(self, sample: Sample) -> None:
        """Keep a sample for a brake.

        Raises:
            StrikerFault: the servo has restarted: its clock has jumped, and its torque is off.
        """
        last = self._recent[-1] if self._recent else sample
        if sample.time_ns - last.time_ns < MAX_UNWATCHED_NS:
            expected = last.tick_ms + (sample.time_ns - last.time_ns) // 1_000_000
            jump_ms = (sample.tick_ms - expected + TICK_WRAP // 2) % TICK_WRAP - TICK_WRAP // 2
            if abs(jump_ms) > MAX_TICK_JUMP_MS and not self._servo.has_torque():
                self.forget()
                raise StrikerFault(
                    f"{self._config.port}: the servo restarted while the arm moved, so its supply voltage "
                    "dropped: use a supply of 3 A or more and short, thick cables"
                )
        self._recent.append(sample)

    def settle(self, timeout_s: float) -> None:
        """Wait until the arm rests at the cocked (raised) angle, reading and publishing samples.

        Args:
            timeout_s: longest wait [s].

        Raises:
            MotionStopped: a stop was requested.
            StrikerFault: the arm does not come to rest there in time, the servo reports a hardware error, or
                it has restarted.
            StrikerLost: the servo does not answer.
        """
        end_ns = self._clock.monotonic_ns() + int(timeout_s * 1e9)
        settled = 0
        angle = math.nan
        while self._clock.monotonic_ns() < end_ns:
            self._brake_if_stopped()
            sample = self._servo.sample(self._stop_requested)
            if sample is None:
                if self._stop_requested():
                    continue
                sample = self._servo.require_sample()
            self._note(sample)
            self._publish(sample)
            angle = sample.position_rad
            settled = settled + 1 if self._at_rest(sample) else 0
            if settled >= SETTLED_READS:
                return
            next_ns = self._clock.monotonic_ns() + int(SLOW_READ_PERIOD_S * 1e9)
            while not self._stop_requested() and self._clock.monotonic_ns() < next_ns:
                time.sleep(POLL_S)
        raise StrikerFault(
            f"{self._config.port}: the arm does not come to rest at the cocked angle of "
            f"{self._config.cocked_angle_rad:.3f} rad (it is at {angle:.3f}); check that it moves freely, "
            "and current_limit_a"
        )

    def _at_rest(self, sample: Sample) -> bool:
        """True if the arm stands still at the cocked (raised) angle in the given sample, else False.

        The servo's bus watchdog stops the motor after silence on the bus. If the arm stands still elsewhere
        because of that, it is ordered to move on slowly to the cocked angle.
        """
        there = abs(sample.position_rad - self._config.cocked_angle_rad) <= SETTLED_TICKS * TICK_RAD
        still = abs(sample.velocity_rad_s) <= SETTLED_UNITS * VELOCITY_UNIT_RAD_S
        if still and not there and self._servo.watchdog_tripped():  # this host paused for 60 ms
            self._servo.start_watchdog()
            self._servo.move_to(self._config.cocked_angle_rad, SLOW_RAD_S, SLOW_RAD_S2)
        return there and still

    def _brake_if_stopped(self) -> None:
        if self._stop_requested():
            self.brake()
            raise MotionStopped

    def brake(self) -> None:
        """Bring a moving arm to rest with as little waiting as possible; its position is not held yet.

        The last samples give the arm's velocity, and the current limit gives the time in which full reverse
        current stops it. So the brake waits for no answer, which could be late or lost. A slow arm is ordered
        to stay: with damping alone the servo would go on accelerating along its profile. Without a sample of
        the last 80 ms the arm counts as standing.
        """
        now_ns = self._clock.monotonic_ns()
        if self._recent and now_ns - self._recent[-1].time_ns <= MAX_SAMPLE_AGE_NS:
            angle, velocity = self._predicted(now_ns)
            if abs(velocity) > REST_RAD_S:
                time.sleep(self._servo.brake(angle, velocity))
            else:
                self._servo.stay(angle)
        self._servo.damp()

    def _predicted(self, now_ns: int) -> tuple[float, float]:
        """Arm's angle [rad] and velocity [rad/s] now, extrapolated from the samples kept for a brake."""
        first, last = self._recent[0], self._recent[-1]
        limit = self._config.full_acceleration_rad_s2
        slope = (last.velocity_rad_s - first.velocity_rad_s) / max(
            1e-3, (last.time_ns - first.time_ns) * 1e-9
        )
        age_s = (now_ns - last.time_ns) * 1e-9
        velocity = last.velocity_rad_s + min(limit, max(-limit, slope)) * (
            VELOCITY_LAG_S + min(age_s, VELOCITY_LAG_S)
        )
        return last.position_rad + velocity * age_s, velocity
