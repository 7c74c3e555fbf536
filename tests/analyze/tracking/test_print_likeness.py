"""Comparison of an object's print in two strikes that show one side."""

import numpy as np

from analyze.motion.print_motion import print_motion
from analyze.motion.strike import placement_of
from analyze.tracking.print_likeness import PrintedSurface
from tests.analyze.motion.printed_box import box, camera, tip
from tests.benchmarks.tosses import prepared
from tests.printed import PrintedObject

FRAMES = 40
"""frames from rest until shortly after the blow"""


def view(number: int, seed: int):
    """The box at rest before a strike; its print is drawn from the seed."""
    _, model = box()
    made = tip(number, seed)
    shape = model.vertices, model.faces
    return print_motion(made.frames[:FRAMES], camera(), shape, placement_of(made.planned), made.contact_ns)[1]


def test_a_round_wall_seen_aslant_from_two_sides_is_one_print():
    """The salt tin, put down as planned: none of its strikes shows other print."""
    thing, (model, _) = PrintedObject("salt", 2), prepared("salt")
    assert PrintedSurface(model.vertices, model.faces).differences(thing.rest_views) == ()


def test_strikes_that_show_one_side_are_compared_by_its_print():
    _, model = box()
    surface = PrintedSurface(model.vertices, model.faces)
    upright = view(2, 0)
    assert surface.differences({"s3.1": upright, "s4.1": view(3, 0)}) == ()
    [found] = surface.differences({"s3.1": upright, "s4.1": view(3, 1)})
    assert found.strikes == ("s3.1", "s4.1")
    assert np.allclose(found.normal, [0, 1, 0])
    assert found.correlation < 0.4
