"""Session without images on an object in its designed fixture, with drawn errors of both.

Tips are the closed form of a body on a rounded edge. The fixture's centre and inertia, the object's pose in
it, scale readings, edge radii and the table's tilt are drawn. Does not model: slip, images, a bad print.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.geometry.held_object import HeldObject, point_inertia
from analyze.geometry.object_model import load_object_model
from analyze.geometry.rotations import matrix_from_vector
from analyze.pipeline.evidence import Evidence, RecordingHead
from analyze.planning.examine import Bench
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import prepare_object
from analyze.types import Array
from schemas.object_spec import ObjectSpec, object_sha256, parse_object_spec
from tests.analyze.fixture_objects import MadeObject
from tests.analyze.held_session import tip
from tests.analyze.simulated_session import manifest, motion


@dataclass(frozen=True)
class Rigid:
    """Rigid body by its mass properties: mass [kg], centre (3,) [m], inertia about it (3, 3) [kg m^2]."""

    mass: float
    com: Array
    inertia: Array

    def and_also(self, other: Rigid) -> Rigid:
        mass = self.mass + other.mass
        com = (self.mass * self.com + other.mass * other.com) / mass
        inertia = sum(each.inertia + each.mass * point_inertia(each.com - com) for each in (self, other))
        return Rigid(mass, com, np.asarray(inertia))

    def moved(self, shift: Array, turn: Array, about: Array) -> Rigid:
        R = matrix_from_vector(turn)
        return Rigid(self.mass, about + R @ (self.com - about) + shift, R @ self.inertia @ R.T)


def drawn_struck(held: HeldObject, thing: MadeObject, rng: np.random.Generator) -> Rigid:
    """Object in its fixture as it really is: both drawn about what the object file states."""
    placed = Rigid(thing.mass, thing.com, thing.inertia).moved(
        rng.normal(0, held.place_sd, 3), rng.normal(0, 1, 3) * held.turn_sd, held.about
    )
    for body in held.fixture:
        unit = body.unit_inertia * (1 + body.unit_inertia_sd * rng.normal() / 2)
        com = body.com + rng.normal(0, body.com_sd, 3)
        placed = placed.and_also(Rigid(body.mass, com, body.mass * unit))
    return placed


def drawn_evidence(
    text: str, data: bytes, thing: MadeObject, bench: Bench, rng: np.random.Generator, strikes: int = 12
) -> Evidence:
    """Evidence of a planned session with the written files, whose masses are filled in as weighed.

    Args:
        text: object file of object and fixture.
        data: its shape file.
        thing: object with its true mass properties.
        bench: bench of the plan.
        rng: generator of all errors.
        strikes: number of strikes.
    """
    stated = parse_object_spec(text, "held.toml")
    name = stated.shape.file or ""
    model = load_object_model(stated, data, name)
    assert model.held is not None
    struck = drawn_struck(model.held, thing, rng)
    spec = weighed(stated, struck.mass, 1e-4, rng)
    model = load_object_model(spec, data, name)
    prepared = prepare_object(model, spec, bench)
    plan = plan_strikes(prepared, object_sha256(spec, data), PlanRequest(strikes=strikes))
    tilt, radius_off = rng.normal(0, np.radians(0.1)), rng.normal(0, 1)
    motions = []
    for strike in plan.strikes:
        known = next((edge for edge in spec.edge or [] if edge.id == strike.axis_id), None)
        sd = (spec.edge_radius_sd_m if known is None else known.radius_sd_m) or 0.0
        pivot = strike.pivot
        up, forward = np.array(strike.R_world_object)[[2, 0]]
        off = max(sd * radius_off, -pivot.radius_m)
        moved = replace_pivot(strike, np.array(pivot.point) + off * (up - forward), pivot.radius_m + off)
        phi, k = tip(struck, moved)
        k *= 1 + rng.normal(0, 2e-3)
        motions.append(motion(strike, phi + tilt + rng.normal(0, 4e-4), k, 4e-4, 2e-3 * k, rng))
    head = RecordingHead(
        Path("r.mcap"),
        tilted_manifest(spec),
        "c" * 64,
        tuple(each.strike_id for each in motions),
        files=("r.mcap",),
    )
    return Evidence((head,), spec, model, plan, object_sha256(spec, data), tuple(motions))


def weighed(spec: ObjectSpec, mass: float, sd: float, rng: np.random.Generator) -> ObjectSpec:
    """Object file with the masses as a scale of 1 sigma `sd` [kg] reads them."""
    fixture = [
        body.model_copy(update={"mass_kg": body.mass_kg + rng.normal(0, sd), "mass_sd_kg": sd})
        for body in spec.fixture or []
    ]
    return spec.model_copy(update={"mass_kg": mass + rng.normal(0, sd), "mass_sd_kg": sd, "fixture": fixture})


def replace_pivot(strike, point: Array, radius: float):
    pivot = strike.pivot.model_copy(update={"point": point.tolist(), "radius_m": radius})
    return strike.model_copy(update={"pivot": pivot})


def tilted_manifest(spec: ObjectSpec):
    """Manifest of a rig whose table is level to 0.2 degrees."""
    return manifest(spec).model_copy(update={"gravity_tilt_sd_rad": float(np.radians(0.2))})
