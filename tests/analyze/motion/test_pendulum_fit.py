"""Pendulum fit of a rolling body that an independent integrator solves: bias, efficiency, coverage, speed."""

import time
from dataclasses import dataclass

import numpy as np
import pytest

from analyze.errors import EstimationError
from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.pendulum_motion import trajectory
from analyze.types import TipAngle
from tests.analyze.motion.tipping import free_part


def repeat(energy, noise_deg, count, seed=1, **how):
    rng = np.random.default_rng(seed)
    fits = []
    for _ in range(count):
        tip, angle = free_part(energy, noise_deg, rng, **how)
        fits.append(pivot_fit(angle, (0, len(angle.theta))))
    return tip, angle, fits


def cramer_rao(tip, angle, fit, noise_deg):
    seconds = (angle.time_ns - angle.time_ns[0]) * 1e-9
    _, _, J = trajectory(seconds, tip.phi, tip.k, fit.theta0, fit.omega0)
    return np.linalg.inv(J[:, :4].T @ J[:, :4]) * np.radians(noise_deg) ** 2


@pytest.fixture(scope="module")
def reference():
    return repeat(1.05, 0.2, 100)


def test_phi_to_0_06_deg_at_0_2_deg_noise(reference):
    tip, _, fits = reference
    error = np.degrees([fit.phi - tip.phi for fit in fits])
    assert np.std(error) < 0.065
    assert abs(np.mean(error)) < 0.02


def test_k_to_1_percent_over_a_longer_window():
    # 0.7 % (method 3) holds for a window to 80 deg; up to 25 deg past phi the Cramer-Rao bound itself is 1.7
    # %.
    tip, _, fits = repeat(1.05, 0.2, 60, past_deg=60.0)
    assert 100 * np.std([fit.k / tip.k for fit in fits]) < 0.8


@dataclass(frozen=True)
class Draws:
    """Results of many fits to one motion with new noise each time."""

    phi_error: np.ndarray
    k_error: np.ndarray
    phi_sd: np.ndarray
    """(n,) reported sd of phi [rad]"""
    k_sd: np.ndarray
    bound: np.ndarray
    """Cramer-Rao bounds of the sd of (phi, k)"""

    @property
    def phi_inside(self):
        return np.abs(self.phi_error) < 1.96 * self.phi_sd

    @property
    def k_inside(self):
        return np.abs(self.k_error) < 1.96 * self.k_sd


def draws(energy, noise_deg, count, seed):
    tip, _, fits = repeat(energy, noise_deg, count, seed)
    _, clean, (exact,) = repeat(energy, 1e-4, 1)
    sd = np.sqrt([np.diag(fit.covariance) for fit in fits])
    return Draws(
        np.array([fit.phi for fit in fits]) - tip.phi,
        np.array([fit.k for fit in fits]) - tip.k,
        sd[:, 0],
        sd[:, 1],
        np.sqrt(np.diag(cramer_rao(tip, clean, exact, noise_deg))[:2]),
    )


PLAIN = [(0.9, 0.02), (0.95, 0.03), (1.05, 0.2), (1.3, 0.2), (3.0, 0.03)]
"""(E, deg of noise per frame) where phi is known to 0.3 deg or better: there the linearised covariance
serves"""


@pytest.fixture(scope="module")
def plain():
    return [draws(energy, noise_deg, 100, seed) for seed, (energy, noise_deg) in enumerate(PLAIN, 11)]


def test_phi_and_k_scatter_at_most_1_2_times_the_cramer_rao_bound(plain):
    # Measured over 1000 draws: 0.97-1.04. The scatter of 100 draws is known to 7 %: the limit is near three
    # of these away.
    for of_one in plain:
        assert np.std(of_one.phi_error) < 1.2 * of_one.bound[0]
        assert np.std(of_one.k_error) < 1.2 * of_one.bound[1]


def test_95_percent_intervals_hold_the_truth_in_90_to_98_percent(plain):
    # 500 draws: 1 % of chance.
    assert 0.90 < np.mean([of_one.phi_inside for of_one in plain]) < 0.98
    assert 0.90 < np.mean([of_one.k_inside for of_one in plain]) < 0.98


@pytest.mark.parametrize(
    ("energy", "noise_deg"),
    [
        (0.6, 0.02),
        *(pytest.param(*hard, marks=pytest.mark.slow) for hard in ((0.8, 0.1), (0.95, 0.2), (3.0, 0.1))),
        (3.0, 0.2),
    ],
)
def test_the_sd_covers_a_hardly_determined_phi(energy, noise_deg):
    # Bounds of 0.5 to 1.6 deg. Measured over 300 draws: coverage 95-98 %, median sd 1.03-1.32 of the bound.
    of_one = draws(energy, noise_deg, 60, seed=5)
    assert np.mean(of_one.phi_inside) > 0.87
    assert 0.9 < np.median(of_one.phi_sd) / of_one.bound[0] < 1.6


def test_an_uninformative_tip_has_a_large_sd():
    # Cramer-Rao gives 15 deg here: most fits end far from the truth, and none may pass for usable (of 600
    # none did).
    of_one = draws(0.6, 0.2, 30, seed=5)
    assert np.mean(of_one.phi_inside) > 0.84  # 26 of 30: in 984 cases of 1000
    assert np.min(of_one.phi_sd) > np.radians(1.0)


def test_wrong_frames_do_not_pull_the_fit(reference):
    rng = np.random.default_rng(3)
    tip, angle = free_part(1.05, 0.05, rng)
    theta = angle.theta.copy()
    theta[[9, 30, 31, 50]] += np.radians([4.0, -3.0, 5.0, -6.0])
    spoilt = TipAngle(angle.time_ns, theta, angle.sd, angle.off_axis, angle.slip)
    fit = pivot_fit(spoilt, (0, len(theta)))
    assert abs(np.degrees(fit.phi - tip.phi)) < 4 * 0.03


def test_a_fit_takes_less_than_30_ms(reference):
    _, angle, _ = reference
    start = time.thread_time()
    for _ in range(5):
        pivot_fit(angle, (0, len(angle.theta)))
    assert (time.thread_time() - start) / 5 < 0.03


def test_missing_frames_do_not_bias_the_fit():
    tip, angle = free_part(1.05, 0.02, np.random.default_rng(5))
    kept = np.ones(len(angle.theta), dtype=bool)
    kept[20:27] = False
    part = TipAngle(
        angle.time_ns[kept], angle.theta[kept], angle.sd[kept], angle.off_axis[kept], angle.slip[kept]
    )
    assert abs(np.degrees(pivot_fit(part, (0, len(part.theta))).phi - tip.phi)) < 0.03


def test_rocking_back_still_gives_phi_with_an_honest_sd():
    tip, _, fits = repeat(0.9, 0.02, 40)
    z = [(fit.phi - tip.phi) / np.sqrt(fit.covariance[0, 0]) for fit in fits]
    assert np.std([fit.phi for fit in fits]) < np.radians(0.2)
    assert np.mean(np.abs(z)) < 1.5


def test_too_few_frames_are_refused():
    _, angle = free_part(1.05, 0.02, np.random.default_rng(5))
    with pytest.raises(EstimationError, match="only 5 frames"):
        pivot_fit(angle, (0, 5))
