"""Documents: what is accepted, and that what is not gets one line that names the thing and the remedy."""

from __future__ import annotations

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.documents import (
    DocumentError,
    ObjectSpec,
    StrikePlan,
    canonical_json,
    object_sha256,
    parse_object_spec,
    parse_strike_plan,
    read_object_spec,
)

GOOD = """
name = "carton"
mass_kg = 0.044
mass_sd_kg = 0.0001
edge_radius_m = 0.001

[shape.box]
size_m = [0.08, 0.06, 0.15]

[[marker]]
id = 0
size_m = 0.03
T_object_marker = [[1, 0, 0, 0], [0, 0, -1, -0.03], [0, 1, 0, 0], [0, 0, 0, 1]]
"""


def test_a_good_object():
    spec = parse_object_spec(GOOD, "carton.toml")
    assert spec.shape.box is not None
    assert spec.mass_kg == 0.044


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("mass_kg = 0.044", "mass_kg = 44", "mass_kg is in kilograms"),
        ("mass_kg = 0.044", "mass_kg = -1", "mass_kg"),
        ("mass_kg = 0.044", "mass_kg = nan", "mass_kg"),
        ("edge_radius_m", "edge_radius_mm", "unknown key 'edge_radius_mm'"),
        ("[shape.box]\nsize_m = [0.08, 0.06, 0.15]", '[shape]\nfile = "carton.stl"', "needs its unit"),
        ("[shape.box]\nsize_m = [0.08, 0.06, 0.15]", "[shape]", "exactly one of file, box, cylinder"),
        ("[0.08, 0.06, 0.15]", "[0.08, 0.06]", "size_m"),
        ("[0.08, 0.06, 0.15]", "[0.08, 0.06, 0.0]", "longer than 0"),
        ("id = 0", "id = 900", "marker.0.id"),
        ("mass_sd_kg = 0.0001", "mass_sd_kg = 0.1", "mass_sd_kg is not below"),
        ("[[marker]]", '[[marker]]\nfamily = "25h9"', "family"),
        ("name = ", "name == ", "not valid TOML"),
    ],
)
def test_bad_objects_get_one_line_that_names_the_thing(old, new, says):
    with pytest.raises(DocumentError) as caught:
        parse_object_spec(GOOD.replace(old, new), "carton.toml")
    message = str(caught.value)
    assert message.startswith("carton.toml: ")
    assert says in message
    assert "\n" not in message


def test_a_marker_listed_twice_is_refused():
    with pytest.raises(DocumentError, match="marker id 0 is listed twice"):
        parse_object_spec(GOOD + "\n[[marker]]\nid = 0\nsize_m = 0.03\n", "carton.toml")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DocumentError, match="no such file"):
        read_object_spec(tmp_path / "nothing.toml")


def test_the_identity_depends_on_specification_and_shape():
    spec = parse_object_spec(GOOD, "a")
    heavier = parse_object_spec(GOOD.replace("0.044", "0.045"), "a")
    assert object_sha256(spec, None) == object_sha256(parse_object_spec(GOOD, "b"), None)
    assert len({object_sha256(spec, None), object_sha256(heavier, None), object_sha256(spec, b"x"), object_sha256(spec, b"y")}) == 4


def test_canonical_json_round_trips():
    spec = parse_object_spec(GOOD, "a")
    assert ObjectSpec.model_validate(json.loads(canonical_json(spec))) == spec


@given(st.text(max_size=200))
def test_any_text_is_a_plan_or_a_document_error(text):
    with contextlib.suppress(DocumentError):
        assert isinstance(parse_strike_plan(text, "plan.json"), StrikePlan)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.text(max_size=5),
        lambda c: st.lists(c, max_size=3) | st.dictionaries(st.text(max_size=8), c, max_size=3),
    )
)
def test_any_json_is_a_plan_or_a_document_error(data):
    with contextlib.suppress(DocumentError):
        parse_strike_plan(json.dumps(data), "plan.json")
