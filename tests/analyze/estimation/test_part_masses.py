"""Masses of labelled parts (bodies of a mesh, shell and layers) from moments with errors."""

from __future__ import annotations

import io
import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from analyze.errors import ShapeError
from analyze.estimation.cells import cells_from_voxels
from analyze.estimation.labelled_parts import merged_solid, parts_of_bodies, parts_of_cells
from analyze.estimation.material_prior import LIKE_PROBABILITY, log_material_prior
from analyze.estimation.part_masses import MeasuredMoments, part_masses
from analyze.geometry.bodies import bodies_of
from analyze.geometry.object_model import load_object_model
from analyze.geometry.voxels import voxelise
from analyze.report.summary import render_summary
from analyze.result.answer import answer_evidence
from analyze.verbs.parts import bodies_json, read_bodies, render_bodies
from schemas.document import DocumentError
from schemas.object_spec import Box, MarkerSpec, ObjectSpec, Shape, parse_object_spec
from schemas.part_label import PartLabel
from schemas.terminal import Terminal
from tests.analyze.simulated_session import carton, session

HEAD, HANDLE = (0.09, 0.03, 0.03), (0.02, 0.02, 0.16)


def hammer() -> bytes:
    """STL of a head that touches the end of a handle; centres at 0.095 and 0 m along z."""
    head = trimesh.creation.box(HEAD, trimesh.transformations.translation_matrix([0.01, 0, 0.095]))
    handle = trimesh.creation.box(HANDLE)
    return bytes(trimesh.util.concatenate([handle, head]).export(file_type="stl"))


def spec(labels: list[PartLabel] | None = None, shape: Shape | None = None) -> ObjectSpec:
    return ObjectSpec(
        name="hammer",
        mass_kg=0.3,
        mass_sd_kg=1e-4,
        shape=shape or Shape(file="hammer.stl", unit="m"),
        marker=[MarkerSpec(id=0, size_m=0.02)],
        shell_thickness_m=0.004,
        labels=labels,
    )


def moments_of(parts, masses, rng=None, com_sd=5e-4, relative_sd=0.01):
    """Moments about three axes through c, exact or with drawn errors of the stated sd."""
    masses = np.array(masses)
    mass = masses.sum()
    com = sum(m * part.centroid for m, part in zip(masses, parts, strict=True)) / mass
    arms = [part.centroid - com for part in parts]
    tensor = sum(
        m * (part.unit_inertia + (arm @ arm) * np.eye(3) - np.outer(arm, arm))
        for m, part, arm in zip(masses, parts, arms, strict=True)
    )
    directions = np.vstack([np.eye(3), np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1]]) / math.sqrt(2)])
    about = np.einsum("ai,ij,aj->a", directions, tensor, directions)
    sd = np.concatenate([[1e-4], np.full(3, com_sd), relative_sd * about])
    error = np.zeros(len(sd)) if rng is None else rng.normal(0, sd)
    return MeasuredMoments(mass + error[0], com + error[1:4], directions, about + error[4:], np.diag(sd**2))


def test_touching_bodies_are_separate():
    bodies = bodies_of(spec(), hammer(), "hammer.stl")
    assert [body.open_edges for body in bodies] == [0, 0]
    assert bodies[0].properties.volume == pytest.approx(np.prod(HEAD), rel=1e-5)
    assert bodies[1].properties.volume == pytest.approx(np.prod(HANDLE), rel=1e-5)
    assert bodies[0].properties.centroid == pytest.approx([0.01, 0, 0.095], abs=1e-7)


@pytest.mark.parametrize("turned", [False, True])
def test_a_hole_belongs_to_the_body_around_it(turned):
    outer, hole = trimesh.creation.box((0.06, 0.06, 0.06)), trimesh.creation.box((0.02, 0.02, 0.02))
    hole.invert()
    mesh = trimesh.util.concatenate([outer, hole])
    if turned:
        mesh.invert()
    bodies = bodies_of(spec(), bytes(mesh.export(file_type="stl")), "hollow.stl")
    assert len(bodies) == 1
    assert bodies[0].properties.volume == pytest.approx(0.06**3 - 0.02**3, rel=1e-5)


