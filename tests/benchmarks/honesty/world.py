"""Sessions of world shapes: the product's plan, strikes on a mesh-accurate body, and the whole answer.

The true body is the clean mesh: it touches the table with the spheres of the virtual rig, which come from the
hull of the mesh's vertices. What the user states is an object file with that mesh, a scan or convex pieces;
the radius of its edges is not stated. The masses are those of the catalogue.
"""

from __future__ import annotations

import tempfile
import zlib
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from acquire.virtual.contact_shape import mesh_centres
from analyze.errors import AnalyzeError
from analyze.estimation.mass_properties import MassDistribution
from analyze.estimation.region_masses import mass_distribution
from analyze.geometry.object_model import load_object_model
from analyze.pipeline.estimate import estimate_evidence
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import FRICTION, prepare_object
from analyze.planning.view import default_camera
from analyze.reading.object_file import read_object_files
from analyze.result.document import result_document
from analyze.verbs.plan.nominal_striker import prepared_for_mat
from tests.benchmarks.honesty.bodies import Specimen, TrueBody
from tests.benchmarks.honesty.described import Description
from tests.benchmarks.honesty.disturbances import DISTURBANCES
from tests.benchmarks.honesty.session import Trial, make_strikes, session_evidence
from tests.benchmarks.honesty.struck import Bank
from tests.world.catalogue import make
from tests.world.object_files import Kind, write_object
from tests.world.shapes import WorldShape

EDGE_RADIUS_M = (2e-4, 8e-4)
"""range of the radius of a sharp edge [m]"""
USUAL_MASS_KG = 0.2
"""mass of an object up to which the springy table top has its usual mass: a heavier one is struck on a table
that is as firm for it"""
STRIKES = 9
MOST_FRICTION = 0.8


@dataclass(frozen=True)
class WorldTrial:
    """One session of a world shape: evidence, answer and truth."""

    shape: WorldShape
    trial: Trial
    planned: int
    """number of strikes planned; 0 if the product refuses a plan"""

    @property
    def size(self) -> float:
        """Longest edge of the bounding box [m]."""
        return 1e-3 * float(self.shape.size_mm.max())


def run_world_session(name: str, kind: Kind, seed: int, bank: Bank, images: bool = False) -> WorldTrial:
    """Plan, strike and estimate one world shape; the session has a refusal if no answer came out.

    Args:
        name: name of the shape in the catalogue.
        kind: what the user's shape file is.
        seed: seed of the shape's dimensions and frame, and of the session.
        bank: struck motions.
        images: True to draw images of every strike and track their tags.
    """
    shape = make(name, seed)
    made = world_specimen(name, seed)
    try:
        described, mat = _described(shape, kind)
    except AnalyzeError as error:
        return WorldTrial(shape, Trial(made, None, None, None, f"no plan: {error}", {}), 0)
    made = replace(made, friction=_on_mat(made.friction, mat))
    disturbance = DISTURBANCES["none"]
    rng = np.random.default_rng((0x30B1D, seed, *f"{name} {kind}".encode()))
    motions, truths = make_strikes(described, made, (disturbance, images), bank, rng)
    evidence = session_evidence(described, made, disturbance, motions, rng)
    planned = len(described.plan.strikes)
    try:
        # Regions are not compared, and averaging them over walls takes most of the time.
        with mock.patch("analyze.pipeline.estimate.region_masses", _over_one_wall):
            estimate = estimate_evidence(evidence)
    except AnalyzeError as error:
        return WorldTrial(shape, Trial(made, evidence, None, None, str(error), truths), planned)
    return WorldTrial(shape, Trial(made, evidence, estimate, result_document(estimate), "", truths), planned)


@lru_cache(maxsize=8)
def world_specimen(name: str, seed: int) -> Specimen:
    """Body of a world shape with its true masses, and the table on which it is struck."""
    shape = make(name, seed)
    rng = np.random.default_rng((0xB0D1, seed, zlib.crc32(name.encode())))
    mass, com, inertia = shape.mass_properties()
    body = _world_body(shape, float(rng.uniform(*EDGE_RADIUS_M)))
    return Specimen(
        body,
        seed,
        com[None],
        np.array([mass]),
        np.zeros(1, dtype=bool),
        com,
        inertia,
        {},
        friction=rng.uniform(FRICTION, MOST_FRICTION),
        plate=(
            rng.uniform(0.2, 0.4) * max(1.0, mass / USUAL_MASS_KG),
            rng.uniform(700, 1500),
            rng.uniform(0.1, 0.35),
        ),
        lean=rng.standard_normal(2),
    )


def _world_body(shape: WorldShape, radius: float) -> TrueBody:
    """True exterior of a world shape, whose sharp edges have a radius [m]."""
    vertices = 1e-3 * shape.vertices
    centres = mesh_centres(vertices, radius)
    corners = vertices[shape.faces]
    volumes = np.einsum("ti,ti->t", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))
    centroid = volumes @ corners.sum(axis=1) / (4 * volumes.sum())
    return TrueBody(
        shape.name,
        centres,
        np.full(len(centres), radius),
        shape.mass_kg,
        {},
        None,
        (1e3 * corners,),
        (radius, 0.0),
        settles=True,
        struck_beside=tuple(map(float, centroid)),
    )


def _over_one_wall(
    _spec: object, _model: object, cells: Any, parameters: Any, rng: np.random.Generator
) -> MassDistribution:
    return mass_distribution(parameters, cells, rng)


def _on_mat(friction: float, mat: float) -> float:
    """Friction between a plan's mat and the roughest, as far up as `friction` is between the usual and it."""
    return mat + (friction - FRICTION) * (MOST_FRICTION - mat) / (MOST_FRICTION - FRICTION)


def _described(shape: WorldShape, kind: Kind) -> tuple[Description, float]:
    """Object as its user describes it, with the product's plan, and the least friction of the plan's mat.

    Raises:
        AnalyzeError: the product refuses the shape, or a plan.
    """
    with tempfile.TemporaryDirectory() as folder:
        files = read_object_files(write_object(shape, kind, Path(folder)))
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    bench = Bench(StrikerModel(fastest_m_s=5.0), default_camera(), FRICTION)
    prepared, _ = prepared_for_mat(prepare_object(model, files.spec, bench))
    plan = plan_strikes(prepared, files.sha256, PlanRequest(strikes=STRIKES))
    return Description(files.spec, model, (), plan), prepared.bench.friction
