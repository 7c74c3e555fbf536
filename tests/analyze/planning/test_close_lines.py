"""Bodies whose edges have small bevels or roundings of a few facets: planned amid the lines, if need be."""

from __future__ import annotations

import numpy as np

from analyze.geometry.object_model import load_object_model
from analyze.planning.impact import StrikerModel
from analyze.planning.next_edge import MEASURABLE_SHIFT_M
from tests.analyze.geometry.shapes import stl
from tests.analyze.planning.planned import make_plan
from tests.analyze.planning.random_bodies import convex_triangles, spec_for
from tests.analyze.planning.whole_tip import TrueBody, whole_tip

SIZE = np.array([70.0, 46.0, 130.0])


def rounded_box(radius: float, facets: int) -> np.ndarray:
    """Triangles (f, 3, 3) [mm] of a box whose edges and corners are rounded, each edge by `facets` facets."""
    angles = (np.arange(facets + 1)) * np.pi / 2 / facets
    corner = np.array(
        [[np.cos(a) * np.cos(b), np.cos(a) * np.sin(b), np.sin(a)] for a in angles for b in angles]
    )
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    return convex_triangles(np.concatenate([sign * (SIZE / 2 - radius + radius * corner) for sign in signs]))


def test_box_with_small_roundings_is_planned_amid_their_lines():
    """It was refused: over each edge the next line, 0.8 mm away, lands before balance."""
    triangles = rounded_box(2.0, 4)
    spec = spec_for(triangles)
    model = load_object_model(spec, stl(triangles), "b.stl")
    plan = make_plan(model, spec, "", StrikerModel(), friction=0.6)
    assert any("leave open which line carries" in text for text in plan.warnings)
    assert plan.predicted_com_sd_m is not None
    assert plan.predicted_com_sd_m < 2e-3
    body = TrueBody(spec.mass_kg, model.centroid, model.unit_inertia * spec.mass_kg)
    strikes = list({strike.axis_id: strike for strike in plan.strikes}.values())
    for strike in strikes[::3]:
        sd = strike.pivot.sd_m
        assert 3e-4 < sd < MEASURABLE_SHIFT_M
        tip = whole_tip(model, strike, body)
        assert tip.is_over
        assert tip.until_balance(tip.aside) < np.radians(1)
        # The angle at which the body balances over its true line differs by what the stated sd allows.
        arm = np.array(strike.R_world_object) @ (body.com - np.array(strike.pivot.point))
        assert abs(tip.phi - strike.phi_predicted_rad) < 2 * sd / float(np.hypot(arm[0], arm[2]))


def test_sharp_box_is_planned_over_single_lines():
    triangles = rounded_box(0.001, 1)
    spec = spec_for(triangles)
    model = load_object_model(spec, stl(triangles), "b.stl")
    plan = make_plan(model, spec, "", StrikerModel(), friction=0.6)
    assert not any("leave open which line carries" in text for text in plan.warnings)
