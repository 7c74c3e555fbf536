"""Calibration of a striker from simulated swings, compared with the parameters that made them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from acquire.striker.calibration import MeasuredSwing, StrikerParameters, estimate_striker, swing_ratio

PRIOR = StrikerParameters(0.17, 0.05, 0.4, 0.15)
SPEEDS = (0.1, 0.2, 0.3, 0.4)


def swings(body_kg: float, mass: float, restitution: float, rng: np.random.Generator) -> list[MeasuredSwing]:
    share = (1 + restitution) / (1 + mass / body_kg)
    return [
        MeasuredSwing(v, v, 0.003 * v, v * share * (1 + rng.normal(0, 0.1)), 0.1 * v * share, body_kg)
        for v in SPEEDS
        for _ in range(3)
    ]


def test_swings_in_the_air_determine_only_the_swing_ratio():
    rng = np.random.default_rng(1)
    air = [
        MeasuredSwing(v, 0.97 * v * (1 + rng.normal(0, 0.005)), 0.003 * v) for v in SPEEDS for _ in range(3)
    ]
    ratio = swing_ratio(air)
    assert ratio.mean == pytest.approx(0.97, abs=3 * ratio.mean_sd)
    assert ratio.scatter == pytest.approx(0.005, rel=0.5)
    assert 0.0005 < ratio.mean_sd < 0.003
    assert estimate_striker(PRIOR, air) is PRIOR


@pytest.mark.parametrize("heavy_kg", [1.5, math.inf])
@pytest.mark.parametrize(("mass", "restitution"), [(0.13, 0.55), (0.21, 0.3), (0.17, 0.4)])
def test_light_and_heavy_body_determine_mass_and_restitution(mass, restitution, heavy_kg):
    rng = np.random.default_rng(2)
    learned = estimate_striker(
        PRIOR, swings(0.03, mass, restitution, rng) + swings(heavy_kg, mass, restitution, rng)
    )
    assert learned.effective_mass_sd_kg < 0.4 * PRIOR.effective_mass_sd_kg
    assert learned.restitution_sd < 0.6 * PRIOR.restitution_sd
    assert abs(learned.effective_mass_kg - mass) < 2.5 * learned.effective_mass_sd_kg
    assert abs(learned.restitution - restitution) < 2.5 * learned.restitution_sd


def test_one_body_determines_only_a_combination():
    rng = np.random.default_rng(3)
    learned = estimate_striker(PRIOR, swings(0.03, 0.25, 0.6, rng))
    combined = (1 + learned.restitution) / learned.effective_mass_kg
    assert combined == pytest.approx(1.6 / 0.25, rel=0.15)
    assert learned.restitution_sd > 0.8 * PRIOR.restitution_sd


def test_swing_without_significant_loss_leaves_the_prior():
    assert estimate_striker(PRIOR, [MeasuredSwing(0.2, 0.2, 0.001, None, 0.0, 0.03)]) is PRIOR


def test_intervals_contain_the_true_parameters():
    rng = np.random.default_rng(4)
    inside = 0
    for _ in range(60):
        mass, restitution = 0.17 * math.exp(rng.normal(0, 0.29)), 0.4 + rng.normal(0, 0.12)
        shared = 1 + rng.normal(0, 0.05)
        made = swings(0.03, mass, restitution, rng) + swings(1.0, mass, restitution, rng)
        made = [
            MeasuredSwing(
                s.command_m_s,
                s.speed_m_s,
                s.speed_sd_m_s,
                shared * (s.drop_m_s or 0),
                s.drop_sd_m_s,
                s.body_kg,
            )
            for s in made
        ]
        learned = estimate_striker(PRIOR, made)
        inside += abs(learned.effective_mass_kg - mass) < 2 * learned.effective_mass_sd_kg
        inside += abs(learned.restitution - restitution) < 2 * learned.restitution_sd
    assert 105 <= inside <= 120
