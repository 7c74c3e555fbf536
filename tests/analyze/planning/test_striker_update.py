"""Update of the striker's effective mass and restitution by strikes made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.planning.impact import StrikerModel
from analyze.planning.striker_update import Touch, updated_striker

BELIEVED = StrikerModel(effective_mass_sd_kg=0.05)
AXES = {"a": (3.0e-4, 0.45, 60.0, 0.09), "b": (5.5e-4, 0.30, 45.0, 0.13), "c": (2.2e-4, 0.70, 75.0, 0.06)}
"""I_edge [kg m^2], phi [rad], k [1/s^2], height [m]"""


def energy(mass: float, restitution: float, speed: float, axis: str) -> float:
    """Energy ratio E of a strike, from the impulse of two colliding bodies; independent of the planner."""
    moment, phi, k, height = AXES[axis]
    effective_mass = 1 / (1 / mass + height**2 / moment)
    omega = (1 + restitution) * effective_mass * speed * height / moment
    return omega**2 / (2 * k * (1 - np.cos(phi)))


def touches(
    mass: float, restitution: float, rng: np.random.Generator, axes: str = "abc", each: int = 2
) -> list[Touch]:
    """Simulated strikes with the scatter of the virtual rig."""
    found = []
    for axis in axes:
        left_out = rng.normal(0, 0.04)
        for _ in range(each):
            speed = rng.uniform(0.3, 0.6)
            seen = energy(mass, restitution, speed, axis) * np.exp(2 * left_out + rng.normal(0, 0.03))
            moment, phi, k, height = AXES[axis]
            found.append(Touch(axis, speed * np.exp(rng.normal(0, 0.012)), height, moment, phi, k, seen))
    return found


def predicted_energy(striker: StrikerModel, axis: str) -> float:
    return energy(striker.effective_mass_kg, striker.restitution, 0.4, axis)


def test_update_improves_the_predicted_energy():
    rng = np.random.default_rng(4)
    before, after = [], []
    for _ in range(40):
        mass, bounce = rng.normal(0.2, 0.05), np.clip(rng.normal(0.4, 0.15), 0.0, 1.0)
        true = energy(mass, bounce, 0.4, "c")
        before.append(np.log(predicted_energy(BELIEVED, "c") / true))
        after.append(
            np.log(
                predicted_energy(updated_striker(BELIEVED, touches(mass, bounce, rng, "ab", 3)), "c") / true
            )
        )
    assert np.sqrt(np.mean(np.square(after))) < 0.1 < 0.5 * np.sqrt(np.mean(np.square(before)))


def test_stated_standard_deviations_are_correct():
    rng = np.random.default_rng(5)
    off = []
    for _ in range(60):
        mass, bounce = rng.normal(0.2, 0.05), np.clip(rng.normal(0.4, 0.15), 0.0, 1.0)
        found = updated_striker(BELIEVED, touches(mass, bounce, rng))
        assert found.restitution_sd < 0.5 * BELIEVED.restitution_sd
        off.append(
            [
                (found.effective_mass_kg - mass) / found.effective_mass_sd_kg,
                (found.restitution - bounce) / found.restitution_sd,
            ]
        )
    # 60 draws each: the root mean square of unit normals lies in 0.73 to 1.27 with three standard deviations.
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < 1.27).all()


def test_double_contact_of_the_arm_has_little_effect():
    rng = np.random.default_rng(6)
    clean = touches(0.17, 0.4, rng, each=3)
    spoilt = [replace(clean[0], energy_ratio=1.5 * clean[0].energy_ratio), *clean[1:]]
    assert predicted_energy(updated_striker(BELIEVED, spoilt), "a") == pytest.approx(
        predicted_energy(updated_striker(BELIEVED, clean), "a"), rel=0.03
    )


def test_no_strikes_leave_the_striker_unchanged_and_limits_are_kept():
    assert updated_striker(BELIEVED, []) is BELIEVED
    found = updated_striker(BELIEVED, touches(0.25, 0.6, np.random.default_rng(7)))
    assert (found.slowest_m_s, found.highest_m) == (BELIEVED.slowest_m_s, BELIEVED.highest_m)


def test_calibrated_striker_hardly_changes():
    sure = replace(BELIEVED, effective_mass_sd_kg=0.001, restitution_sd=0.005)
    found = updated_striker(sure, touches(0.25, 0.6, np.random.default_rng(8)))
    assert abs(found.restitution - 0.4) < 0.02
    assert abs(found.effective_mass_kg - 0.2) < 0.003
