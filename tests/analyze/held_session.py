"""Session on an object in a fixture without images: tips of point masses about the planned edges.

The closed form of a body on a rounded edge; independent of the estimators. The object sits otherwise in the
fixture than its file has it, and the fixture is not as stated, by what the caller gives.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.geometry.object_model import load_object_model
from analyze.geometry.rotations import matrix_from_vector
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.planning.impact import StrikerModel
from analyze.types import Array
from schemas.object_spec import ObjectSpec, object_sha256
from schemas.strike_plan import PlannedStrike
from tests.analyze.geometry.shapes import box_triangles, stl
from tests.analyze.planning.planned import make_plan
from tests.analyze.simulated_session import GRAVITY, manifest, motion

BASE_SIZE, BASE_CENTRE = np.array([100.0, 80.0, 30.0]), np.array([0.0, 0.0, -15.0])
OBJECT_SIZE, OBJECT_CENTRE = np.array([40.0, 30.0, 70.0]), np.array([5.0, -4.0, 35.2])
"""Sizes and centres [mm] of the fixture, a flat base, and the object on it, 0.2 mm above."""
HOUSING = stl(
    np.concatenate([box_triangles(BASE_SIZE, BASE_CENTRE), box_triangles(OBJECT_SIZE, OBJECT_CENTRE)])
)
OBJECT_MASS, BASE_MASS = 0.150, 0.060
PLACE_SD, TURN_SD = 4e-4, 4e-3
HAND = StrikerModel(slowest_m_s=0.02, fastest_m_s=5.0, lowest_m=0.005, highest_m=1.0)


@dataclass(frozen=True)
class Masses:
    """Point masses of a rigid body: places (n, 3) [m] and masses (n,) [kg]."""

    points: Array
    masses: Array

    @property
    def mass(self) -> float:
        return float(self.masses.sum())

    @property
    def com(self) -> Array:
        return self.masses @ self.points / self.mass

    @property
    def inertia(self) -> Array:
        arm = self.points - self.com
        second = (arm * self.masses[:, None]).T @ arm
        return np.trace(second) * np.eye(3) - second

    def and_also(self, other: Masses) -> Masses:
        return Masses(np.vstack([self.points, other.points]), np.concatenate([self.masses, other.masses]))

    def moved(self, shift: Array, turn: Array, about: Array) -> Masses:
        return Masses((self.points - about) @ matrix_from_vector(turn).T + about + shift, self.masses)


def housing_spec(**more: object) -> ObjectSpec:
    """Object file of the object on its base."""
    return ObjectSpec.model_validate(
        {
            "name": "part on a base",
            "mass_kg": OBJECT_MASS + BASE_MASS,
            "mass_sd_kg": 1e-4,
            "edge_radius_m": 5e-4,
            "edge_radius_sd_m": 1e-4,
            "shell_thickness_m": 0.004,
            "shape": {"file": "housing.stl", "unit": "mm", "surface_sd_m": 5e-5},
            "fixture": [
                {"name": "base", "bodies": [1], "mass_kg": BASE_MASS, "mass_sd_kg": 1e-4, "com_sd_m": 2e-4}
            ],
            "held": {"place_sd_m": PLACE_SD, "turn_sd_rad": TURN_SD},
            "marker": [{"id": 0, "size_m": 0.03}],
            **more,
        }
    )


def cloud(size: Array, centre: Array, mass: float, rng: np.random.Generator, lump: float = 0.0) -> Masses:
    """Point masses spread over a box [mm], a share `lump` of the mass in one of its corners."""
    points = centre + size * (rng.random((4000, 3)) - 0.5)
    weights = np.full(len(points), (1 - lump) / len(points))
    corner = np.linalg.norm(points - centre - 0.3 * size, axis=1) < 0.25 * size.min()
    weights[corner] += lump / max(corner.sum(), 1)
    return Masses(points / 1000, weights * mass / weights.sum())


def base_as_stated(rng: np.random.Generator) -> Masses:
    """Point masses of the base, exactly with its stated centre of mass."""
    base = cloud(BASE_SIZE, BASE_CENTRE, BASE_MASS, rng)
    mirrored = np.vstack([base.points, 2 * BASE_CENTRE / 1000 - base.points])
    return Masses(mirrored, np.concatenate([base.masses, base.masses]) / 2)


def tip(body: Masses, strike: PlannedStrike) -> tuple[float, float]:
    """True phi [rad] and k [rad/s^2] of a body about a planned edge."""
    R_world_object = np.array(strike.R_world_object)
    arm = R_world_object @ (body.com - np.array(strike.pivot.point))
    arm[1] = 0.0
    R = float(np.linalg.norm(arm))
    line = np.array(strike.pivot.direction)
    moment = float(line @ body.inertia @ line) + body.mass * (R + strike.pivot.radius_m) ** 2
    return float(np.arctan2(-arm[0], arm[2])), body.mass * GRAVITY * R / moment


def held_evidence(spec: ObjectSpec, struck: Masses, rng: np.random.Generator, strikes: int = 12) -> Evidence:
    """Evidence of a planned session on `spec`, with `struck` as the body that really tips."""
    model = load_object_model(spec, HOUSING, "housing.stl")
    plan = make_plan(model, spec, object_sha256(spec, HOUSING), HAND, friction=0.8, strikes=strikes)
    motions = []
    for strike in plan.strikes:
        phi, k = tip(struck, strike)
        k *= 1 + rng.normal(0, 2e-3)
        motions.append(motion(strike, phi + rng.normal(0, 4e-4), k, 4e-4, 2e-3 * k, rng))
    head = RecordingHead(
        Path("r.mcap"), manifest(spec), "c" * 64, tuple(each.strike_id for each in motions), files=("r.mcap",)
    )
    return Evidence((head,), spec, model, plan, object_sha256(spec, HOUSING), tuple(motions))
