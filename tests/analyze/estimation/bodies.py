"""Boxes with hidden masses and the phi and k of their strikes; independent of the estimators.

phi and k are the closed form of a body on a rounded edge. Does not model: slip, bounce, frames.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from analyze.estimation.cells import Cells
from analyze.estimation.inertia import inertial_parameters_from_joint
from analyze.estimation.joint import MomentModel, solve_joint
from analyze.estimation.mass_properties import InertialParameters
from analyze.estimation.moment_prior import MomentPrior
from analyze.estimation.priors import ComPrior, Scale, SystematicErrors
from analyze.types import Array, EquiPlane, MotionFit
from schemas.strike_plan import Impact, Pivot, PlannedStrike, Range

GRAVITY = 9.81


@dataclass(frozen=True)
class Body:
    """Box centred on O, made of cubes with masses."""

    size: Array
    pitch: float
    points: Array
    shell: Array
    masses: Array
    regions: Array
    border: float
    edge_radius: float

    @property
    def cells(self) -> Cells:
        """Cells of the body: its cubes, of equal volume."""
        volume = self.pitch**3
        return Cells(
            self.points,
            volume * self.shell,
            volume * (1 - self.shell),
            np.full(len(self.points), self.pitch**2 / 6),
            self.pitch,
        )

    @property
    def mass(self) -> float:
        return float(self.masses.sum())

    @property
    def com(self) -> Array:
        return self.masses @ self.points / self.mass

    @cached_property
    def inertia(self) -> Array:
        x, y, z = (self.points - self.com).T
        own = self.pitch**2 / 6
        entry = lambda values: float(self.masses @ values)  # noqa: E731 - local shorthand
        xy, xz, yz = -entry(x * y), -entry(x * z), -entry(y * z)
        return np.array(
            [
                [entry(y**2 + z**2 + own), xy, xz],
                [xy, entry(x**2 + z**2 + own), yz],
                [xz, yz, entry(x**2 + y**2 + own)],
            ]
        )


def box_body(
    size: tuple[float, float, float],
    regions: tuple[float, float, float],
    border: float,
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0),
    edge_radius: float = 1e-3,
    pitch: float = 5e-3,
) -> Body:
    """Box with masses `regions` of its shell (one voxel thick), above and below the dividing plane."""
    axes = [np.arange(-s / 2 + pitch / 2, s / 2, pitch) for s in size]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    shell = np.any(np.abs(points) > np.array(size) / 2 - pitch, axis=1)
    upper = ~shell & (points @ np.array(normal) / np.linalg.norm(normal) > border)
    lower = ~shell & ~upper
    masses = sum(m * part / part.sum() for m, part in zip(regions, (shell, upper, lower), strict=True))
    return Body(
        np.array(size), pitch, points, shell.astype(float), masses, np.array(regions), border, edge_radius
    )


def planned_strike(body: Body, face: int, sign: int, along: int, side: int, repeat: int = 0) -> PlannedStrike:
    """Strike of a box that rests on one of its faces and tips over an edge of that face.

    Axes are numbered 0 to 2 (x, y, z). `face` is the axis that points down and `sign` its sense, `along` the
    axis parallel to the edge; `side` (1 or -1) is the sense of the tip along the third axis.
    """
    down = np.zeros(3)
    down[face] = sign
    up = -down
    forward = np.zeros(3)
    third = 3 - face - along
    forward[third] = side
    direction = np.cross(up, forward)
    R_world_object = np.array([forward, direction, up])
    corner = np.zeros(3)
    corner[face] = sign * body.size[face] / 2
    corner[third] = side * body.size[third] / 2
    point = corner + body.edge_radius * (up - forward)
    p_world_object = np.array([0, 0, body.edge_radius]) - R_world_object @ point
    axis_id = f"{'xyz'[face]}{'+' if sign > 0 else '-'}/{'xyz'[third]}{'+' if side > 0 else '-'}"
    return PlannedStrike(
        id=f"{axis_id}#{repeat}",
        plane_id=axis_id.partition("/")[0],
        axis_id=axis_id,
        R_world_object=R_world_object.tolist(),
        p_world_object=p_world_object.tolist(),
        pivot=Pivot(point=point.tolist(), direction=direction.tolist(), radius_m=body.edge_radius, sd_m=2e-4),
        impact=Impact(point=(corner * -0.5).tolist(), direction=forward.tolist()),
        impact_height_m=0.08,
        impulse_n_s=Range(min=0.01, target=0.02, max=0.03),
        tip_speed_m_s=Range(min=0.1, target=0.2, max=0.3),
        energy_ratio=1.05,
        phi_predicted_rad=0.4,
        phi_predicted_sd_rad=0.1,
        i_edge_predicted_kg_m2=3e-4,
        visible_markers=[0],
        camera_pose=np.eye(4).tolist(),
        friction_needed=0.2,
    )


def tip(
    body: Body, strike: PlannedStrike, moved: Array | None = None, radius: float | None = None
) -> tuple[float, float]:
    """True phi [rad] and k [rad/s^2] about the strike's edge, in this order.

    `moved` (3,) [m] shifts its centre line; `radius` [m] replaces that of its rounding.
    """
    R_world_object = np.array(strike.R_world_object)
    rho = body.edge_radius if radius is None else radius
    arm = R_world_object @ (
        body.com - np.array(strike.pivot.point) - (np.zeros(3) if moved is None else moved)
    )
    arm[1] = 0.0
    R = float(np.linalg.norm(arm))
    line = np.array(strike.pivot.direction)
    moment = line @ body.inertia @ line
    return float(np.arctan2(-arm[0], arm[2])), body.mass * GRAVITY * R / (moment + body.mass * (R + rho) ** 2)


def fit_of(phi: float, k: float, sd_phi: float, sd_k: float) -> MotionFit:
    """Motion fit with the given values and standard deviations."""
    return MotionFit("pivot_fit", phi, k, np.diag([sd_phi**2, sd_k**2]), 0.0, 1.0, 0, (0, 1), np.zeros(1), "")


def inertial_parameters(
    planes: list[EquiPlane],
    systematic: SystematicErrors,
    com_prior: ComPrior,
    scale: Scale,
    shape: MomentPrior,
) -> InertialParameters:
    """Mass, centre of mass and inertia tensor from phi and k of all strikes together."""
    solution = solve_joint(planes, systematic, com_prior, MomentModel(scale, shape))
    return inertial_parameters_from_joint(solution, com_prior, scale)


def describe(planes: list[EquiPlane]) -> str:
    """Axes and phi of planes, for assertion messages."""
    return ", ".join(f"{plane.axis_id}: {plane.phi:.3f}" for plane in planes)


SIX_AXES = ((2, -1, 1, 1), (2, -1, 0, 1), (2, -1, 1, -1), (0, -1, 1, 1), (1, -1, 2, 1), (1, 1, 0, 1))
"""arguments of `planned_strike` for six axes that determine c and the moments"""
