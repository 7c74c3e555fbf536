"""Documents: valid ones are accepted, others give one line that names the entry and the remedy."""

from __future__ import annotations

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.document import DocumentError, canonical_json
from schemas.object_spec import ObjectSpec, object_sha256, parse_object_spec, read_object_spec
from schemas.strike_plan import StrikePlan, parse_strike_plan
from schemas.tags import family_and_id, marker_name, name_order
from tests.system.complaints import spec_and_plan

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


SECOND = "[[marker]]\nid = 0\nsize_m = 0.02\n"


def test_one_id_in_two_families_is_two_markers():
    spec = parse_object_spec(
        GOOD.replace("[[marker]]\n", f'{SECOND}family = "25h9"\n[[marker]]\n'), "carton.toml"
    )
    assert [marker.name for marker in spec.marker] == ["25h9-0", 0]


@pytest.mark.parametrize("name", [7, 586, "25h9-34", "4x4_100-0", "mip_36h12-249"])
def test_a_markers_name_is_its_family_and_number(name):
    assert marker_name(*family_and_id(name)) == name


@pytest.mark.parametrize("name", [587, -1, "7", "36h11-7", "25h9-35", "9x9-1", ""])
def test_text_that_names_no_marker_is_refused(name):
    with pytest.raises(ValueError, match=r"is not the name of a marker|has no tag"):
        family_and_id(name)


def test_names_are_sorted_by_family_and_number():
    assert sorted(["5x5_100-3", 12, "25h9-10", 2, "25h9-9"], key=name_order) == [
        2,
        12,
        "25h9-9",
        "25h9-10",
        "5x5_100-3",
    ]


def test_valid_object():
    spec = parse_object_spec(GOOD, "carton.toml")
    assert spec.shape.box is not None
    assert spec.mass_kg == 0.044


