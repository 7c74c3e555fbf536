"""Sessions of a box with drawn errors of the table, of edges and strikes, and bodies for them.

Used by tests of the posterior, of the checks and of the what-ifs. Does not model: slip, bounce, frames.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analyze.estimation.equiplane import equiplane_from_fit
from analyze.estimation.inertia import shape_prior
from analyze.estimation.joint import MomentModel
from analyze.estimation.joint_model import OWN_RADIUS_FRACTION
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.types import Array, EquiPlane
from tests.analyze.estimation.bodies import GRAVITY, Body, box_body, fit_of, planned_strike, tip

SIZE = np.array((0.08, 0.06, 0.15))
BODY = box_body(tuple(SIZE.tolist()), (0.026, 0.014, 0.004), 0.005, (0.5, -0.35, 0.79), pitch=0.01)
PRIOR = ComPrior.from_bounds(-SIZE / 2, SIZE / 2)
ERRORS = SystematicErrors(gravity_tilt_sd=1e-3, edge_radius_sd=2e-4)
SHAPE = shape_prior(BODY.cells)
K_RELATIVE_SD = 2e-3
VERTEX_AXES = ((2, -1, 1, 1), (2, -1, 0, 1), (0, 1, 2, 1))
"""arguments of `planned_strike` for the three edges that meet at one corner"""


def lump_body(middle: tuple[float, float, float], radius: float = 0.021) -> Body:
    """Box of the size of `BODY` with nearly all of its mass in a ball about `middle` [m, in O]."""
    near = np.linalg.norm(BODY.points - np.array(middle), axis=1) < radius
    masses = np.where(near, 1.0, 0.02)
    return replace(BODY, masses=0.05 * masses / masses.sum())


def model(body: Body = BODY) -> MomentModel:
    """Mass and gravity of a body, and the prior of the moments by the box."""
    return MomentModel(Scale(body.mass, 1e-4, GRAVITY, 1e-3, K_RELATIVE_SD), SHAPE)


def session(
    rng: np.random.Generator,
    axes: tuple[tuple[int, int, int, int], ...],
    body: Body = BODY,
    k_off: dict[tuple[int, int, int, int], float] | None = None,
    repeats: int = 2,
) -> list[EquiPlane]:
    """Equi-planes of strikes on `axes`, with all modelled errors drawn.

    `k_off` gives, by axis, a further relative error of k that all strikes of the axis share.
    """
    tilt, radius, gravity = rng.normal(0, 1, 3) * (
        ERRORS.gravity_tilt_sd,
        ERRORS.edge_radius_sd,
        1e-3 / GRAVITY,
    )
    planes = []
    for axis in axes:
        strike = planned_strike(body, *axis)
        forward, up = np.array(strike.R_world_object)[0], np.array(strike.R_world_object)[2]
        own = radius + rng.normal(0, OWN_RADIUS_FRACTION * ERRORS.edge_radius_sd)
        moved: Array = 2e-4 * (rng.normal() * forward + rng.normal() * up) + own * (up - forward)
        phi, k = tip(body, strike, moved, body.edge_radius + own)
        k *= (1 + gravity + rng.normal(0, K_RELATIVE_SD)) * (1 + (k_off or {}).get(axis, 0.0))
        phi += tilt + rng.normal(0, ERRORS.axis_angle_sd)
        for repeat in range(repeats):
            off = rng.normal(0, np.hypot(5e-4, ERRORS.strike_angle_sd))
            fit = fit_of(phi + off, k * (1 + rng.normal(0, 3e-3)), 5e-4, 3e-3 * k)
            planes.append(equiplane_from_fit(f"{strike.id}.{repeat}", strike, fit))
    return planes
