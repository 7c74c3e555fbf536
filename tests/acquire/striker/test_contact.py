"""Fit of the contact to simulated swings: run-up, constant speed, contact, retraction.

Filter, renewal, rounding and read times are like those of a servo on a bus.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline
from scipy.signal import lfilter

from acquire.striker.contact import fit_contact
from acquire.striker.detector import ContactDetector, count_contacts
from acquire.striker.motion import DITHER_NS, GOLDEN_RATIO_FRACTION
from acquire.striker.sample import TICK_RAD, VELOCITY_UNIT_RAD_S, Sample
from acquire.striker.velocity_register import (
    KNOT_SPACING_S,
    RESPONSE_STEP_S,
    cubic_splines,
    estimate_register,
    low_pass,
)

LENGTH = 0.12
RESTITUTION = 0.4
LAG_S = 3e-4
START_NS = 5_000_000_000


def first_order(signal: np.ndarray, step: float, tau: float) -> np.ndarray:
    shown = np.empty_like(signal)
    state = 0.0
    for k, value in enumerate(signal):
        state += (value - state) * step / tau
        shown[k] = state
    return shown


def swing(
    seed: int, velocity: float, drop: float, angle: float, after_s: float, filter_s: float = 0.003
) -> tuple[list[Sample], int, int]:
    """Samples at 1 kHz of run-up, contact at `angle` [rad], and retraction `after_s` [s] later.

    Returns:
        The samples, time of the contact [ns] and time of the retraction [ns].
    """
    rng = np.random.default_rng(seed)
    t_contact, duration, step = 0.2 + rng.uniform(0, 1e-3), rng.normal(0.003, 0.0003), 2e-5
    recovery_per_s = rng.normal(120, 20)
    turned = t_contact + after_s
    t = np.arange(0.0, turned + 0.06, step)
    taken = drop * (1 - np.clip(1 - (t - t_contact) / duration, 0, 1) ** 2.0)
    lost = taken - first_order(taken, step, 1 / recovery_per_s)
    start = np.clip(t - 0.05, 0, None)
    true_velocity = velocity * (1 - np.exp(-start / 0.007) * (1 + start / 0.007)) - lost
    back = t - turned - 0.0005
    true_velocity -= first_order(
        500 * np.clip(back, 0, 0.014) - 300 * np.clip(back - 0.035, 0, 0.02), step, 0.001
    )
    position = np.cumsum(true_velocity) * step
    position += angle - np.interp(t_contact, t, position)
    shown = first_order(true_velocity, step, filter_s)
    phase = rng.uniform(0, 1e-3)
    samples = []
    periods = np.arange(0.02, t[-1] - 2e-3, 1.013e-3)
    spread = (GOLDEN_RATIO_FRACTION * np.arange(len(periods))) % 1.0 * DITHER_NS * 1e-9
    for tk in periods + spread + rng.normal(0, 5e-5, len(periods)):
        width = rng.uniform(1e-4, 4e-4)
        renewed = np.floor((tk - phase) * 1e3) * 1e-3 + phase
        shown_k = (
            round(float(np.interp(renewed - LAG_S, t, shown)) / VELOCITY_UNIT_RAD_S) * VELOCITY_UNIT_RAD_S
        )
        position_k = round(float(np.interp(tk, t, position)) / TICK_RAD + rng.normal(0, 0.15)) * TICK_RAD
        middle_ns = START_NS + int(
            (tk + width * rng.uniform(-0.05, 0.35)) * 1e9
        )  # the answer is longer than the request
        half_ns = int(width * 0.5e9)
        samples.append(
            Sample(middle_ns - half_ns, middle_ns + half_ns, int(tk * 1e3), position_k, shown_k, 0.0)
        )
    return samples, START_NS + int(t_contact * 1e9), START_NS + int(turned * 1e9)


@pytest.mark.parametrize("filter_s", [0.0015, pytest.param(0.0025, marks=pytest.mark.slow), 0.004])
def test_first_contact_within_0_3_ms_and_sd_fits_the_errors(
    filter_s: float,
) -> None:
    errors, sds, drops = [], [], []
    for seed in range(16):
        angle = np.random.default_rng(seed + 100).normal(0, 0.001 / LENGTH)
        samples, truth_ns, turned_ns = swing(seed, 2.7, 0.55, angle, 0.006, filter_s)
        contact = fit_contact(samples, turned_ns, LENGTH, RESTITUTION)
        assert contact is not None
        assert contact.velocity == pytest.approx(2.7, rel=0.01)
        assert contact.drop is not None
        errors.append(contact.time_ns - truth_ns)
        sds.append(contact.time_sd_ns)
        drops.append((contact.drop - 0.55) / contact.drop_sd)
    assert np.sqrt(np.mean(np.square(errors))) < 0.3e6
    assert np.mean(sds) < 0.3e6
    assert 0.5 < np.sqrt(np.mean(np.square(np.array(errors) / np.array(sds)))) < 1.6
    assert np.sqrt(np.mean(np.square(drops))) < 2.0


def test_register_model_is_estimated_from_run_up_and_retraction() -> None:
    for filter_s in (0.001, 0.0025, 0.004):
        samples, _, turned_ns = swing(3, 2.7, 0.55, 0.0, 0.006, filter_s)
        models = estimate_register(samples, turned_ns)
        delay = sum(m.weight * (m.tau + m.lag - (0.0005 if m.phase_ns is None else 0.0)) for m in models)
        assert delay == pytest.approx(filter_s + LAG_S, abs=0.0003)


def test_undetermined_register_model_widens_the_contact_time() -> None:
    samples, truth_ns, turned_ns = swing(1, 2.7, 0.55, 0.0, 0.006)
    known = fit_contact(samples, turned_ns, LENGTH, RESTITUTION)
    even = [s for s in samples if truth_ns - 60_000_000 < s.time_ns <= turned_ns]
    unknown = fit_contact(even, turned_ns, LENGTH, RESTITUTION)
    assert known is not None
    assert unknown is not None
    assert unknown.time_sd_ns > 1.3 * known.time_sd_ns
    assert abs(unknown.time_ns - truth_ns) < 3 * unknown.time_sd_ns


def test_insignificant_drop_falls_back_on_the_time_at_angle_0() -> None:
    samples, _, turned_ns = swing(1, 2.7, 0.0, 0.0, 0.006)
    contact = fit_contact(samples, turned_ns, LENGTH, RESTITUTION)
    assert contact is not None
    assert contact.drop is None
    assert contact.time_sd_ns == pytest.approx(0.001 / LENGTH / 2.7 * 1e9, rel=0.1)


def test_arm_that_did_not_reach_angle_0_has_no_contact() -> None:
    samples, _, _ = swing(1, 2.7, 0.0, 0.0, 0.0)
    early = [s for s in samples if s.position_rad < -0.05][:100]
    assert fit_contact(early, early[-1].time_ns + 1, LENGTH, RESTITUTION) is None
    assert fit_contact([], 0, LENGTH, RESTITUTION) is None


def test_early_contact_with_an_object_15_mm_too_near_is_detected() -> None:
    samples, truth_ns, _ = swing(4, 2.7, 0.6, -0.015 / LENGTH, 0.006)
    detector = ContactDetector(LENGTH, 2.7)
    turned = next(s for s in samples if detector.must_turn_back(s))
    contact = fit_contact(samples, turned.time_ns + 1, LENGTH, RESTITUTION)
    assert contact is not None
    assert abs(contact.time_ns - truth_ns) < 3e6
    assert contact.drop is not None


def test_contact_time_is_interpolated_after_a_host_pause() -> None:
    samples, truth_ns, _ = swing(1, 2.7, 0.5, 0.0, 0.006)
    first = next(k for k, s in enumerate(samples) if s.time_ns > truth_ns - 40_000_000)
    after = next(s for s in samples if s.time_ns > truth_ns + 4_000_000)
    sparse = [samples[first - 50], samples[first], after]
    contact = fit_contact(sparse, after.time_ns + 1, LENGTH, RESTITUTION)
    assert contact is not None
    assert abs(contact.time_ns - truth_ns) < 2 * contact.time_sd_ns
    assert contact.time_sd_ns > 5e6


def test_detector_turns_back_within_7_ms_of_a_drop_and_not_before() -> None:
    for seed in range(20):
        samples, truth_ns, _ = swing(seed, 2.7, 0.6, -0.004, 0.02)
        detector = ContactDetector(LENGTH, 2.7)
        turned = next(s for s in samples if detector.must_turn_back(s))
        assert 0 < turned.time_ns - truth_ns < 7e6


def test_arm_that_lingers_or_returns_counts_two_contacts() -> None:
    def sample(ms: int, position: float, velocity: float) -> Sample:
        return Sample(ms * 1_000_000, ms * 1_000_000, ms, position, velocity, 0.0)

    turned = [sample(8, 0.012, -1.0), sample(20, -0.05, -3.0), sample(40, -0.2, -1.0)]
    assert count_contacts(turned, 0, 5_000_000, LENGTH) == 1
    assert (
        count_contacts(turned[-1:], 0, 5_000_000, LENGTH) == 1
    )  # reads are missing, but the arm was turned in time
    assert count_contacts(turned, 0, 35_000_000, LENGTH) == 2  # turned too late
    assert count_contacts([*turned, sample(90, -0.001, 0.5)], 0, 5_000_000, LENGTH) == 2
    assert count_contacts([sample(ms, 0.01, 0.4) for ms in range(1, 60)], 0, 5_000_000, LENGTH) == 2


@pytest.mark.parametrize("tau", [5e-4, 6e-3])
def test_low_pass_equals_scipy(tau: float) -> None:
    signal = np.random.default_rng(1).normal(size=(1234, 3))
    gain = 1 - np.exp(-RESPONSE_STEP_S / tau)
    theirs = lfilter([gain], [1, gain - 1], signal, axis=0, zi=(1 - gain) * signal[:1])[0]
    assert np.allclose(low_pass(signal, tau), theirs, rtol=0, atol=1e-12)


def test_splines_equal_scipy() -> None:
    time, count = np.linspace(0.0, 0.1, 777), 39
    spline = BSpline(KNOT_SPACING_S * np.arange(-5, count - 1), np.eye(count), 3)
    value, slope = cubic_splines(time, -2 * KNOT_SPACING_S, count)
    assert np.allclose(value, spline(time), rtol=0, atol=1e-12)
    assert np.allclose(slope, spline.derivative()(time), rtol=0, atol=1e-9)
