"""phi and k of bodies that roll on a curved flank, against Newton's equations and against MuJoCo."""

from __future__ import annotations

import math
from functools import cache

import mujoco
import numpy as np
import pytest

from analyze.estimation.equiplane import equiplane_from_fit
from analyze.motion.pendulum_fit import pivot_fit
from analyze.motion.rolling_fit import rolling_fit
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion
from analyze.motion.support_function import circular_support, support_of_outline
from analyze.types import TipAngle
from schemas.strike_result import Verdict
from tests.analyze.motion.rolling import G, RollingBody, as_tracked, draw_rolling, section_of_body, seen_roll
from tests.analyze.motion.tipping import planned

SECTIONS = [(0.005, 0.005), (0.015, 0.015), (0.04, 0.04), (0.04, 0.02), (0.025, 0.05)]
"""half axes of the flanks' ellipses along and across the table [m]"""
FLANKS = pytest.mark.parametrize(("a", "b"), SECTIONS)


@cache
def strike(a, b, energy, noise_deg, seed=1):
    rng = np.random.default_rng([seed, round(1e4 * a), round(1e4 * b)])
    while True:
        found = seen_roll(draw_rolling(rng, a, b), energy, math.radians(noise_deg), rng)
        if found is not None:
            return found


@FLANKS
def test_the_flank_of_24_facets_is_the_ellipse(a, b):
    flank = support_of_outline(RollingBody(a, b, (0.0, 0.0), 0.0).outline(24), np.zeros(2))
    theta = np.radians(np.linspace(1, 75, 150))
    height, ahead, radius = flank.evaluate(theta)
    exact = np.hypot(a * np.sin(theta), b * np.cos(theta))
    assert np.abs(height - exact).max() < 1e-6
    assert np.abs(ahead - (a * a - b * b) * np.sin(theta) * np.cos(theta) / exact).max() < 1e-5
    assert np.abs(radius / ((a * b) ** 2 / exact**3) - 1).max() < 0.025
    assert np.all(radius >= 0)


def test_a_box_has_corners_and_a_bevel_is_distinguished_from_a_curve():
    box = np.array([[-0.05, 0.0], [0.0, 0.0], [0.0, 0.2], [-0.05, 0.2]])
    rounded = support_of_outline(box, np.array([-0.002, 0.002]), 0.002)
    height, ahead, radius = rounded.evaluate(np.radians(np.linspace(1, 80, 50)))
    assert np.allclose(height, 0.002)
    assert np.allclose(ahead, 0.0, atol=1e-12)
    assert np.allclose(radius, 0.002)
    bevelled = np.array([[-0.05, 0.0], [-0.004, 0.0], [0.0, 0.004], [0.0, 0.2], [-0.05, 0.2]])
    assert support_of_outline(bevelled, np.zeros(2)).longest_flat(0.1, 1.2) == pytest.approx(
        math.hypot(0.004, 0.004), rel=0.01
    )


@FLANKS
@pytest.mark.parametrize("energy", [1.05, pytest.param(1.5, marks=pytest.mark.slow)])
def test_without_noise_phi_and_k_are_exact(a, b, energy):
    seen = strike(a, b, energy, 1e-4)
    fit = rolling_fit(seen.angle, seen.window, section_of_body(seen.body))
    assert math.degrees(abs(fit.phi - seen.body.phi)) < 0.002
    assert abs(fit.k / seen.body.k - 1) < 5e-4
    assert fit.rolling is not None
    assert fit.rolling.energy_ratio == pytest.approx(energy, abs=1e-3)


def test_on_a_circle_only_the_radius_matters():
    seen = strike(0.015, 0.015, 1.5, 1e-4)
    fit = rolling_fit(seen.angle, seen.window, circular_support(0.015))
    assert math.degrees(abs(fit.phi - seen.body.phi)) < 0.001
    assert abs(fit.k / seen.body.k - 1) < 1e-4


def test_a_hinge_is_off_where_it_rolls():
    for a, b, worst_phi, worst_k in ((0.04, 0.04, 0.0, 0.02), (0.04, 0.02, 0.15, 0.0)):
        seen = strike(a, b, 1.5, 1e-4)
        hinge = pivot_fit(seen.angle, seen.window)
        assert math.degrees(abs(hinge.phi - seen.body.phi)) >= worst_phi
        assert abs(hinge.k / seen.body.k - 1) >= worst_k


@FLANKS
def test_the_plane_goes_through_c(a, b):
    """The planned pivot is the ellipse's centre, which on an ellipse is not where the plane passes."""
    seen = strike(a, b, 1.05, 0.02)
    fit = rolling_fit(seen.angle, seen.window, section_of_body(seen.body))
    plane = equiplane_from_fit("s1.1", planned(0.0, seen.body.phi), fit)
    pivot = np.array(planned(0.0).pivot.point)
    com = pivot + np.array([seen.body.com[0], 0.0, seen.body.com[1]])
    assert abs(float(plane.normal @ (com - plane.point))) < 1e-4
    assert plane.edge_radius == pytest.approx(seen.body.touching(seen.body.phi)[2], rel=0.03)
    # From there c is R away, as the moments of inertia need it.
    assert float(np.linalg.norm((com - plane.point)[[0, 2]])) == pytest.approx(seen.body.R, rel=0.02)


