"""Sessions of the virtual rig without images: theta(t) is simulated with the camera's noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from acquire.session import machine as s
from analyze.pipeline.evidence import Evidence, RecordingHead
from schemas.object_spec import object_sha256
from schemas.proto import percuss_pb2 as pb
from tests.acquire.simulated_rig import SimulatedRig, model_of, plan_for, thing_of
from tests.analyze.simulated_session import manifest

GRAVITY_TILT_SD = 5e-4
"""sd of gravity's tilt [rad], as in the virtual rig's file"""


def theta_session(name: str, seed: int, strikes: int = 9, axes: int = 3) -> tuple[Evidence, pb.TruthBody]:
    """Session of a virtual object, struck until every strike is good, and its ground truth."""
    thing = thing_of(name, seed)
    plan = plan_for(name, strikes, most_axes=axes)
    attempts = SimulatedRig(thing, np.random.default_rng((seed, 0x7E7A))).run(s.SessionMachine(plan))
    shape = thing.shape_file or ("", None)
    motions = tuple(attempt.motion for attempt in attempts)
    stated = manifest(thing.spec).model_copy(update={"gravity_tilt_sd_rad": GRAVITY_TILT_SD})
    head = RecordingHead(
        Path("r.mcap"), stated, "c" * 64, tuple(motion.strike_id for motion in motions), files=("r.mcap",)
    )
    sha256 = object_sha256(thing.spec, shape[1])
    hidden = thing.body
    body = pb.TruthBody(
        mass_kg=hidden.mass_kg,
        com_object=hidden.com_object.tolist(),
        inertia_com=hidden.inertia_com.ravel().tolist(),
        edge_radius_m=thing.edge_radius_m,
        region_mass_kg=hidden.region_masses,
        region_plane=[*hidden.region_plane[0].tolist(), hidden.region_plane[1]],
        shell_thickness_m=hidden.shell_thickness_m,
        friction=thing.friction,
        seed=seed,
    )
    return Evidence((head,), thing.spec, model_of(name), plan, sha256, motions), body
