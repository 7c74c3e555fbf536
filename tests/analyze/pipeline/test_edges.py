"""Faces and radius prior that the analysis gives to a strike's pivot edge."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.geometry.object_model import load_object_model
from analyze.pipeline.equiplanes import with_edge
from analyze.pipeline.evidence import Evidence
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.types import EquiPlane, RadiusSource
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.shapes import spec_of
from tests.analyze.planning.test_moulded import moulded, upright_axes


def edges(spec: ObjectSpec, model, axes) -> dict[str, EquiPlane]:
    evidence = Evidence((), spec, model, None, "", ())  # type: ignore[arg-type]
    return {
        axis.id: with_edge(
            EquiPlane(
                axis.id,
                axis.id,
                axis.point,
                axis.direction,
                axis.plane.up,
                axis.tip,
                0.3,
                1e-3,
                None,
                None,
                0.0,
                axis.radius,
                axis.sd,
                face="named by an older plan",
            ),
            evidence,
        )
        for axis in axes
    }


@pytest.mark.parametrize("radius", [{}, {"edge_radius_m": 1e-3}])
def test_edges_of_a_side_face_name_it_as_the_resting_face_does(radius):
    spec = spec_of({"box": {"size_m": [0.06, 0.05, 0.2]}, "surface_sd_m": 3e-4}, 0.2, **radius)
    model = load_object_model(spec, None, "")
    axes = pivot_axes(model, spec, resting_planes(model), hypothesis(model))
    found = edges(spec, model, axes)
    assert len(found) == 24
    for axis in axes:
        plane = found[axis.id]
        assert plane.face == axis.plane.id
        wall = next(face for face in resting_planes(model) if face.up @ axis.tip < -0.999)
        assert (plane.wall, plane.wall_lean) == (wall.id, pytest.approx(0.0, abs=1e-9))
        expected = RadiusSource.STATED if radius else RadiusSource.ASSUMED
        assert plane.radius_prior.source is expected


def test_rounding_of_the_shape_keeps_its_radius():
    spec, model = moulded(0.003, False)
    _, axes = upright_axes(spec, model)
    found = edges(spec, model, axes)
    assert found
    for plane in found.values():
        assert plane.radius_prior.source is RadiusSource.SHAPE
        assert plane.edge_radius == pytest.approx(0.003, rel=0.05)
        assert plane.radius_prior.sd < 3e-4
        assert np.allclose(plane.point, next(axis.point for axis in axes if axis.id == plane.axis_id))
