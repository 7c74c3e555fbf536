import numpy as np
import pytest

from acquire.errors import ConfigError
from acquire.virtual.given_truth import GivenTruth
from acquire.virtual.held_masses import alone, mesh_points, separate_surfaces, with_fixture
from acquire.virtual.own_masses import own_body
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.shapes import box_triangles

BASE, BASE_AT = np.array([0.1, 0.08, 0.03]), np.array([0.0, 0.0, -0.015])
THING, THING_AT = np.array([0.04, 0.03, 0.07]), np.array([0.005, -0.004, 0.0352])
TRIANGLES = np.concatenate([box_triangles(BASE, BASE_AT), box_triangles(THING, THING_AT)])


def spec_of(number: int = 1) -> ObjectSpec:
    return ObjectSpec.model_validate(
        {
            "name": "part on a base",
            "mass_kg": 0.21,
            "mass_sd_kg": 1e-4,
            "shape": {"file": "a.stl", "unit": "m"},
            "fixture": [{"name": "base", "bodies": [number], "mass_kg": 0.06, "mass_sd_kg": 1e-4}],
            "held": {"place_sd_m": 3e-4, "turn_sd_rad": 3e-3},
            "marker": [{"id": 0, "size_m": 0.03}],
        }
    )


def test_the_fixture_has_its_stated_mass_and_the_object_the_rest():
    spec = spec_of()
    surfaces = separate_surfaces(spec, TRIANGLES)
    assert np.ptp(surfaces.own.reshape(-1, 3), axis=0) == pytest.approx(THING)
    points, depths = mesh_points(surfaces.own, 0.002)
    body = own_body(alone(spec), GivenTruth(), points, depths, 0.002, np.random.default_rng(1))
    both = with_fixture(spec, body, surfaces)
    assert both.mass_kg == pytest.approx(0.21)
    assert sum(both.region_masses) == pytest.approx(0.15)
    assert both.com_object == pytest.approx((0.15 * body.com_object + 0.06 * BASE_AT) / 0.21)
    x, y, z = BASE
    own = 0.06 / 12 * np.diag([y**2 + z**2, x**2 + z**2, x**2 + y**2])
    arms = body.com_object - both.com_object, BASE_AT - both.com_object
    shifted = [
        mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        for mass, arm in zip((0.15, 0.06), arms, strict=True)
    ]
    assert both.inertia_com == pytest.approx(body.inertia_com + own + shifted[0] + shifted[1])


def test_a_fixture_that_names_a_missing_body_is_refused():
    with pytest.raises(ConfigError, match="has 2 bodies"):
        separate_surfaces(spec_of(3), TRIANGLES)
