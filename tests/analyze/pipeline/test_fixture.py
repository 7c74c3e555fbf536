import numpy as np
import pytest

from analyze.export.export_source import ExportInput
from analyze.export.formats import Format
from analyze.pipeline import solved
from analyze.pipeline.estimate import estimate_evidence
from analyze.planning.hypothesis import hypothesis
from analyze.result.answer import Answer
from analyze.result.fixture import fixture_lines
from schemas.document import DocumentError
from schemas.object_spec import object_sha256, parse_object_spec
from schemas.result import Result
from tests.analyze.held_session import (
    HOUSING,
    OBJECT_CENTRE,
    OBJECT_MASS,
    OBJECT_SIZE,
    base_as_stated,
    cloud,
    held_evidence,
    housing_spec,
)


@pytest.fixture(scope="module")
def session():
    rng = np.random.default_rng(5)
    thing = cloud(OBJECT_SIZE, OBJECT_CENTRE, OBJECT_MASS, rng, lump=0.4)
    struck = thing.and_also(base_as_stated(rng))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solved, "CELLS", 800)
        return thing, Answer.from_estimate(estimate_evidence(held_evidence(housing_spec(), struck, rng)))


def test_c_and_tensor_of_the_object_alone_are_reported_and_hold(session):
    thing, answer = session
    result = answer.result
    com = np.array(result.centre_of_mass.value)
    ends = np.array(result.centre_of_mass.interval95)
    assert np.all((ends[:, 0] <= thing.com) & (thing.com <= ends[:, 1]))
    assert np.linalg.norm(com - thing.com) < 3e-4
    assert np.ptp(ends, axis=1).max() < 4e-3
    tensor = np.array(result.inertia.interval95).reshape(3, 3, 2)
    assert np.all((tensor[..., 0] <= thing.inertia) & (thing.inertia <= tensor[..., 1]))
    assert result.mass.value == pytest.approx(OBJECT_MASS, abs=3e-4)
    assert result.regions is not None
    masses = [region.mass.value for region in result.regions.regions]
    assert sum(masses) == pytest.approx(OBJECT_MASS, rel=0.01)


def test_the_fixture_is_in_the_result_and_in_words(session):
    thing, answer = session
    fixture = answer.result.fixture
    assert fixture is not None
    assert [part.name for part in fixture.parts] == ["base"]
    assert fixture.struck_mass.value == pytest.approx(OBJECT_MASS + 0.06)
    assert np.linalg.norm(np.array(fixture.struck_centre_of_mass.value) - thing.com) > 5e-3
    text = " ".join(fixture_lines(answer.result))
    assert "base 60.00" in text
    assert "place of the object in the fixture" in text
    assert Result.model_validate_json(answer.json()).fixture == fixture


def test_an_export_is_the_object_alone(session):
    thing, answer = session
    body = ExportInput.from_answer(answer).body(Format.URDF, "part")
    assert body.model.extent == pytest.approx(OBJECT_SIZE / 1000, abs=1e-6)
    assert body.inertial.mass == pytest.approx(OBJECT_MASS, abs=3e-4)
    assert np.linalg.norm(body.inertial.com - thing.com) < 3e-4


def test_the_plan_starts_from_the_object_alone_and_the_known_fixture(session):
    _, answer = session
    model = answer.estimate.evidence.model
    region, alone = hypothesis(model).region, hypothesis(model.own).region
    assert region.centre == pytest.approx(model.held.com_struck(alone.centre))
    assert np.all(region.half < alone.half)


BASE = """
name = "part"
mass_kg = 0.2
mass_sd_kg = 0.001
[shape]
file = "part.stl"
unit = "mm"
[[marker]]
id = 0
size_m = 0.03
"""
FIXTURE = '[[fixture]]\nname = "base"\nbodies = [1]\nmass_kg = 0.1\nmass_sd_kg = 0.001\n'
HELD = "[held]\nplace_sd_m = 0.0003\nturn_sd_rad = 0.003\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (FIXTURE, r"\[held\] is missing"),
        (HELD, r"\[\[fixture\]\] is missing"),
        (FIXTURE.replace("0.1", "0.3") + HELD, "mass_kg is that of both"),
        (FIXTURE.replace("bodies = [1]\n", "") + HELD, "give its bodies in the shape file"),
        (FIXTURE + FIXTURE + HELD, "listed twice"),
    ],
)
def test_a_fixture_that_cannot_be_subtracted_is_refused(text, said):
    with pytest.raises(DocumentError, match=said):
        parse_object_spec(BASE + text, "part.toml")


def test_the_hash_changes_with_a_fixture_only():
    plain = parse_object_spec(BASE, "part.toml")
    held = parse_object_spec(BASE + FIXTURE + HELD, "part.toml")
    assert object_sha256(plain, HOUSING) != object_sha256(held, HOUSING)
    assert "fixture" in housing_spec().model_dump()