def test_only_a_mesh_has_bodies():
    with pytest.raises(ShapeError, match="only a mesh file has bodies"):
        bodies_of(spec(shape=Shape(box=Box(size_m=[0.1, 0.1, 0.1]))), None, "box.toml")


def test_merged_solid_has_the_moments_of_its_parts():
    parts = [body.properties for body in bodies_of(spec(), hammer(), "hammer.stl")]
    whole = merged_solid(parts)
    mesh = trimesh.load_mesh(trimesh.util.wrap_as_stream(hammer()), file_type="stl")
    assert whole.volume == pytest.approx(mesh.volume, rel=1e-6)
    assert whole.centroid == pytest.approx(mesh.center_mass, abs=1e-8)
    assert whole.unit_inertia == pytest.approx(mesh.moment_inertia / mesh.volume, rel=1e-6, abs=1e-12)


def test_masses_of_bodies_from_exact_moments():
    parts = [body.properties for body in bodies_of(spec(), hammer(), "hammer.stl")]
    found = part_masses(moments_of(parts, [0.25, 0.04]), ["head", "handle"], parts, np.random.default_rng(1))
    assert found.masses == pytest.approx([0.25, 0.04], abs=5e-4)
    assert all(found.observed)
    assert found.misfit < 0.2


def test_intervals_contain_the_truth():
    parts = [body.properties for body in bodies_of(spec(), hammer(), "hammer.stl")]
    rng = np.random.default_rng(2)
    inside, z = [], []
    for _ in range(24):
        truth = rng.dirichlet([1, 1]) * 0.3
        found = part_masses(moments_of(parts, truth, rng), ["head", "handle"], parts, rng)
        inside.append((found.intervals[:, 0] <= truth) & (truth <= found.intervals[:, 1]))
        z.append((found.masses[0] - truth[0]) / np.sqrt(found.covariance[0, 0]))
    # Of 24 correlated intervals 20 or more contain the truth with probability 0.994; the root mean square has
    # a random error of 0.14.
    assert np.mean(inside) >= 20 / 24
    assert 0.6 < np.sqrt(np.mean(np.square(z))) < 1.4


def test_undetermined_masses_are_reported_as_not_observed():
    """Three parts in a row; only one poorly known moment separates the middle one from its neighbours."""
    row = trimesh.util.concatenate(
        [
            trimesh.creation.box((0.03, 0.03, 0.05), trimesh.transformations.translation_matrix([0, 0, z]))
            for z in (-0.06, 0, 0.06)
        ]
    )
    parts = [body.properties for body in bodies_of(spec(), bytes(row.export(file_type="stl")), "row.stl")]
    found = part_masses(
        moments_of(parts, [0.1, 0.1, 0.1], relative_sd=0.8), ["a", "b", "c"], parts, np.random.default_rng(3)
    )
    assert not all(found.observed)
    assert found.masses.sum() == pytest.approx(0.3, abs=1e-3)
    assert found.intervals.min() >= 0.0


@pytest.mark.parametrize("core_density", [7700.0, 8500.0, 1300.0])
def test_a_sleeve_and_its_core_are_like_the_body_beside_them_unless_the_moments_differ(core_density):
    """Steel, brass or plastic in a steel sleeve: the moments leave 6 of 59 g open (1 sigma)."""
    beside = trimesh.creation.box(
        (0.02, 0.02, 0.1), trimesh.transformations.translation_matrix([0, 0, 0.065])
    )
    sleeve, core = trimesh.creation.box((0.016, 0.016, 0.03)), trimesh.creation.box((0.01, 0.01, 0.03))
    hole = core.copy()
    hole.invert()
    mesh = trimesh.util.concatenate([beside, sleeve, hole, core])
    parts = [body.properties for body in bodies_of(spec(), bytes(mesh.export(file_type="ply")), "a.ply")]
    truth = np.array([7700.0, 7700.0, core_density]) * [part.volume for part in parts]
    rng = np.random.default_rng(6)
    for seed in range(3):
        moments = moments_of(parts, truth, rng)
        found = part_masses(moments, ["beside", "sleeve", "core"], parts, np.random.default_rng(seed))
        # With independent uniform densities 2.3 % of the mass was in the wrong part.
        assert 0.5 * np.abs(found.masses - truth).sum() < 0.01 * truth.sum()
        assert np.all((found.intervals[:, 0] <= truth) & (truth <= found.intervals[:, 1]))
        # The moments alone do not determine the core, unless they bound it by zero.
        assert found.observed == (True, True, core_density < 2000)


