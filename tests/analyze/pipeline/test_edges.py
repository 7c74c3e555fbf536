"""Faces and radius prior that the analysis gives to a strike's pivot edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.joint_model import centre_line_shift
from analyze.geometry.object_model import LINE_SD, load_object_model
from analyze.motion.supports import support_lines
from analyze.pipeline.equiplanes import with_edge
from analyze.pipeline.evidence import Evidence
from analyze.planning.hypothesis import hypothesis
from analyze.planning.pivots import BRIDGED_SD, pivot_axes
from analyze.planning.stable_planes import resting_planes
from analyze.reading.object_file import read_object_files
from analyze.types import EquiPlane, RadiusSource
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.shapes import spec_of, stl
from tests.analyze.planning.random_bodies import convex_triangles
from tests.analyze.planning.test_moulded import moulded, upright_axes
from tests.world.catalogue import make
from tests.world.object_files import write_object


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


@pytest.mark.parametrize("surface_sd", [0.0, 3e-4])
def test_next_line_has_the_error_of_its_own_facets(surface_sd):
    # A bevel of 4 mm, 1 mm high: too flat for a wall of the edges of the foot, but a facet of the next line.
    ends = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    corners = [np.column_stack([ends * half, np.full(4, z)]) for half, z in ((31, 0), (35, 1), (35, 120))]
    data = stl(convex_triangles(np.vstack(corners)))
    spec = spec_of({"file": "b.stl", "unit": "mm", "surface_sd_m": 3e-4}, 0.2, edge_radius_m=5e-4)
    model = load_object_model(spec, data, "b.stl")
    spec = spec.model_copy(update={"shape": spec.shape.model_copy(update={"surface_sd_m": surface_sd})})
    foot = [plane for plane in resting_planes(model) if plane.up[2] > 0.999]
    axes = pivot_axes(model, spec, foot, hypothesis(model))
    assert len(axes) == 4
    for axis in axes:
        assert axis.sd > BRIDGED_SD
        across = np.stack([axis.tip, axis.plane.up])
        line = support_lines((model.hull_vertices - axis.point) @ across.T, axis.radius, axis.sd)[1]
        point = axis.point + np.array([line.along_m, line.up_m]) @ across
        (planned,) = edges(spec, model, [replace(axis, point=point)]).values()
        carried = replace(planned, face="", facet_rad=line.takes_over_rad, edge_sd=axis.sd)
        found = with_edge(carried, Evidence((), spec, model, None, "", ()))  # type: ignore[arg-type]
        assert found.face not in ("", axis.plane.id)
        assert found.wall
        assert found.edge_sd == pytest.approx(np.hypot(LINE_SD, surface_sd))


def test_curve_that_meshing_may_have_made_is_anything_up_to_a_sharp_edge(tmp_path):
    """The end of a scanned piece of cucumber counted as exactly as round as its mesh: c was 5 mm off."""
    files = read_object_files(write_object(make("gelatin_box", 1), "scan", tmp_path))
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    evidence = Evidence((), files.spec, model, None, "", ())  # type: ignore[arg-type]
    forward, along, up = np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0])
    rolled = EquiPlane(
        "s1", "p0e0", np.zeros(3), along, up, forward, 0.3, 1e-3, None, None, 0.0, 4e-3, 5e-4, rounded=False
    )
    found = with_edge(rolled, evidence)
    assert found.rounded
    assert found.radius_prior.source is RadiusSource.BLURRED
    assert found.edge_radius == pytest.approx(2e-3)
    sharp = 4e-3 * (forward - up)
    assert found.point == pytest.approx(sharp / 2)
    assert found.point - found.edge_radius * centre_line_shift(found) == pytest.approx(sharp)
    flank = replace(rolled, edge_radius=0.03)
    assert with_edge(flank, evidence) is flank
    _, drawn = moulded(0.003, False)
    assert with_edge(rolled, Evidence((), files.spec, drawn, None, "", ())) is rolled  # type: ignore[arg-type]