def test_intervals_hold_the_truth_and_are_no_wider_than_the_bound():
    """`make bench-rolling` does the same with hundreds."""
    z, ratio = [], []
    for seed in range(7):
        for a, b in SECTIONS[1:4:2] if seed else SECTIONS:
            seen = strike(a, b, 2.0, 0.05, seed + 10)
            section = section_of_body(seen.body)
            fit = rolling_fit(seen.angle, seen.window, section)
            z.append((fit.phi - seen.body.phi) / math.sqrt(fit.covariance[0, 0]))
            if seed == 0:
                ratio.append(math.sqrt(fit.covariance[0, 0]) / seen.bound(section.middle_sd)[0])
    # 17 draws: one in a thousand such sets goes beyond either.
    assert np.mean(np.abs(z) < 1.96) > 0.75
    assert math.sqrt(np.mean(np.square(z))) < 1.5
    assert 0.8 < np.median(ratio) < 1.25


@pytest.mark.parametrize(("a", "b"), [(0.015, 0.015), (0.04, 0.04), (0.04, 0.02)])
@pytest.mark.parametrize("energy", [0.9, 1.2])
def test_a_strike_on_a_flank_is_judged_and_fitted_as_one_that_rolls(a, b, energy):
    rng = np.random.default_rng([7, round(1e4 * b)])
    body = strike(a, b, energy, 0.02).body
    motion, task = as_tracked(body, energy, math.radians(0.02), rng)
    found = analyse_motion(motion, task, MotionSettings())
    assert found.verdict is (Verdict.GOOD if energy > 1 else Verdict.ROCKED_BACK), found.reason
    assert found.fit.estimator == "rolling_fit"
    assert "rolls on a curve" in found.fit.note
    assert not found.fit.violated
    assert abs(found.fit.phi - body.phi) < max(4 * math.sqrt(found.fit.covariance[0, 0]), math.radians(0.02))
    assert found.energy_ratio == pytest.approx(energy, abs=0.03)
    hinge = next(other for other in found.alternatives if other.estimator == "pivot_fit")
    assert hinge.violated


def test_a_sharp_edge_stays_a_hinge():
    rng = np.random.default_rng(3)
    body = strike(0.015, 0.015, 1.2, 0.02).body
    sharp = RollingBody(1e-5, 1e-5, body.com, body.inertia, body.top, body.back)
    motion, task = as_tracked(sharp, 1.2, math.radians(0.02), rng)
    found = analyse_motion(motion, task, MotionSettings())
    assert found.fit.estimator == "pivot_fit"
    assert abs(found.fit.phi - sharp.phi) < math.radians(0.03)


def test_sliding_beside_rolling_is_seen():
    rng = np.random.default_rng(5)
    body = strike(0.04, 0.04, 1.2, 0.02).body
    motion, task = as_tracked(body, 1.2, math.radians(0.02), rng, slide=0.008)
    assert analyse_motion(motion, task, MotionSettings()).verdict is Verdict.SLID


def in_mujoco(a, b, com, inertia, omega, rate=120.0):
    """Tipping angle theta of an ellipsoid (a cylinder if it is round) that rolls on a plane."""
    form = f'cylinder" size="{a} 0.05" euler="90 0 0"' if a == b else f'ellipsoid" size="{a} 0.3 {b}"'
    steps = 80
    world = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{1 / rate / steps}" gravity="0 0 -{G}" integrator="RK4" cone="elliptic" impratio="100"/>
  <default><geom friction="2 0 0" condim="3" solref="-400000 -1500" solimp="0.99 0.999 0.0001"/></default>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body pos="0 0 {b}"><freejoint/>
      <inertial pos="{com[0]} 0 {com[1]}" mass="0.1"
                diaginertia="{0.1 * inertia} {0.1 * inertia} {0.1 * inertia}"/>
      <geom type="{form}/>
    </body>
  </worldbody>
</mujoco>""")
    data = mujoco.MjData(world)
    # Rolling: the point on the table stands still; the body's origin is b over it.
    data.qvel[:] = [omega * b, 0, 0, 0, omega, 0]
    theta = []
    for _ in range(round(1.0 * rate)):
        w, _, y, _ = data.qpos[3:7]
        theta.append(2 * math.atan2(y, w))
        for _ in range(steps):
            mujoco.mj_step(world, data)
    return np.array(theta)


@pytest.mark.parametrize(("a", "b"), [(0.015, 0.015), (0.04, 0.04), (0.04, 0.02)])
def test_against_another_physics(a, b):
    """A rigid-body engine with soft contacts and friction of its own: it creeps a little."""
    body = RollingBody(a, b, (-0.03, 0.06), 0.0022)
    theta = in_mujoco(a, b, body.com, body.inertia, body.omega_for(1.15))
    used = theta[3 : int(np.argmax(theta > body.phi + math.radians(25)))]
    n = len(used)
    time_ns = np.rint(np.arange(n) / 120 * 1e9).astype(np.int64)
    sd = math.radians(0.02)
    angle = TipAngle(time_ns, used, np.full(n, sd), np.zeros(n), np.zeros(n))
    fit = rolling_fit(angle, (0, n), section_of_body(body))
    assert math.degrees(abs(fit.phi - body.phi)) < 0.05
    assert abs(fit.k / body.k - 1) < 0.01