def test_a_material_of_its_own_is_found_in_spite_of_the_prior():
    """Head and handle that the moments distinguish; their estimates are those of independent densities."""
    parts = [body.properties for body in bodies_of(spec(), hammer(), "hammer.stl")]
    volumes = np.array([part.volume for part in parts])
    apart = np.array([[7800.0, 562.0]]) * volumes
    alike = np.array([[7800.0, 7700.0]]) * volumes
    prior = log_material_prior(np.vstack([apart, alike]), volumes, 12_000.0)
    assert prior[0] == pytest.approx(math.log(1 - LIKE_PROBABILITY), abs=1e-9)
    assert prior[1] > 1.0
    truth = apart[0]
    found = part_masses(moments_of(parts, truth), ["head", "handle"], parts, np.random.default_rng(1))
    assert found.masses == pytest.approx(truth, abs=1e-3)
    assert all(found.observed)


def test_parts_that_cannot_explain_the_moments_misfit():
    parts = [body.properties for body in bodies_of(spec(), hammer(), "hammer.stl")]
    moments = moments_of(parts, [0.25, 0.05])
    found = part_masses(
        replace(moments, com=moments.com + np.array([0.02, 0.01, 0.0])),
        ["head", "handle"],
        parts,
        np.random.default_rng(1),
    )
    assert found.misfit > 5
    assert not found.explained
    assert not any(found.observed)


def test_parts_are_called_unexplained_by_chance_alone_in_one_session_in_a_hundred():
    parts = [body.properties for body in bodies_of(spec(), hammer(), "hammer.stl")]
    rng = np.random.default_rng(5)
    unexplained = dict.fromkeys((1.0, 2.5), 0)
    for times in unexplained:
        for _ in range(8):
            moments = moments_of(parts, [0.25, 0.05], rng)
            # The stated errors are `times` too small.
            stated = replace(moments, covariance=moments.covariance / times**2)
            found = part_masses(stated, ["head", "handle"], parts, np.random.default_rng(5))
            unexplained[times] += not found.explained
    # 8 draws of probability 0.01: at most one in 99.7 %.
    assert unexplained[1.0] <= 1
    assert unexplained[2.5] >= 7


def test_labels_name_bodies_and_the_rest():
    labels = [PartLabel(name="head", bodies=[1]), PartLabel(name="handle", bodies=[2])]
    bodies = bodies_of(spec(), hammer(), "hammer.stl")
    assert [name for name, _ in parts_of_bodies(labels, bodies, "hammer.stl")] == ["head", "handle"]
    assert [name for name, _ in parts_of_bodies(labels[:1], bodies, "hammer.stl")] == ["head", "rest"]
    with pytest.raises(ShapeError, match="has 2 closed bodies, the object file's labels name number 3"):
        parts_of_bodies([PartLabel(name="head", bodies=[3]), labels[1]], bodies, "hammer.stl")


def box_cells(labels):
    given = spec(labels, Shape(box=Box(size_m=[0.06, 0.05, 0.1])))
    model = load_object_model(given, None, "box")
    return cells_from_voxels(voxelise(model, 0.004, 0.004))


def test_wall_and_layers_fill_the_body():
    labels = [
        PartLabel(name="wall", wall=True),
        PartLabel(name="low", between_m=[-0.05, 0.0]),
        PartLabel(name="high", between_m=[0.0, 0.05]),
    ]
    cells = box_cells(labels)
    parts = dict(parts_of_cells(labels, cells, "box"))
    assert list(parts) == ["wall", "low", "high"]
    inside = 0.052 * 0.042 * 0.092
    assert parts["low"].volume == pytest.approx(inside / 2, rel=0.02)
    assert parts["low"].centroid == pytest.approx([0, 0, -0.023], abs=3e-4)
    assert parts["wall"].volume == pytest.approx(0.06 * 0.05 * 0.1 - inside, rel=0.02)