def test_radius_that_is_not_given_leaves_the_identity_of_older_recordings():
    left_out = parse_object_spec(GOOD.replace("edge_radius_m = 0.001\n", ""), "carton.toml")
    assert left_out.edge_radius_m is None
    as_recorded = left_out.model_copy(update={"edge_radius_m": 0.0, "edge_radius_sd_m": 0.0})
    assert object_sha256(left_out, None) == object_sha256(as_recorded, None)
    named = GOOD + '[[edge]]\nid = "p0e1"\nradius_m = 0.002\n'
    assert object_sha256(parse_object_spec(named, "n"), None) != object_sha256(
        parse_object_spec(GOOD, "g"), None
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("mass_kg = 0.044", "mass_kg = 44", "mass_kg is in kilograms"),
        ("mass_kg = 0.044", "mass_kg = -1", "mass_kg"),
        ("mass_kg = 0.044", "mass_kg = nan", "mass_kg"),
        ("edge_radius_m", "edge_radius_mm", "unknown key 'edge_radius_mm'"),
        ("[[marker]]", '[[edge]]\nid = "p0e1"\nradius_m = 2.0\n[[marker]]', "it is in metres"),
        (
            "[[marker]]",
            '[[edge]]\nid = "p0e1"\nradius_m = 0.002\n[[edge]]\nid = "p0e1"\nradius_m = 0.001\n[[marker]]',
            "'p0e1' is listed twice",
        ),
        ("[shape.box]\nsize_m = [0.08, 0.06, 0.15]", '[shape]\nfile = "carton.stl"', "needs its unit"),
        ("[shape.box]\nsize_m = [0.08, 0.06, 0.15]", "[shape]", "exactly one of file, box, cylinder"),
        ("[0.08, 0.06, 0.15]", "[0.08, 0.06]", "size_m"),
        ("[0.08, 0.06, 0.15]", "[0.08, 0.06, 0.0]", "longer than 0"),
        ("id = 0", "id = 900", "marker.0.id"),
        ("mass_sd_kg = 0.0001", "mass_sd_kg = 0.1", "mass_sd_kg must be below"),
        (
            "[[marker]]",
            '[[marker]]\nfamily = "25h7"',
            "'25h7' is not a tag family: choose 36h11, 36h10, 25h9, 16h5, 4x4_50",
        ),
        ("id = 0", 'family = "25h9"\nid = 35', "marker.0.id: 25h9 has no tag 35: its ids are 0 to 34"),
        ("id = 0", 'family = "25h9"\nid = -1', "marker.0.id"),
        ("[[marker]]\n", f"{SECOND}[[marker]]\n", "marker id 0 is listed twice"),
        (
            "[[marker]]\n",
            f'{SECOND}family = "4x4_50"\n[[marker]]\nfamily = "4x4_100"\n',
            "4x4_50 and 4x4_100 share their codes",
        ),
        ("name = ", "name == ", "not valid TOML"),
    ],
)
def test_invalid_objects_give_one_line_that_names_the_entry(old, new, says):
    with pytest.raises(DocumentError) as caught:
        parse_object_spec(GOOD.replace(old, new), "carton.toml")
    message = str(caught.value)
    assert message.startswith("carton.toml: ")
    assert says in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            GOOD.replace("mass_kg = 0.044\n", ""),
            "missing: add mass_kg = ... (mass of the object, in kilograms)",
        ),
        (
            GOOD.replace("mass_kg = 0.044\nmass_sd_kg", "mass_sdkg"),
            (
                "correct its spelling (mass_sd_kg?); missing: add mass_kg = ... (mass of the object, in "
                "kilograms)"
            ),
        ),
        (
            GOOD.replace("size_m = [", "size_mm = ["),
            "unknown key 'shape.box.size_mm': remove it or correct its spelling (size_m?)",
        ),
        (
            GOOD.replace("[shape.box]\nsize_m", "[shape.sphere]\nradius_m"),
            (
                "unknown key 'shape.sphere': remove it or correct its spelling ([shape] takes file, unit, "
                "scale_sd, surface_sd_m, box and cylinder)"
            ),
        ),
        (
            GOOD + "\n[[marker]]\nid = 3\n",
            "missing: add size_m = ... in [[marker]] number 2 (edge of the black square, in metres)",
        ),
        (
            "mass_kg = 1\n[shape.box]\nsize_m = [1, 1, 1]\n",
            (
                "missing: add name = ... (name of the object), mass_sd_kg = ... (1 sigma of the mass, in "
                "kilograms: the scale's error)"
            ),
        ),
        (
            GOOD.replace("mass_sd_kg = 0.0001\n", "") + "mass_sd_kg = 0.0001\n",
            (
                "unknown key 'marker.0.mass_sd_kg': remove it or correct its spelling (mass_sd_kg belongs "
                "above the first [section])"
            ),
        ),
        (
            GOOD + 'a = 1\nb = 1\nc = 1\nd = 1\ne = 1\nf = 1\n"g\\nh" = 1\n',
            (
                "'marker.0.b', 'marker.0.c', 'marker.0.d', 'marker.0.e' and 2 more: remove them or correct "
                "their spelling"
            ),
        ),
        (
            GOOD.replace("0.044", "-1").replace("id = 0", "id = 900"),
            "mass_kg: Input should be greater than 0, not -1; wrong too: 'marker.0.id'",
        ),
        (
            GOOD.replace("[shape.box]\nsize_m = [0.08, 0.06, 0.15]", "shape = 5"),
            "shape: should be [shape] (file and unit, or",
        ),
        (
            GOOD.replace("0.044", '"44 g"'),
            "mass_kg: should be a number, not '44 g': write it like mass_kg = NUMBER",
        ),
        (
            GOOD.replace("id = 0", 'id = "a"'),
            (
                "marker.0.id: should be a whole number, not 'a': write it like id = NUMBER in [[marker]] "
                "number 1"
            ),
        ),
        (
            "marker = 3\n",
            (
                "marker: should be [[marker]] (for each tag on the object: id, size_m, and "
                "T_object_marker if its place is known; none if the object is followed by its own print), "
                "not 3"
            ),
        ),
    ],
)
def test_every_missing_and_unknown_key_is_named_with_its_table_and_the_remedy(text, line):
    with pytest.raises(DocumentError) as caught:
        parse_object_spec(text, "carton.toml")
    assert line in str(caught.value)
    assert "\n" not in str(caught.value)


def test_plan_with_missing_entries_names_them_and_the_remedy():
    with pytest.raises(DocumentError) as caught:
        parse_strike_plan('{"object_name": "x", "strikes": []}', "plan.json")
    assert str(caught.value) == "plan.json: missing: 'object_sha256': create it again with `analyze plan`"


def test_a_plan_holds_strikes_or_tosses():
    with pytest.raises(DocumentError, match="holds neither strikes nor tosses"):
        parse_strike_plan('{"object_name": "x", "object_sha256": "0", "strikes": []}', "plan.json")


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
    assert (
        len(
            {
                object_sha256(spec, None),
                object_sha256(heavier, None),
                object_sha256(spec, b"x"),
                object_sha256(spec, b"y"),
            }
        )
        == 4
    )


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


def test_a_number_beyond_every_quantity_is_named():
    plan = json.loads(canonical_json(spec_and_plan()[1]))
    plan["strikes"][0]["p_world_object"][1] = -1e308
    with pytest.raises(DocumentError, match=r"^p: strikes\.0\.p_world_object\.1: should be at most 1e\+30"):
        parse_strike_plan(json.dumps(plan), "p")
