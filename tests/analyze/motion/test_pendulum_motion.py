"""The pendulum's motion and derivatives against an independent integrator, and its linear first guess."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from analyze.motion.pendulum_motion import (
    energy_ratio,
    first_guess,
    first_guess_with_jump,
    trajectory,
)


def test_derivatives_are_those_of_the_motion():
    seconds = np.arange(40) / 120
    x = np.array([0.3, 60.0, 0.02, 1.6])
    _, _, J = trajectory(seconds, *x)
    assert J.shape == (40, len(x))
    for i, step in enumerate([1e-5, 1e-3, 1e-5, 1e-5]):
        up, down = x.copy(), x.copy()
        up[i] += step
        down[i] -= step
        numeric = (trajectory(seconds, *up)[0] - trajectory(seconds, *down)[0]) / (2 * step)
        assert np.allclose(J[:, i], numeric, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("omega0", [1.6, 3.1, 6.0])
def test_the_motion_is_solved_far_below_a_cameras_noise(omega0):
    """Energies below, about and far above that needed to reach balance, up to 80 degrees past it.

    There are 120 frames per second, and k = 100 rad/s^2.
    """
    seconds = np.arange(61) / 120

    def rate(_, y):
        return [y[1], 100.0 * np.sin(y[0]), y[3], 100.0 * np.cos(y[0]) * y[2]]

    exact = solve_ivp(rate, (0.0, 0.5), [-0.3, omega0, 1.0, 0.0], t_eval=seconds, rtol=1e-11, atol=1e-13).y
    below = exact[0] < 1.4
    theta, omega, by = trajectory(seconds, 0.3, 100.0, 0.0, omega0)
    assert np.abs(theta - 0.3 - exact[0])[below].max() < 6e-6
    assert np.abs(omega - exact[1])[below].max() < 6e-5
    assert np.abs(by[:, 2] - exact[2])[below].max() < 2e-6 * np.abs(exact[2]).max()


@pytest.mark.parametrize("omega0", [6.9, 8.5])
def test_on_its_rounding_the_edge_rolls(omega0):
    """The motion obeys the moment equation about a rolling contact; differences confirm its derivatives."""
    seconds, radius, numbers = np.arange(40) / 120, 1e-3, np.array([0.645, 134.7, 0.0, omega0])
    phi, k = numbers[:2]
    e = k * radius / 9.81

    def rate(_, y):
        return [y[1], np.sin(y[0]) * (k + e * y[1] ** 2) / (1 - 2 * e * (1 - np.cos(y[0])))]

    exact = solve_ivp(rate, (0.0, 0.4), [-phi, omega0], t_eval=seconds, rtol=1e-11, atol=1e-13).y
    below = exact[0] < 1.2
    theta, omega, by = trajectory(seconds, *numbers, radius)
    assert np.abs(theta - phi - exact[0])[below].max() < 6e-6
    assert np.abs(omega - exact[1])[below].max() < 6e-5
    for i, step in enumerate((1e-6, 1e-3, 1e-6, 1e-5)):
        moved = step * np.eye(4)[i]
        numeric = (
            trajectory(seconds, *(numbers + moved), radius)[0]
            - trajectory(seconds, *(numbers - moved), radius)[0]
        ) / (2 * step)
        # That the rounding's part grows with k is left out.
        assert (
            np.abs(by[:, i] - numeric)[below].max()
            < (1e-2 if i == 1 else 1e-6) * np.abs(numeric[below]).max()
        )


def test_energy_ratio_is_one_at_the_separatrix():
    phi, k = 0.3, 60.0
    assert energy_ratio(phi, k, 0.0, np.sqrt(2 * k * (1 - np.cos(phi)))) == pytest.approx(1.0)


def test_the_first_guess_is_near_and_finds_a_jump():
    seconds, truth = np.arange(40) / 120, (0.3, 60.0, 0.02, 2.2)
    theta, _, _ = trajectory(seconds, *truth)
    assert first_guess(seconds, theta) == pytest.approx(truth, rel=0.02)
    jumped = theta + np.maximum(seconds - seconds[20], 0.0) * 0.5
    _, frame, guess = first_guess_with_jump(seconds, jumped, range(3, 37))[0]
    assert abs(frame - 20) <= 1
    assert guess[4] == pytest.approx(0.5, abs=0.1)
