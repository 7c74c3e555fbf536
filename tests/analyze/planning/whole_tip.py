"""One planned strike carried out in MuJoCo on the corners of the convex hull: does the body tip as planned?

The table touches a body only at corners of its convex hull, so small spheres there are the shape itself. The
striker's push is an impulse at the planned place; nothing of the planner's physics is used.
"""

# mujoco is only partly typed.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from analyze.geometry.object_model import ObjectModel
from schemas.strike_plan import PlannedStrike

CORNER_RADIUS = 1e-4
"""Radius [m] of the spheres at the corners."""
PUSH_S = 0.003
"""Duration [s] of the push."""
STEP_S = 2e-4
"""Step of the simulation [s]."""
SETTLE_S, TIP_S = 0.1, 1.2
"""Times before and after the strike [s]."""
MJCF = """
<mujoco>
<option timestep="{step}" integrator="implicitfast" cone="elliptic" impratio="100" gravity="0 0 -9.81"/>
<default><geom solref="0.001 1" solimp="0.995 0.9995 0.0001" friction="{friction} 0 0" condim="3"/></default>
<worldbody><geom type="plane" size="2 2 0.1" contype="1" conaffinity="2"/>
<body name="body" pos="{pos}" quat="{quat}"><freejoint/>
<inertial pos="{com}" mass="{mass}" fullinertia="{inertia}"/>{corners}</body></worldbody></mujoco>"""


@dataclass(frozen=True)
class WholeTip:
    """Motion of a body after a strike, in the strike's world frame (z up, pivot edge along y)."""

    theta: np.ndarray
    """(n,) tipping angle [rad]."""
    aside: np.ndarray
    """(n,) angle [rad] between the body's pivot direction and y."""
    slip: np.ndarray
    """(n,) displacement [m] of the pivot point along the table, less rolling on its rounding."""
    phi: float
    """Balance angle [rad] for the true centre of mass, as planned."""

    @property
    def is_over(self) -> bool:
        """True if the body tipped 5 deg past balance."""
        return bool(self.theta.max() > self.phi + np.radians(5))

    def until_balance(self, values: np.ndarray) -> float:
        """Largest of `values` (n,) from the strike until the body is past balance, or at the end."""
        past = self.theta > self.phi
        return float(np.abs(values[: int(np.argmax(past)) if past.any() else len(past)]).max())


@dataclass(frozen=True)
class TrueBody:
    """True mass properties of a body, in the object frame."""

    mass: float
    """Mass [kg]."""
    com: np.ndarray
    """(3,) centre of mass [m]."""
    inertia: np.ndarray
    """(3, 3) inertia about it [kg m^2]."""


def whole_tip(
    model: ObjectModel, strike: PlannedStrike, body: TrueBody, energy: float = 1.2, friction: float = 0.6
) -> WholeTip:
    """Carry out a planned strike on a body.

    Args:
        model: Shape.
        strike: Planned strike.
        body: True mass properties.
        energy: Energy over that which takes the true centre of mass to balance.
        friction: Friction coefficient between body and table.
    """
    R, pivot = np.array(strike.R_world_object), np.array(strike.pivot.point)
    simulated = _world(model, strike, body, friction)
    data = mujoco.MjData(simulated)
    impulse, phi = _impulse(strike, body, energy)
    peak, at = impulse * np.pi / 2 / PUSH_S, np.array(strike.impact.point)
    theta: list[float] = []
    aside: list[float] = []
    path: list[np.ndarray] = []
    for _ in range(round(SETTLE_S / STEP_S)):
        mujoco.mj_step(simulated, data)
    for step in range(round(TIP_S / STEP_S)):
        turn = data.xmat[1].reshape(3, 3)
        data.xfrc_applied[1] = 0
        if step * STEP_S < PUSH_S:
            force = np.array([peak * np.sin(np.pi * (step + 0.5) * STEP_S / PUSH_S), 0, 0])
            data.xfrc_applied[1] = [*force, *np.cross(data.xpos[1] + turn @ at - data.xipos[1], force)]
        mujoco.mj_step(simulated, data)
        turn = data.xmat[1].reshape(3, 3)
        turned = turn @ R.T
        theta.append(float(np.arctan2(turned[0, 2], turned[2, 2])))
        aside.append(float(np.arccos(np.clip(turned[1, 1], -1, 1))))
        path.append(data.xpos[1] + turn @ pivot)
        if theta[-1] > phi + np.radians(8):
            break
    angles, along = np.array(theta), np.array(path)[:, 0]
    slip = along - along[0] - strike.pivot.radius_m * (angles - angles[0])
    return WholeTip(angles, np.array(aside), slip, phi)


def _world(model: ObjectModel, strike: PlannedStrike, body: TrueBody, friction: float) -> mujoco.MjModel:
    """MuJoCo model of the table and of the body, which lies on it in the strike's planned rest pose."""
    quaternion = Rotation.from_matrix(np.array(strike.R_world_object)).as_quat()[[3, 0, 1, 2]]
    sphere = f'<geom type="sphere" size="{CORNER_RADIUS}" mass="0" contype="2" conaffinity="1" pos='
    corners = "".join(f'{sphere}"{_numbers(corner)}"/>' for corner in model.hull_vertices)
    entries = [body.inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
    text = MJCF.format(
        step=STEP_S,
        friction=friction,
        pos=_numbers(np.array(strike.p_world_object) + np.array([0, 0, CORNER_RADIUS])),
        quat=_numbers(quaternion),
        com=_numbers(body.com),
        mass=body.mass,
        inertia=_numbers(entries),
        corners=corners,
    )
    return mujoco.MjModel.from_xml_string(text)


def _impulse(strike: PlannedStrike, body: TrueBody, energy: float) -> tuple[float, float]:
    """Impulse [N s] that gives an energy ratio, and balance angle [rad], for the true centre of mass."""
    arm = np.array(strike.R_world_object) @ (body.com - np.array(strike.pivot.point))
    back, up, line = -arm[0], arm[2], np.array(strike.pivot.direction)
    i_edge = line @ body.inertia @ line + body.mass * (back**2 + (up + strike.pivot.radius_m) ** 2)
    rise = np.hypot(back, up) - up
    omega = np.sqrt(2 * body.mass * 9.81 * rise * energy / i_edge)
    return float(omega * i_edge / strike.impact_height_m), float(np.arctan2(back, up))


def _numbers(values: np.ndarray | list[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)
