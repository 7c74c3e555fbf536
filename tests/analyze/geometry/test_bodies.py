"""Bodies of assemblies whose parts touch, fill each other or lie inside one another, by file format."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from analyze.errors import ShapeError
from analyze.estimation.labelled_parts import parts_of_bodies
from analyze.geometry.bodies import bodies_of, overlaps_of
from analyze.geometry.object_model import load_object_model
from schemas.object_spec import MarkerSpec, ObjectSpec, Shape
from schemas.part_label import PartLabel

FORMATS = ("stl", "stl_ascii", "obj", "ply", "glb")


def box(size, at, subdivided=0):
    """A box with its middle at `at`, its faces divided into 2 * 4**subdivided triangles."""
    made = trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
    for _ in range(subdivided):
        made = made.subdivide()
    return made


def reversed_mesh(mesh):
    mesh = mesh.copy()
    mesh.invert()
    return mesh


ASSEMBLIES = {
    "common face": [box((0.06, 0.05, 0.04), (0, 0, 0), 2), box((0.06, 0.05, 0.02), (0, 0, 0.03), 2)],
    "common edge": [box((0.04, 0.05, 0.04), (0, 0, 0), 1), box((0.04, 0.05, 0.06), (0.04, 0, 0.05), 1)],
    "common corner": [box((0.04, 0.05, 0.04), (0, 0, 0)), box((0.05, 0.05, 0.04), (0.045, 0.05, 0.04))],
    "stack of three": [box((0.04, 0.05, 0.04 + 0.01 * i), (0, 0, 0.045 * i), 1) for i in (0, 1)]
    + [box((0.04, 0.05, 0.03), (0, 0, 0.085), 1)],
    "pin in a hole": [
        trimesh.creation.annulus(0.01, 0.03, 0.05, sections=24),
        trimesh.creation.cylinder(0.01, 0.05, sections=24),
    ],
    "filled cavity": [
        trimesh.util.concatenate(
            [box((0.06, 0.06, 0.06), (0, 0, 0)), reversed_mesh(box((0.03, 0.03, 0.03), (0.01, 0, 0), 2))]
        ),
        box((0.03, 0.03, 0.03), (0.01, 0, 0), 2),
    ],
}


def exported(bodies, form):
    """Content of a file in the given format with all bodies."""
    if form == "glb":
        return bytes(trimesh.Scene(bodies).export(file_type="glb"))
    data = trimesh.util.concatenate(bodies).export(file_type=form)
    return data.encode() if isinstance(data, str) else bytes(data)


def spec(suffix):
    return ObjectSpec(
        name="assembly",
        mass_kg=0.3,
        mass_sd_kg=1e-4,
        shape=Shape(file=f"a.{suffix}", unit="m"),
        marker=[MarkerSpec(id=0, size_m=0.02)],
    )


def read(data, suffix):
    return bodies_of(spec(suffix), data, f"a.{suffix}")


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("name", ASSEMBLIES)
def test_touching_bodies_have_their_own_volume_and_centre(name, form):
    truth = sorted(ASSEMBLIES[name], key=lambda mesh: -mesh.volume)
    found = read(exported(truth, form), form[:3])
    assert [body.open_edges for body in found] == [0] * len(truth)
    assert [body.properties.volume for body in found] == pytest.approx(
        [mesh.volume for mesh in truth], rel=1e-6
    )
    for body, mesh in zip(found, truth, strict=True):
        assert body.properties.centroid == pytest.approx(mesh.center_mass, abs=1e-7)
    assert overlaps_of(found) == []


@pytest.mark.parametrize("name", ASSEMBLIES)
def test_welded_vertices_and_inward_normals_make_no_difference(name):
    whole = trimesh.util.concatenate(ASSEMBLIES[name])
    whole.merge_vertices()
    whole.invert()
    found = read(whole.export(file_type="obj").encode(), "obj")
    volumes = sorted((mesh.volume for mesh in ASSEMBLIES[name]), reverse=True)
    assert [body.properties.volume for body in found] == pytest.approx(volumes, rel=1e-6)


@pytest.mark.parametrize("name", ASSEMBLIES)
def test_an_assembly_of_touching_bodies_is_an_object(name):
    model = load_object_model(spec("stl"), exported(ASSEMBLIES[name], "stl"), "a.stl")
    assert model.volume == pytest.approx(sum(mesh.volume for mesh in ASSEMBLIES[name]), rel=1e-5)


def test_own_vertex_numbers_separate_bodies_that_overlap_at_common_vertices():
    """Two boxes share an edge and part of their insides: no angle at that edge distinguishes them."""
    pair = [box((0.04, 0.05, 0.04), (0, 0, 0)), box((0.03, 0.05, 0.06), (-0.005, 0, 0.01))]
    found = read(exported(pair, "ply"), "ply")
    assert [body.properties.volume for body in found] == pytest.approx([9e-5, 8e-5], rel=1e-6)
    (common,) = overlaps_of(found)
    assert common.volume == pytest.approx(6e-5, rel=0.05)


def test_a_body_in_the_material_of_another_displaces_it():
    core = box((0.02, 0.02, 0.02), (0.01, 0, 0))
    outer, inner = read(exported([box((0.06, 0.06, 0.06), (0, 0, 0)), core], "stl"), "stl")
    assert inner.properties.volume == pytest.approx(0.02**3, rel=1e-6)
    assert outer.properties.volume == pytest.approx(0.06**3 - 0.02**3, rel=1e-6)
    assert outer.properties.centroid[0] == pytest.approx(-0.01 * 0.02**3 / (0.06**3 - 0.02**3), abs=1e-7)


def test_seams_of_a_texture_do_not_open_a_body():
    text = trimesh.util.concatenate(ASSEMBLIES["common face"]).export(file_type="obj")
    lines, number = [], 0
    for line in text.splitlines():
        if line.startswith("f "):
            corners = [corner.split("/")[0] for corner in line.split()[1:]]
            lines.append("f " + " ".join(f"{corner}/{number + i + 1}" for i, corner in enumerate(corners)))
            number += 3
        else:
            lines.append(line)
    texture = [f"vt {i / number:.6f} 0.5" for i in range(number)]
    found = read("\n".join(["usemtl a", *texture, *lines]).encode(), "obj")
    assert [body.properties.volume for body in found] == pytest.approx([1.2e-4, 6e-5], rel=1e-6)


def test_an_open_body_cannot_be_a_part():
    torn = box((0.06, 0.05, 0.04), (0, 0, 0.1), 3)
    rest = np.arange(len(torn.faces)) % 7 > 0
    torn.update_faces(rest)
    found = read(exported([box((0.06, 0.05, 0.04), (0, 0, 0)), torn], "ply"), "ply")
    number = next(i for i, body in enumerate(found, 1) if body.open_edges)
    with pytest.raises(ShapeError, match=rf"body {number} is not closed \(\d+ open edges\)"):
        parts_of_bodies(
            [PartLabel(name="a", bodies=[number]), PartLabel(name="b", bodies=[3 - number])], found, "a.ply"
        )


def test_a_small_hole_is_closed():
    holed = box((0.06, 0.05, 0.04), (0, 0, 0), 3)
    holed.update_faces(np.arange(len(holed.faces)) != 5)
    found = read(exported([holed, box((0.06, 0.05, 0.02), (0, 0, 0.03), 3)], "ply"), "ply")
    assert [(body.open_edges, body.filled_edges) for body in found] == [(0, 3), (0, 0)]
    assert found[0].properties.volume == pytest.approx(1.2e-4, rel=1e-6)


def test_an_edge_without_length_has_no_angle() -> None:
    """A damaged OBJ: each of its faces stands twice, and two of its vertices are at one place."""
    corners = trimesh.creation.box((0.08, 0.06, 0.15)).vertices
    vertices = np.vstack([corners[:5], (corners[4] + corners[5]) / 2, corners[4:]])
    faces = trimesh.creation.box().faces
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in [*faces, *faces]]
    assert read("\n".join(lines).encode(), "obj")
