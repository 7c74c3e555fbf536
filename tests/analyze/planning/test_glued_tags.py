"""Tags are glued, for a trial, to every face; gluing them is a remedy only where that gives a plan."""

from __future__ import annotations

import numpy as np
import pytest

from analyze.errors import PlanError
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.planning.examine import Bench
from analyze.planning.glued_tags import with_glued_tags
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import prepare_object
from analyze.planning.view import default_camera, refuse_off_surface
from schemas.object_spec import ObjectSpec
from tests.analyze.geometry.shapes import box_triangles, spec_of, stl
from tests.analyze.planning.random_bodies import spec_for

BENCH = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), 0.6)
GLUE = "glue markers to the faces square to the edges"


def tag(number: int, normal: tuple[float, ...], centre_mm: tuple[float, ...], edge_m: float = 0.02) -> dict:
    """Marker that faces along a normal, with its centre at a point [mm]."""
    out = np.array(normal, float)
    up = np.eye(3)[2 if abs(out[2]) < 0.9 else 1]
    pose = np.eye(4)
    pose[:3] = np.column_stack([np.cross(up, out), up, out, np.array(centre_mm) / 1000])
    return {"id": number, "size_m": edge_m, "T_object_marker": pose.tolist()}


def bracket(leg: float, width: float, wall: float) -> np.ndarray:
    """Triangles [mm] of an L with legs along x and z, each `leg` long."""
    return np.concatenate(
        [
            box_triangles(np.array([leg, width, wall]), (leg / 2, 0, wall / 2)),
            box_triangles(np.array([wall, width, leg]), (wall / 2, 0, leg / 2)),
        ]
    )


def loaded(triangles: np.ndarray, *markers: dict) -> tuple[ObjectModel, ObjectSpec]:
    spec = spec_for(triangles, list(markers))
    return load_object_model(spec, stl(triangles), "b.stl"), spec


def refusal(model: ObjectModel, spec: ObjectSpec) -> str:
    """Message of a refused plan; empty if there is a plan."""
    try:
        plan_strikes(prepare_object(model, spec, BENCH), "", PlanRequest())
    except PlanError as error:
        return str(error)
    return ""


def normals(spec: ObjectSpec) -> list[tuple[float, ...]]:
    return sorted(tuple(np.round(np.array(each.T_object_marker)[:3, 2], 3) + 0.0) for each in spec.marker)


@pytest.mark.parametrize("shape", [{"box": {"size_m": [0.08, 0.06, 0.15]}}, {"cylinder": {
    "radius_m": 0.03, "height_m": 0.1}}])  # fmt: skip
def test_every_side_of_a_box_and_of_a_cylinder_gets_a_tag(shape):
    spec = spec_of(shape, markers=[{"id": 3, "size_m": 0.02}])
    model = load_object_model(spec, None, "")
    glued = with_glued_tags(model, spec)
    added = glued.model_copy(update={"marker": glued.marker[1:]})
    assert normals(added) == sorted(tuple(side) for side in np.concatenate([np.eye(3), -np.eye(3)]))
    assert len({each.id for each in glued.marker}) == 7
    refuse_off_surface(model, added)


def test_gluing_tags_is_no_remedy_where_no_face_is_square_to_the_edges():
    """The bracket lies on the plane across its legs' ends; no face is square to the edges at 45 deg."""
    triangles = bracket(80, 60, 25)
    first = tag(0, (-1, 0, 0), (0, 0, 40))
    model, spec = loaded(triangles, first)
    line = refusal(model, spec)
    assert "without a tag that faces along them" in line
    assert GLUE not in line
    assert "print a base" in line
    assert refusal(model, with_glued_tags(model, spec)), "with a tag on every face it is refused as well"


def test_gluing_tags_is_a_remedy_where_it_gives_a_plan():
    triangles = bracket(70, 90, 15)
    model, spec = loaded(triangles, tag(0, (-1, 0, 0), (0, 0, 35)))
    assert GLUE in refusal(model, spec)
    legs = [
        ((-1, 0, 0), (0, 0, 35)),
        ((1, 0, 0), (15, 0, 45)),
        ((0, 0, -1), (35, 0, 0)),
        ((0, 0, 1), (45, 0, 15)),
    ]
    assert not refusal(*loaded(triangles, *(tag(i, *place) for i, place in enumerate(legs))))
