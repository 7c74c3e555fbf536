"""Placement instructions on a card: carried out literally, they lead to the planned placement."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analyze.cards.placing import (
    MIN_ROTATION,
    TOWARDS,
    Tilt,
    Turn,
    placement_change,
    placement_moves,
    side_names,
)
from schemas.object_spec import Box, ObjectSpec, Shape

quaternions = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)
STANDING = np.eye(3)
ROUND = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
"""rotation (3, 3) by a quarter turn anticlockwise, seen from above"""


def carried_out(steps):
    done = np.eye(3)
    for step in steps:
        done = step.matrix() @ done
    return done


@given(quaternions, quaternions)
def test_moves_lead_from_one_placement_to_the_other(before, now):
    R_before, R_now = Rotation.from_quat(before).as_matrix(), Rotation.from_quat(now).as_matrix()
    steps = placement_moves(R_before, R_now)
    left_over = Rotation.from_matrix(R_now @ (carried_out(steps) @ R_before).T).magnitude()
    # Up to three moves smaller than MIN_ROTATION are left out.
    assert left_over < 3.1 * MIN_ROTATION
    assert [type(step) for step in steps] in (
        [],
        [Turn],
        [Tilt],
        [Turn, Tilt],
        [Tilt, Turn],
        [Turn, Tilt, Turn],
    )


@pytest.mark.parametrize(("towards", "direction"), TOWARDS.items())
def test_tilt_moves_the_top_in_the_stated_direction(towards, direction):
    tilt = Tilt(towards, np.pi / 2)
    assert tilt.matrix() @ [0, 0, 1] == pytest.approx(direction)
    assert towards.removeprefix("towards ") in tilt.instruction().partition(":")[2]


def test_anticlockwise_is_as_seen_from_above():
    # The side that faced the camera (-y) then faces away from the striker (+x): anticlockwise seen from
    # above.
    assert Turn(np.pi / 2).matrix() @ [0, -1, 0] == pytest.approx([1, 0, 0])
    assert placement_change(STANDING, ROUND) == "Turn it by 90° anticlockwise, seen from above"
    assert placement_change(ROUND, STANDING) == "Turn it by 90° clockwise, seen from above"
    assert placement_change(STANDING, ROUND @ ROUND) == "Turn it by 180° on the table"


def test_upside_down_is_a_single_move_if_possible():
    assert (
        placement_change(STANDING, np.diag([1.0, -1, -1]))
        == "Turn it upside down, moving its top away from the camera"
    )
    assert (
        placement_change(STANDING, np.diag([-1.0, 1, -1]))
        == "Turn it upside down, moving its top away from the striker"
    )


def test_equal_placements_need_no_instruction():
    assert placement_change(ROUND, ROUND) == ""


def test_side_is_named_by_its_tag_or_else_by_an_axis():
    top = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.05], [0, 0, 0, 1]]
    spec = ObjectSpec(
        name="b",
        mass_kg=0.1,
        mass_sd_kg=0.001,
        shape=Shape(box=Box(size_m=[0.1, 0.1, 0.1])),
        marker=[{"id": 7, "size_m": 0.03, "T_object_marker": top}],
    )
    found = side_names(spec, STANDING)
    assert (found.top, found.under, found.camera, found.away) == (
        "tag 7",
        "the −z side",
        "the −y side",
        "the +x side",
    )
    turned = side_names(spec, Tilt("towards the camera", np.pi / 2).matrix())
    assert turned.camera == "tag 7"
    between = side_names(spec, Turn(np.pi / 4).matrix())
    assert between.camera == "the −x/−y side"
