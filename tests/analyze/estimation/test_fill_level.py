"""Level, mass and density of a filling from analytic moments of nested boxes."""

import hashlib
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from analyze.estimation.cells import cells_from_voxels
from analyze.estimation.fill_level import Container, KnownDensity, fill_level
from analyze.estimation.part_masses import MeasuredMoments
from analyze.geometry.object_model import load_object_model
from analyze.geometry.voxels import voxelise
from analyze.report.summary import _filling
from analyze.result.answer import answer_evidence
from schemas.document import DocumentError
from schemas.object_spec import (
    Box,
    MarkerSpec,
    ObjectSpec,
    Shape,
    object_sha256,
    parse_object_spec,
)
from schemas.part_label import PartLabel
from schemas.result import WarningCode
from schemas.terminal import Terminal
from tests.analyze.simulated_session import carton, object_spec, session

SIZE = np.array([0.08, 0.06, 0.15])
WALL = 0.003
UP = np.array([0.0, 0.0, 1.0])
DIRECTIONS = np.vstack([np.eye(3), np.array([[1, 1, 0], [1, 0, 1], [0, 1, 1]]) / np.sqrt(2)])
MODEL = load_object_model(
    ObjectSpec(
        name="b",
        mass_kg=0.3,
        mass_sd_kg=1e-4,
        shape=Shape(box=Box(size_m=SIZE.tolist())),
        marker=[MarkerSpec(id=0, size_m=0.02)],
    ),
    None,
    "b",
)


@pytest.fixture(scope="module")
def shells():
    return [
        Container(t, cells_from_voxels(voxelise(MODEL, 0.006, t)), MODEL.hull_vertices)
        for t in (1e-3, 2e-3, 3e-3, 5e-3, 9e-3)
    ]


def box(size, middle, mass):
    """Mass, centroid and inertia tensor about O of a uniform box."""
    own = mass / 12 * (np.sum(size**2) * np.eye(3) - np.diag(size**2))
    return mass, middle, own + mass * (middle @ middle * np.eye(3) - np.outer(middle, middle))


def moments(level, filling, wall, rng=None, com_sd=3e-4, relative_sd=5e-3):
    """Moments of a box with a shell of 3 mm, filled up to `level` (0 to 1) with `filling` [kg]."""
    inner = SIZE - 2 * WALL
    hollow = inner.prod() / SIZE.prod()
    tall = np.array([inner[0], inner[1], level * inner[2]])
    parts = [
        box(SIZE, np.zeros(3), wall / (1 - hollow)),
        box(inner, np.zeros(3), -wall * hollow / (1 - hollow)),
        box(tall, np.array([0, 0, (level - 1) * inner[2] / 2]), filling),
    ]
    mass = sum(m for m, _, _ in parts)
    com = sum(m * c for m, c, _ in parts) / mass
    tensor = sum(each for _, _, each in parts) - mass * (com @ com * np.eye(3) - np.outer(com, com))
    about = np.einsum("ai,ij,aj->a", DIRECTIONS, tensor, DIRECTIONS)
    sd = np.concatenate([[1e-4], np.full(3, com_sd), relative_sd * about])
    error = np.zeros(len(sd)) if rng is None else rng.normal(0, sd)
    return MeasuredMoments(mass + error[0], com + error[1:4], DIRECTIONS, about + error[4:], np.diag(sd**2))


def height_of(level):
    return -SIZE[2] / 2 + WALL + level * (SIZE[2] - 2 * WALL)


def holds(marginal, true):
    return marginal.interval[0] <= true <= marginal.interval[1]


def volume_of(level):
    return level * float((SIZE - 2 * WALL).prod())


@pytest.mark.parametrize("level", [0.1, 0.5, 0.98])
def test_level_and_mass_of_a_filling_of_unknown_density(shells, level):
    found = fill_level(moments(level, 0.2, 0.06), shells[2:3], UP, None, np.random.default_rng(1))
    assert found.level.value == pytest.approx(height_of(level), abs=max(2 * found.level.sd, 1e-3))
    assert found.mass.value == pytest.approx(0.2, abs=max(2 * found.mass.sd, 2e-3))
    assert found.filled.value == pytest.approx(level, abs=0.05)
    assert found.level.observed
    assert found.mass.observed
    assert found.thickness is None
    assert found.misfit < 0.7


def test_known_density_gives_a_narrower_level(shells):
    seen = moments(0.5, 0.2, 0.06)
    open_ = fill_level(seen, shells[2:3], UP, None, np.random.default_rng(1))
    density = 0.2 / volume_of(0.5)
    known = fill_level(seen, shells[2:3], UP, KnownDensity(density, 0.01 * density), np.random.default_rng(1))
    assert known.level.sd < 0.7 * open_.level.sd
    assert known.density.sd == pytest.approx(0.01 * density, rel=0.4)
    assert holds(known.level, height_of(0.5))


