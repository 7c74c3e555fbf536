"""The flank of shapes that are not as even as a designer's: decimated meshes, float32, scans."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analyze.motion.rolling_choice import is_curved, rolling_curve
from analyze.motion.rolling_fit import rolling_fit
from analyze.motion.support_function import circular_support, support_of_outline
from tests.analyze.motion.rolling import RollingBody, draw_rolling, seen_roll
from tests.analyze.motion.tipping import planned

THETA = np.radians(np.linspace(3, 60, 115))
FLANKS = pytest.mark.parametrize(("a", "b"), [(0.015, 0.015), (0.04, 0.04), (0.04, 0.02)])


def uneven_outline(body, facets, rng, noise=0.0):
    """Corners anywhere on the flank, with noise of 1 sigma `noise` [m]."""
    t = np.concatenate([[0, math.pi / 2], rng.uniform(0, math.pi / 2, facets - 1)])
    arc = np.stack([body.a * np.sin(t), -body.b * np.cos(t)], axis=-1)
    points = np.vstack(
        [[-body.back, -body.b], arc, [body.a, body.top - body.b], [-body.back, body.top - body.b]]
    )
    return points + rng.normal(0, 1, points.shape) * noise


def off(flank, a, b):
    """Largest displacement of the contact [m], and rms relative error of the radius."""
    _, ahead, radius = flank.evaluate(THETA)
    exact = np.hypot(a * np.sin(THETA), b * np.cos(THETA))
    aside = ahead - (a * a - b * b) * np.sin(THETA) * np.cos(THETA) / exact
    return np.abs(aside).max(), math.sqrt(np.mean((radius / ((a * b) ** 2 / exact**3) - 1) ** 2))


@FLANKS
@pytest.mark.parametrize("facets", [30, 100, 1000])
def test_facets_of_any_length_are_a_curve_without_faces(a, b, facets):
    for seed in range(5):
        flank = support_of_outline(
            uneven_outline(RollingBody(a, b, (0.0, 0.0), 0.0), facets, np.random.default_rng(seed)),
            np.zeros(2),
        )
        assert is_curved(flank, 0.5), "a facet that is long beside its neighbours is no flat face"
        aside, relative = off(flank, a, b)
        assert aside < 6e-4
        assert relative < 0.2


@FLANKS
def test_rounded_to_float32_millimetres_it_stays_smooth(a, b):
    points = RollingBody(a, b, (0.0, 0.0), 0.0).outline(2000)
    flank = support_of_outline(np.float32(1e3 * (points + 0.07)).astype(float) / 1e3 - 0.07, np.zeros(2))
    aside, relative = off(flank, a, b)
    assert aside < 5e-5
    assert relative < 0.02


@FLANKS
def test_the_roughness_of_a_scan_matches_its_radius_error(a, b):
    z = []
    for seed in range(8):
        rng = np.random.default_rng([seed, 20])
        body = RollingBody(a, b, (0.0, 0.0), 0.0)
        flank = support_of_outline(uneven_outline(body, 300, rng, 2e-5), np.zeros(2))
        aside, relative = off(flank, a, b)
        assert aside < 1.5e-3
        assert relative < 0.5
        z.append((aside / (3 * flank.sd), relative / flank.roughness))
    assert np.all(np.median(z, axis=0) < 1.5), "its sd, and that of its radius"
    assert np.all(np.median(z, axis=0) > 0.2)


def test_a_scanned_flank_gives_c_and_the_moment_of_inertia():
    """Without smoothing the moments were up to 37 % off here, and the planes five of their sd."""
    aside, moment = [], []
    for seed in range(6):
        rng = np.random.default_rng([seed, 3])
        seen = None
        while seen is None:
            seen = seen_roll(draw_rolling(rng, 0.04, 0.04), 1.2, math.radians(0.01), rng)
        body = seen.body
        flank = support_of_outline(uneven_outline(body, 300, rng, 2e-5), np.zeros(2))
        fit = rolling_fit(seen.angle, seen.window, flank)
        assert fit.rolling is not None
        assert fit.rolling.of_shape
        x, z = body.com[0] - fit.rolling.forward, body.com[1] - fit.rolling.up
        sin, cos = math.sin(fit.phi), math.cos(fit.phi)
        R = z * cos - x * sin
        aside.append((x * cos + z * sin) / math.hypot(fit.rolling.sd, R * math.sqrt(fit.covariance[0, 0])))
        error = (R / fit.k) / (body.R / body.k) - 1
        moment.append(error / math.hypot(fit.rolling.radius_sd / R, math.sqrt(fit.covariance[1, 1]) / fit.k))
        assert abs(error) < 0.1
    assert math.sqrt(np.mean(np.square(aside))) < 1.6
    assert math.sqrt(np.mean(np.square(moment))) < 1.6


def test_a_scanned_boxs_edge_is_no_flank():
    """The noisy bottom of a scanned box bends up to its edge over some degrees."""
    rng = np.random.default_rng(2)
    side = np.linspace(0, 1, 200)[:, None]
    corners = np.array([[-0.06, 0.0], [0.0, 0.0], [0.0, 0.2], [-0.06, 0.2]])
    ways = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    points = np.concatenate([start + side * (end - start) for start, end in ways])
    for noise in (2e-5, 5e-5) * 20:
        section = support_of_outline(points + rng.normal(0, noise, points.shape), np.zeros(2))
        assert rolling_curve(section, planned(0.001, 0.3))[0] is None


def test_a_wall_beside_fine_facets_is_flat_however_they_are_cut():
    """A flat wall of 20 mm beyond an arc is found as one flat, for even and uneven facets of the arc."""
    t = np.linspace(0, math.radians(40), 300)
    arc = 0.03 * np.stack([np.sin(t), 1 - np.cos(t)], axis=-1)
    wall = arc[-1] + 0.02 * np.array([math.cos(t[-1]), math.sin(t[-1])])
    for uneven in (False, True):
        keep = np.sort(np.random.default_rng(1).choice(300, 60, replace=False)) if uneven else np.arange(300)
        points = np.vstack([[-0.06, 0.0], arc[keep], arc[-1], wall, [wall[0], 0.2], [-0.06, 0.2]])
        assert support_of_outline(points, np.zeros(2)).longest_flat(0.02, 1.2) == pytest.approx(
            0.02, rel=0.15
        )


def test_a_circle_is_no_curve_of_the_shapes_own():
    seen = None
    rng = np.random.default_rng(3)
    while seen is None:
        seen = seen_roll(draw_rolling(rng, 0.015, 0.015), 1.2, math.radians(0.02), rng)
    fit = rolling_fit(seen.angle, seen.window, circular_support(0.015))
    assert fit.rolling is not None
    assert not fit.rolling.of_shape
    assert fit.rolling.radius_sd == 0.0
