import numpy as np
import pytest
from scipy.integrate import solve_ivp

from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.predicted_motion import PredictedValues, predicted_motion
from analyze.types import TipAngle

PHI, K = np.radians(25.0), 75.0
NOISE = np.radians(0.05)
OTHERS = np.diag([np.radians(0.1) ** 2, 0.01**2])
FRAME_S = 1 / 120
FAR = 12.7
"""chi squared of two quantities that is as improbable as 3 sd of one"""


def seen(rng, energy=1.1, phi=PHI, k=K, speed_jump=0.0):
    """Simulated theta(t) until 25 degrees past phi, by another integrator.

    `speed_jump` [rad/s] is added after 0.2 s.
    """

    def rate(_, y):
        return [y[1], -k * np.sin(phi - y[0])]

    start = [0.02, np.sqrt(2 * k * (energy * (1 - np.cos(phi)) + np.cos(phi) - np.cos(0.02 - phi)))]
    time = np.arange(70) * FRAME_S
    first = _solved(rate, start, time[:24])
    second = _solved(rate, [first[0, -1], first[1, -1] + speed_jump], time[: len(time) - 23])
    theta = np.concatenate([first[0], second[0, 1:]])
    over = np.flatnonzero(theta > phi + np.radians(25))
    theta = theta[: over[0] if len(over) else 60]
    n = len(theta)
    angle = TipAngle(
        (1e9 * (5 + FRAME_S * np.arange(n))).astype(np.int64),
        theta + NOISE * rng.standard_normal(n),
        np.full(n, NOISE),
        *np.zeros((2, n)),
    )
    return angle, pivot_fit(angle, (0, n))


def _solved(rate, start, time):
    return solve_ivp(rate, (0, time[-1]), start, "DOP853", t_eval=time, rtol=1e-8, atol=1e-10).y


def own_of(fit):
    by = np.diag([1.0, 1.0 / fit.k])
    return by @ fit.covariance @ by.T


def predicted(fit, phi=PHI, k=K, covariance=OTHERS):
    return PredictedValues(phi, k, covariance, own_of(fit))


def test_the_true_phi_and_k_predict_theta_to_its_noise_and_the_error_of_the_start():
    # Over 40 strikes.
    rng = np.random.default_rng(1)
    outside, squared, last = [], [], []
    for _ in range(40):
        angle, fit = seen(rng, energy=rng.uniform(1.05, 1.3))
        sure = np.linalg.cholesky(OTHERS) @ rng.standard_normal(2)
        motion = predicted_motion("s", angle, fit, predicted(fit, PHI + sure[0], K * np.exp(sure[1])))
        outside.append(motion.outside)
        squared.append(motion.chi2)
        last.append(motion.offset[-1] / motion.sd[-1])
    assert np.mean(outside) == pytest.approx(0.05, abs=0.03)
    assert np.mean(squared) == pytest.approx(2.0, abs=0.5)
    assert np.mean(np.array(squared) > FAR) < 0.02
    assert np.sqrt(np.mean(np.square(last))) == pytest.approx(1.0, abs=0.2)


def test_the_start_comes_from_the_first_tenth_of_a_second_alone():
    angle, fit = seen(np.random.default_rng(2))
    motion = predicted_motion("s", angle, fit, predicted(fit))
    assert motion.start == 12
    assert np.sqrt(np.mean(np.square(motion.offset[:12]))) < 1.5 * NOISE
    # Later frames do not bend it.
    bent = TipAngle(
        angle.time_ns,
        angle.theta + np.where(np.arange(len(angle.theta)) < 12, 0.0, 0.05),
        angle.sd,
        angle.off_axis,
        angle.slip,
    )
    again = predicted_motion("s", bent, pivot_fit(bent, fit.window), predicted(fit))
    assert again.offset[12:20] == pytest.approx(motion.offset[12:20] + 0.05, abs=2e-3)


@pytest.mark.parametrize(("phi", "k"), [(np.radians(1.0), 0.0), (0.0, 0.15)])
def test_a_wrong_phi_or_k_is_reported(phi, k):
    angle, fit = seen(np.random.default_rng(3), phi=PHI + phi, k=K * (1 + k))
    motion = predicted_motion("s", angle, fit, predicted(fit))
    worst = motion.worst
    assert motion.chi2 > 40
    assert abs(motion.offset[worst]) > 3 * motion.sd[worst]
    # Where it balances later it falls later, and stays behind; the same where it falls more slowly before.
    assert np.sign(motion.offset[worst]) == -1


def test_a_second_impact_shows_even_where_phi_and_k_are_as_predicted():
    angle, fit = seen(np.random.default_rng(6), speed_jump=0.4)
    motion = predicted_motion("s", angle, fit, predicted(fit))
    # Its own fit absorbs most of the impact, and leaves the frames noisier for it: no frame alone is far off
    # its band, all together are.
    assert motion.chi2 > FAR
    assert np.degrees(motion.offset[-1]) > 2, "it falls before its time"


def test_the_prediction_ends_where_its_sd_is_too_large():
    angle, fit = seen(np.random.default_rng(4), energy=1.002)
    motion = predicted_motion("s", angle, fit, predicted(fit, covariance=100 * OTHERS))
    assert motion.time[-1] < motion.seconds
    assert np.degrees(motion.sd[-1]) < 4
