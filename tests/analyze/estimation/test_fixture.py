import numpy as np
import pytest

from analyze.estimation.fixture import fixture_prior, without_fixture
from analyze.estimation.mass_properties import CentreOfMass, InertialParameters
from analyze.estimation.moment_prior import UnitPrior
from analyze.geometry.held_object import HeldObject, KnownBody
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.geometry.rotations import hat
from analyze.geometry.second_moments import symmetric_entries, symmetric_matrix
from tests.analyze.held_session import (
    BASE_CENTRE,
    BASE_SIZE,
    HOUSING,
    OBJECT_CENTRE,
    OBJECT_MASS,
    OBJECT_SIZE,
    base_as_stated,
    cloud,
    housing_spec,
)

DRAWS = 200
P_SD = np.array([1e-4, *[6e-5] * 3, *[6e-7] * 6])
"""Errors of the struck body's ten parameters: mass [kg], centre [m], tensor [kg m^2]."""


def housing() -> ObjectModel:
    return load_object_model(housing_spec(), HOUSING, "housing.stl")


def held() -> HeldObject:
    found = housing().held
    assert found is not None
    return found


def struck_parameters(ten: np.ndarray, covariance: np.ndarray) -> InertialParameters:
    com = CentreOfMass(
        ten[1:4],
        covariance[1:4, 1:4],
        True,
        None,
        *([np.zeros(0)] * 3),
        np.zeros((0, 0)),
        np.zeros((3, 0)),
        np.zeros(0),
    )
    inertia = symmetric_matrix(ten[4:])
    sd = symmetric_matrix(np.sqrt(np.diag(covariance)[4:]))
    return InertialParameters(
        float(ten[0]),
        float(np.sqrt(covariance[0, 0])),
        com,
        inertia,
        sd,
        np.ones((3, 3), bool),
        covariance=covariance,
    )


def ten_of(body) -> np.ndarray:
    return np.concatenate([[body.mass], body.com, symmetric_entries(body.inertia)])


def test_the_object_alone_is_the_mesh_without_the_fixtures_bodies():
    model, found = housing(), held()
    assert not model.warnings
    assert model.own.extent == pytest.approx(OBJECT_SIZE / 1000, abs=1e-6)
    assert model.own.centroid == pytest.approx(OBJECT_CENTRE / 1000, abs=1e-6)
    (base,) = found.fixture
    assert base.com == pytest.approx(BASE_CENTRE / 1000, abs=1e-6)
    x, y, z = BASE_SIZE / 1000
    assert np.diag(base.unit_inertia) == pytest.approx(np.array([y**2 + z**2, x**2 + z**2, x**2 + y**2]) / 12)


def test_an_exact_fixture_is_subtracted_exactly():
    rng = np.random.default_rng(1)
    thing = cloud(OBJECT_SIZE, OBJECT_CENTRE, OBJECT_MASS, rng, lump=0.5)
    base = base_as_stated(rng)
    both = thing.and_also(base)
    exact = HeldObject(
        (KnownBody("base", base.mass, 1e-9, base.com, 1e-9, base.inertia / base.mass, 1e-9),),
        OBJECT_MASS,
        1e-9,
        1e-9 * np.ones(3),
        np.zeros(3),
    )
    found = without_fixture(struck_parameters(ten_of(both), 1e-18 * np.eye(10)), exact).inertial
    assert found.mass == pytest.approx(thing.mass)
    assert found.com.position == pytest.approx(thing.com, abs=1e-9)
    assert found.inertia == pytest.approx(thing.inertia, abs=1e-12)
    assert exact.com_alone(both.com) == pytest.approx(thing.com, abs=1e-9)
    assert both.mass * exact.unit_inertia_struck(thing.com, thing.inertia / thing.mass) == pytest.approx(
        both.inertia, abs=1e-12
    )


def test_intervals_hold_for_drawn_fixtures_places_and_strikes():
    rng = np.random.default_rng(2)
    thing = cloud(OBJECT_SIZE, OBJECT_CENTRE, OBJECT_MASS, rng, lump=0.4)
    stated, (base,) = held(), held().fixture
    covariance = np.diag(P_SD**2)
    inside = np.zeros((DRAWS, 9), bool)
    shares = np.zeros(3)
    for i in range(DRAWS):
        placed = thing.moved(
            rng.normal(0, stated.place_sd, 3), rng.normal(0, stated.turn_sd, 3), stated.about
        )
        mass = base.mass + rng.normal(0, base.mass_sd)
        com = base.com + rng.normal(0, base.com_sd, 3)
        sizes = np.sqrt(np.outer(np.diag(base.unit_inertia), np.diag(base.unit_inertia)))
        unit = base.unit_inertia + base.unit_inertia_sd * sizes * symmetric_matrix(rng.normal(size=6))
        whole_mass = placed.mass + mass
        whole_com = (placed.mass * placed.com + mass * com) / whole_mass
        inertia = np.zeros((3, 3))
        for weight, middle, about in ((placed.mass, placed.com, placed.inertia), (mass, com, mass * unit)):
            inertia = inertia + about + weight * hat(middle - whole_com) @ hat(middle - whole_com).T
        ten = np.concatenate([[whole_mass], whole_com, symmetric_entries(inertia)]) + P_SD * rng.normal(
            size=10
        )
        found = without_fixture(struck_parameters(ten, covariance), stated)
        error = np.concatenate(
            [
                found.inertial.com.position - thing.com,
                symmetric_entries(found.inertial.inertia - thing.inertia),
            ]
        )
        inside[i] = np.abs(error) <= 1.96 * np.sqrt(np.diag(found.inertial.covariance)[1:])
        total = np.trace(found.inertial.com.covariance)
        shares = np.array([np.trace(each.com_covariance) / total for each in found.shares])
        assert shares.sum() == pytest.approx(1)
    assert 0.90 <= inside[:, :3].mean() <= 0.98
    assert 0.90 <= inside[:, 3:].mean() <= 0.98
    assert shares.argmax() == 4  # place of the object in the fixture


def test_the_prior_of_both_is_that_of_the_object_and_the_known_fixture():
    found, alone = held(), housing().own
    about = alone.unit_inertia
    prior = fixture_prior(found, lambda com: UnitPrior(about, 0.2 * np.ones((3, 3)) * np.trace(about)))
    middle = found.com_struck(alone.centroid)
    both = prior(middle)
    assert both.mean == pytest.approx(found.unit_inertia_struck(alone.centroid, about))
    share = found.mass / (found.mass + found.fixture_mass)
    assert np.all(both.sd >= share * 0.2 * np.trace(about) - 1e-12)
    assert np.all(both.sd < 0.4 * np.trace(both.mean))