def test_intervals_contain_the_truth(shells):
    rng = np.random.default_rng(4)
    held = []
    for _ in range(20):
        level, filling = rng.uniform(0.15, 0.95), rng.uniform(0.05, 0.3)
        found = fill_level(moments(level, filling, 0.06, rng), shells[2:3], UP, None, rng)
        held.append(
            [holds(found.level, height_of(level)), holds(found.mass, filling), holds(found.shell_mass, 0.06)]
        )
    # 95 % of 20 are 19 +- 1.
    assert np.all(np.sum(held, axis=0) >= 16)


def test_unknown_thickness_is_estimated_with_an_interval(shells):
    found = fill_level(moments(0.4, 0.15, 0.08), shells, UP, None, np.random.default_rng(2))
    assert found.thickness is not None
    assert holds(found.thickness, WALL)
    assert holds(found.level, height_of(0.4))
    assert holds(found.mass, 0.15)
    fixed = fill_level(moments(0.4, 0.15, 0.08), shells[2:3], UP, None, np.random.default_rng(2))
    assert found.level.sd >= 0.9 * fixed.level.sd


def test_result_depends_on_the_direction(shells):
    seen = moments(0.4, 0.2, 0.06)
    assert fill_level(seen, shells[2:3], np.array([1.0, 0, 0]), None, np.random.default_rng(1)).misfit > 5


def test_same_seed_gives_the_same_result(shells):
    seen = moments(0.4, 0.2, 0.06)
    one, other = (fill_level(seen, shells[2:3], UP, None, np.random.default_rng(7)) for _ in range(2))
    assert one.level == other.level


def labelled(evidence, thickness=WALL, **given):
    labels = [PartLabel(name="box", wall=True), PartLabel(name="sand", fills=True, **given)]
    return replace(
        evidence, spec=evidence.spec.model_copy(update={"labels": labels, "shell_thickness_m": thickness})
    )


@pytest.mark.usefixtures("coarse_regions_here")
def test_result_of_a_session_has_the_filling_and_its_assumptions():
    evidence = session(carton(), np.random.default_rng(3))
    result = answer_evidence(labelled(evidence, None, along=[0.0, 0.0, -1.0])).result
    filling = result.filling
    assert filling is not None
    assert result.parts is None
    assert filling.shell_thickness is not None
    assert filling.mass.value + filling.shell.value == pytest.approx(result.mass.value, rel=0.01)
    codes = [warning.code for warning in result.warnings]
    assert WarningCode.FILLING_ASSUMED_RIGID in codes
    # The plane between its two halves is slanted, unlike any level.
    assert (WarningCode.FILLING_UNEXPLAINED in codes) == (filling.misfit > 2.5)
    console = Terminal(width=100, record=True, file=io.StringIO())
    console.print(_filling(filling))
    assert "level along (0.00, 0.00, -1.00) from the origin (mm)" in console.export_text()


@pytest.mark.parametrize(
    ("labels", "why"),
    [
        (
            '[[labels]]\nname = "a"\nfills = true\n[[labels]]\nname = "b"\nfills = true',
            "needs the wall as the only other part",
        ),
        (
            '[[labels]]\nname = "a"\nfills = true\n[[labels]]\nname = "b"\nbetween_m = [0.0, 0.1]',
            "needs the wall as the only other part",
        ),
        (
            '[[labels]]\nname = "a"\nwall = true\ndensity_kg_m3 = 900\n[[labels]]\nname = "b"\nfills = true',
            "density_kg_m3 belongs to a filling",
        ),
        (
            '[[labels]]\nname = "a"\nwall = true\n[[labels]]\nname = "b"\nfills = true\ndensity_kg_m3 = 1.6',
            "water has 1000",
        ),
        (
            (
                '[[labels]]\nname = "a"\nwall = true\n[[labels]]\nname = "b"\nfills = true\nbetween_m = '
                "[0.0, 0.1]"
            ),
            "exactly one of",
        ),
    ],
)
def test_labels_without_a_filling_are_refused_with_the_reason(labels, why):
    head = (
        'name = "o"\nmass_kg = 0.3\nmass_sd_kg = 1e-4\nshape = {box = {size_m = [0.1, 0.1, 0.1]}}\nmarker = '
        "[{id = 0, size_m = 0.02}]\n"
    )
    with pytest.raises(DocumentError, match=why):
        parse_object_spec(head + labels, "o.toml")


def test_object_without_new_labels_keeps_its_identity():
    spec = object_spec(carton()).model_copy(
        update={"labels": [PartLabel(name="a", wall=True), PartLabel(name="b", between_m=[0.0, 0.1])]}
    )
    known = spec.model_dump(mode="json")
    del known["shape"]["surface_sd_m"], known["edge"], known["fixture"], known["held"]
    for marker in known["marker"]:
        del marker["place_sd_m"], marker["turn_sd_rad"]
    for label in known["labels"]:
        for later in ("fills", "density_kg_m3", "density_sd_kg_m3"):
            del label[later]
    before = hashlib.sha256(json.dumps(known, sort_keys=True, separators=(",", ":")).encode()).hexdigest()
    assert object_sha256(spec, None) == before
