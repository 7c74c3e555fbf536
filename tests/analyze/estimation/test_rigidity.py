"""Strikes of rigid bodies, and of bodies with contents that move, through the tests of rigidity."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.joint import solve_joint
from analyze.estimation.joint_model import COM
from analyze.estimation.priors import ComPrior, SystematicErrors
from analyze.estimation.rigidity import Answer, Rigidity, check_rigidity
from analyze.types import EquiPlane
from tests.analyze.estimation.bodies import Body, fit_of, planned_strike, tip
from tests.analyze.simulated_session import carton

UPRIGHT, UPSIDE_DOWN = [(2, -1, 1, 1), (2, -1, 0, 1)], [(2, 1, 1, 1), (2, 1, 0, -1)]
ENERGIES = (1.06, 1.25, 1.6)
ERRORS = SystematicErrors(gravity_tilt_sd=1e-3, edge_radius_sd=1e-4, face_sd=5e-5)
SD_PHI, SD_K = 4e-4, 4e-3


def strikes(
    rng: np.random.Generator,
    rise: float = 0.0,
    scatter: float = 0.0,
    lower: float = 0.0,
    edges: list[tuple[int, int, int, int]] | None = None,
    energies: tuple[float, ...] = ENERGIES,
) -> tuple[list[EquiPlane], list[float], Body]:
    """Planes of a carton struck on some edges at several energies, the energies, and the carton.

    Args:
        rng: generator of the noise.
        rise: rise of phi with the logarithm of the energy [rad].
        scatter: 1 sigma of the pose at rest from strike to strike [rad].
        lower: distance by which c lies nearer to the face rested on than in a rigid carton [m].
        edges: arguments of `planned_strike`; None for two upright and two upside down.
        energies: energy ratios on each edge.
    """
    body, found, ratios = carton(), [], []
    for edge in UPRIGHT + UPSIDE_DOWN if edges is None else edges:
        for number, energy in enumerate(energies):
            planned = planned_strike(body, *edge, number)
            up = np.array(planned.R_world_object)[2]
            # Moving the edge up by as much lowers c against it.
            phi, k = tip(body, planned, lower * up)
            phi += rise * math.log(energy) + rng.normal(0, math.hypot(SD_PHI, scatter))
            fit = fit_of(phi, k * (1 + rng.normal(0, SD_K)), SD_PHI, SD_K * k)
            plane = equiplane_from_fit(f"{planned.id}", planned, fit)
            found.append(replace(plane, face=planned.plane_id))
            ratios.append(energy)
    return found, ratios, body


def checked(planes: list[EquiPlane], ratios: list[float], body: Body) -> Rigidity:
    prior = ComPrior.from_bounds(-body.size / 2, body.size / 2)
    com = solve_joint(planes, ERRORS, prior).x[COM]
    return check_rigidity(planes, ratios, com, ERRORS, prior)


def test_rigid_bodies_pass_and_the_answer_says_what_would_have_shown():
    found = [checked(*strikes(np.random.default_rng(seed))) for seed in range(40)]
    assert [each.answer for each in found] == [Answer.NOTHING_MOVES] * 40
    assert max(each.share for each in found) < 0.15


def test_phi_that_rises_with_the_energy_is_found():
    found = checked(*strikes(np.random.default_rng(1), rise=math.radians(1.0)))
    assert found.answer is Answer.NOT_RIGID
    assert found.energies.moves
    assert not found.poses.moves
    assert found.energies.trend == pytest.approx(math.radians(1.0), rel=0.2)


def test_contents_that_lie_on_the_floor_of_each_pose_are_found_with_the_centre_of_each():
    planes, ratios, body = strikes(np.random.default_rng(2), lower=2e-3)
    found = checked(planes, ratios, body)
    assert found.answer is Answer.NOT_RIGID
    assert found.poses.moves
    assert not found.energies.moves
    # Upright c is 2 mm lower, upside down 2 mm higher in O; two edges of a pose show a part of it.
    assert 1.5e-3 < found.poses.largest_shift < 4.5e-3
    upright, upside_down = found.poses.centres
    assert upright.position[2] - body.com[2] == pytest.approx(-2e-3, abs=4 * upright.covariance[2, 2] ** 0.5)
    assert upside_down.position[2] - body.com[2] == pytest.approx(
        2e-3, abs=4 * upside_down.covariance[2, 2] ** 0.5
    )
    assert upright.residual > 3e-4


def test_one_bad_strike_is_no_sign_of_contents():
    for seed in range(10):
        planes, ratios, body = strikes(np.random.default_rng(seed), energies=(1.1, 1.1))
        planes[seed % len(planes)] = replace(
            planes[seed % len(planes)], phi=planes[seed % len(planes)].phi + math.radians(1.5)
        )
        assert not checked(planes, ratios, body).poses.moves


def test_crumbs_under_the_object_are_seldom_taken_for_contents():
    found = [
        checked(*strikes(np.random.default_rng(seed), scatter=math.radians(0.3))).energies
        for seed in range(30)
    ]
    assert sum(each.moves for each in found) <= 5
    assert sum(each.unexplained for each in found) >= 20


def test_strikes_at_one_energy_on_one_face_test_nothing():
    planes, ratios, body = strikes(np.random.default_rng(3), edges=UPRIGHT, energies=(1.1,))
    found = checked(planes, ratios, body)
    assert found.answer is Answer.NOT_TESTED
    assert found.share == math.inf


def test_a_strike_without_k_does_not_enter_the_test_of_energies():
    planes, ratios, body = strikes(np.random.default_rng(4))
    planes = [replace(plane, k=None, sd_k=None) for plane in planes]
    assert checked(planes, ratios, body).energies.edges == ()


def test_strikes_that_were_jolted_count_in_twos():
    """Fast strikes that agree, and slow ones of the same contents whose speed jumped."""
    rise = math.radians(2.0)
    planes, ratios, body = strikes(np.random.default_rng(5), rise=rise, energies=(1.6, 1.62))
    slow, slow_ratios, _ = strikes(np.random.default_rng(6), rise=rise, energies=(1.05,))
    prior = ComPrior.from_bounds(-body.size / 2, body.size / 2)
    com = solve_joint(planes, ERRORS, prior).x[COM]

    def moves(count: int) -> bool:
        jolted = slow[:count], slow_ratios[:count]
        return check_rigidity(planes, ratios, com, ERRORS, prior, jolted).energies.moves

    assert [moves(count) for count in (0, 1, 4)] == [False, False, True]
