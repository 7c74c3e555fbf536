"""Names of edges that a person can point at, and their drawings."""

from __future__ import annotations

import re

import numpy as np

from analyze.cards.drawn_shape import drawn_shape
from analyze.cards.edge_picture import edge_picture
from analyze.cards.ink import PIVOT
from analyze.geometry.object_model import load_object_model
from schemas.edge_names import edge_names, signed_axes
from tests.analyze.estimation.bodies import SIX_AXES, planned_strike
from tests.analyze.simulated_session import carton, object_spec


def strikes():
    body = carton()
    return [planned_strike(body, *axis, 0) for axis in SIX_AXES]


def placed(strike, tip, up, axis_id, **changes):
    R = np.stack([tip, np.cross(up, tip), up])
    return strike.model_copy(update={"R_world_object": R.tolist(), "axis_id": axis_id, **changes})


def test_every_edge_of_a_box_is_named_by_its_two_faces():
    strike = strikes()[0]
    x, y, z = np.eye(3)
    named = edge_names(
        [
            placed(strike, x, z, "a"),
            placed(strike, -y, -z, "b"),
            placed(strike, -y, -x, "c"),
            placed(strike, y, x, "d", rolls=True),
        ]
    )
    assert named == {
        "a": "bottom edge, +x side",
        "b": "top edge, −y side",
        "c": "upright edge, +x/−y side",
        "d": "upright rim, −x/+y side",
    }


def test_names_differ_and_repeated_strikes_share_one():
    found = edge_names([*strikes(), *strikes()])
    assert len(found) == len(set(found.values())) == len({each.axis_id for each in strikes()})


def test_one_edge_struck_from_both_its_faces_has_two_names():
    strike = strikes()[0]
    x, _, z = np.eye(3)
    found = edge_names([placed(strike, x, z, "a"), placed(strike, -z, -x, "b")])
    assert found == {
        "a": "bottom edge, +x side, −z underneath",
        "b": "bottom edge, +x side, +x underneath",
    }


def test_turns_of_one_rim_by_a_few_degrees_keep_apart_by_place_or_id():
    strike = strikes()[0]
    x, y, z = np.eye(3)
    near = np.cos(0.1) * x + np.sin(0.1) * y
    moved = strike.pivot.model_copy(update={"point": [0.03, 0.004, 0.0]})
    found = edge_names(
        [placed(strike, x, z, "a"), placed(strike, near, z, "b", pivot=moved), placed(strike, near, z, "c")]
    )
    assert len(set(found.values())) == 3
    assert "(30, 4, 0) mm" in found["b"]


def test_slanted_sides_have_two_axes():
    assert signed_axes(np.array([0.7, -0.7, 0.1])) == ["+x", "−y"]


def test_drawing_marks_the_edge_and_is_the_same_each_time():
    spec = object_spec(carton())
    shape = drawn_shape(load_object_model(spec, None, spec.name))
    drawings = [edge_picture(shape, spec, strike, "edge") for strike in strikes()]
    assert drawings == [edge_picture(shape, spec, strike, "edge") for strike in strikes()]
    assert len(set(drawings)) == len({each.axis_id for each in strikes()})
    for drawing in drawings:
        assert drawing.count(f'stroke="{PIVOT}"') + drawing.count(f'fill="{PIVOT}"') == 1
        numbers = [float(each) for each in re.findall(r"[ML ](-?[0-9.]+)", drawing.split("aria-label")[1])]
        assert min(numbers) > -5
        assert max(numbers) < 155
