"""Stage two ends where the next face lands, also where that hardly slows the body."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from analyze.geometry.object_model import load_object_model
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.reproduce.paper.stage_two import NEAR, landing_angle, stage_two
from schemas.strike_plan import Pivot
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.planning.test_planes_and_pivots import hexagon


def lying_hexagon():
    """Strikes over the edges along its length, and the shape."""
    spec = spec_of({"file": "b.stl", "unit": "mm"}, edge_radius_m=0.001)
    model = load_object_model(spec, stl(hexagon(35, 80)), "b.stl")
    for axis in pivot_axes(model, spec, resting_planes(model), hypothesis(model)):
        pivot = Pivot(point=axis.point.tolist(), direction=axis.direction.tolist(), radius_m=axis.radius, sd_m=axis.sd)
        yield axis, SimpleNamespace(pivot=pivot, R_world_object=axis.R_world_object.tolist()), model


def test_the_next_side_of_a_hexagon_lands_at_60_degrees_and_its_end_at_90():
    angles = {abs(float(axis.direction[2])) > 0.99: np.degrees(landing_angle(strike, model)) for axis, strike, model in lying_hexagon()}
    assert angles[True] == pytest.approx(60.0, abs=1e-6)
    assert angles[False] == pytest.approx(90.0, abs=1e-6)


def test_frames_after_that_are_none_of_its():
    _, strike, model = next(each for each in lying_hexagon() if abs(each[0].direction[2]) > 0.99)
    theta = np.radians(np.linspace(0, 87, 45))
    motion = SimpleNamespace(angle=SimpleNamespace(theta=theta), phases=SimpleNamespace(stage_two=(16, 45)), fit=None)
    start, stop = stage_two(motion, strike, model)
    assert start == 16
    assert theta[stop - 1] < np.radians(60) - NEAR <= theta[stop]
