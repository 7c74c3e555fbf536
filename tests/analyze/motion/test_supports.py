"""Support lines of outlines whose corners are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analyze.motion.supports import carrying_line, support_lines

MM = 1e-3


def lines(corners, rounding=0.0, **more):
    """Support lines of an outline in mm and degrees: along, up, angle at which each takes over."""
    found = support_lines(MM * np.array(corners, dtype=np.float64), rounding * MM, 5e-5, **more)
    return [(each.along_m / MM, each.up_m / MM, math.degrees(each.takes_over_rad)) for each in found]


def test_box_turns_over_its_edge_until_its_side_lands():
    assert np.allclose(lines([(0, 0), (0, 100), (-60, 100), (-60, 0)]), [(0, 0, 0), (0, 100, 90)])


def test_chamfer_and_foot_take_over_where_their_facet_lies_on_the_table():
    body = [(0, 0), (3, 3), (3, 100), (-63, 100), (-63, 3), (-60, 0)]
    assert np.allclose(lines(body), [(0, 0, 0), (3, 3, 45), (3, 100, 90)])
    feet = [(0, 0), (8, 2), (8, 100), (-68, 100), (-68, 2), (-60, 0), (0, 1), (-1, 1)]
    assert np.allclose(lines(feet), [(0, 0, 0), (8, 2, math.degrees(math.atan2(2, 8))), (8, 100, 90)])


def test_rounding_moves_each_centre_line_inside_both_facets():
    body = [(0, 0), (3, 3), (3, 100), (-63, 100), (-63, 3), (-60, 0)]
    inset = math.tan(math.radians(22.5))
    first, second, last = lines(body, 1.0)
    assert np.allclose(first, (-inset, 1, 0))
    assert np.allclose(second, (2, 3 + inset, 45))
    assert np.allclose(last, (2, 99, 90))


def test_bevel_narrower_than_its_rounding_vanishes_in_it():
    body = [(0, 0), (0.3, 0.3), (0.3, 100), (-63, 100), (-63, 0)]
    assert len(lines(body, 0.3)) == 3
    assert np.allclose(lines(body, 1.0), [(-0.7, 1, 0), (-0.7, 99, 90)])


def test_curved_flank_after_an_edge_is_one_line_or_one_per_corner():
    turn = np.radians(np.arange(0, 91, 5))
    flank = [(5 + 8 * math.sin(a), 10 - 8 * math.cos(a)) for a in turn]
    body = [(-60, 0), (-60, 100), (0, 0), *flank, (13, 100)]
    joined = support_lines(MM * np.array(body), 0.0, 5e-5)
    assert [each.is_curve for each in joined] == [False, True, False, False]
    assert len(lines(body, join_curves=False)) > 12


def test_line_that_carries_at_an_angle_and_its_distance_ahead():
    body = [(0, 0), (3, 3), (3, 100), (-63, 100), (-63, 3), (-60, 0)]
    found = support_lines(MM * np.array(body), 0.0, 5e-5)
    assert [carrying_line(found, math.radians(theta)) for theta in (0, 44, 46, 91)] == [0, 0, 1, 2]
    assert found[1].ahead_m(math.radians(45)) == pytest.approx(3 * math.sqrt(2) * MM)
    assert found[1].takes_over_sd_rad == pytest.approx(5e-5 / (3 * math.sqrt(2) * MM))