def test_overlapping_or_empty_layers_are_refused():
    overlap = [PartLabel(name="a", between_m=[-0.05, 0.01]), PartLabel(name="b", between_m=[-0.01, 0.05])]
    with pytest.raises(ShapeError, match="two layers overlap"):
        parts_of_cells(overlap, box_cells(overlap), "box")
    beyond = [PartLabel(name="a", between_m=[0.2, 0.3]), PartLabel(name="b", between_m=[-0.01, 0.05])]
    with pytest.raises(ShapeError, match="part 'a' contains nothing"):
        parts_of_cells(beyond, box_cells(beyond), "box")


@pytest.mark.parametrize(
    ("labels", "words"),
    [
        ('[[labels]]\nname = "a"\nbodies = [1]', "at least 2"),
        (
            '[[labels]]\nname = "a"\nbodies = [1]\n[[labels]]\nname = "a"\nbodies = [2]',
            "two parts are called 'a'",
        ),
        (
            '[[labels]]\nname = "a"\nbodies = [1]\n[[labels]]\nname = "b"\nbodies = [1]',
            "body 1 is in two parts",
        ),
        ('[[labels]]\nname = "a"\nbodies = [1]\n[[labels]]\nname = "b"\nwall = true', "not both"),
        (
            '[[labels]]\nname = "a"\nwall = true\n[[labels]]\nname = "b"\nwall = true',
            "two parts are the wall",
        ),
        (
            '[[labels]]\nname = "a"\n[[labels]]\nname = "b"\nwall = true',
            "give exactly one of bodies, wall, between_m",
        ),
        ('[[labels]]\nname = "a"\nbodies = [0]\n[[labels]]\nname = "b"\nbodies = [2]', "numbers from 1"),
        (
            '[[labels]]\nname = "a"\nbetween_m = [1, 0]\n[[labels]]\nname = "b"\nwall = true',
            "the lower end, then",
        ),
    ],
)
def test_invalid_labels_are_refused_in_one_line(labels, words):
    text = (
        'name = "x"\nmass_kg = 0.3\nmass_sd_kg = 1e-4\n[shape]\nfile = "a.stl"\nunit = "mm"\n[[marker]]\nid '
        f"= 0\nsize_m = 0.02\n{labels}\n"
    )
    tomllib.loads(text)
    with pytest.raises(DocumentError, match=words) as problem:
        parse_object_spec(text, "x.toml")
    assert "\n" not in str(problem.value)


def test_the_table_lists_bodies_and_how_to_label_them(tmp_path):
    (tmp_path / "hammer.stl").write_bytes(hammer())
    text = (
        'name = "hammer"\nmass_kg = 0.3\nmass_sd_kg = 1e-4\n[shape]\nfile = "hammer.stl"\nunit = '
        '"m"\n[[marker]]\nid = 0\nsize_m = 0.02\n'
    )
    (tmp_path / "hammer.toml").write_text(text)
    console = Terminal(record=True, width=120, file=io.StringIO())
    render_bodies(*read_bodies(tmp_path / "hammer.toml"), console)
    shown = console.export_text()
    assert "81.000" in shown
    assert "[[labels]]" in shown
    (tmp_path / "hammer.toml").write_text(
        text + '[[labels]]\nname = "head"\nbodies = [1]\n[[labels]]\nname = "handle"\nbodies = [2]\n'
    )
    files, bodies = read_bodies(tmp_path / "hammer.toml")
    assert [row["part"] for row in bodies_json(files, bodies)] == ["head", "handle"]


def test_a_session_gives_the_masses_of_wall_and_layers():
    body = carton()
    evidence = session(body, np.random.default_rng(3))
    labels = [PartLabel(name="wall", wall=True), PartLabel(name="inside", between_m=[-0.1, 0.1])]
    labelled = replace(evidence, spec=evidence.spec.model_copy(update={"labels": labels}))
    estimate = answer_evidence(labelled)
    assert estimate.result.parts is not None
    wall = estimate.result.parts.parts[0]
    assert wall.name == "wall"
    low, high = wall.mass.interval95
    # The true inside has two halves of 14 and 4 g and is not uniform, which is reported.
    assert any("do not explain the moments" in warning.text for warning in estimate.result.warnings)
    assert 0 < low < high < body.mass
    console = Terminal(record=True, width=120, file=io.StringIO())
    render_summary(estimate, console)
    assert "Labelled parts" in console.export_text()
    assert "parts" not in answer_evidence(evidence).json().partition('"regions"')[0]
