"""Cube thrown on a table in a rigid-body simulation (MuJoCo), which shares no code with the estimators."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from analyze.motion.body_motion import BodyMotion

EDGE = 0.1048
G = 9.8017
MASS = 0.37
RATE = 148.0
STEPS = 68
"""time steps of the simulation per frame"""


_CUBE_TURNS = [turn.as_matrix() for turn in Rotation.create_group("O")]


@dataclass(frozen=True)
class Cube:
    com: np.ndarray
    """(3,) centre of mass c from the cube's middle [m]"""
    moments: np.ndarray
    """(3,) moments of inertia about c along the cube's axes [kg m^2]"""
    friction: float = 0.25
    rounding: float = 0.0
    """radius of edges and corners [m]"""


def tossed(
    cube: Cube, tosses: int, seed: int, start: str = "air", noise_m: float = 0.0, noise_rad: float = 0.0
) -> list[BodyMotion]:
    """Motions of `tosses` throws with white noise on every pose [m, rad].

    They start in the air, or sliding on an edge or a corner.
    """
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(_xml(cube))
    corners = EDGE / 2 * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    found = []
    for _ in range(tosses):
        data = mujoco.MjData(model)
        R = Rotation.random(random_state=rng)
        if start == "edge":
            # Any edge down, its body leaning to either side, level to a thousandth.
            lean = Rotation.from_euler("y", rng.choice([-1, 1]) * rng.uniform(0.5, 1.0))
            which = Rotation.from_matrix(_CUBE_TURNS[rng.integers(len(_CUBE_TURNS))])
            R = Rotation.from_euler("zx", [rng.uniform(0, 6), rng.normal(0, 1e-3)]) * lean * which
        lowest = (R.as_matrix() @ corners.T * (1 - 2 * cube.rounding / EDGE))[2].min() - cube.rounding
        data.qpos[:3] = 0, 0, rng.uniform(0.13, 0.18) if start == "air" else 1e-4 - lowest
        data.qpos[3:7] = R.as_quat()[[3, 0, 1, 2]]
        data.qvel[:2] = rng.normal(0, 0.6, 2)
        data.qvel[2] = rng.normal(0.6, 0.3) if start == "air" else 0.0
        data.qvel[3:] = rng.normal(0, {"air": 4.0, "edge": 0.02, "corner": 1.0}[start], 3)
        position, quaternion = [], []
        for step in range(int((0.45 if start == "air" else 0.25) / model.opt.timestep)):
            if step % STEPS == 0:
                position.append(data.qpos[:3].copy())
                quaternion.append(data.qpos[3:7].copy())
            mujoco.mj_step(model, data)
        turned = Rotation.from_quat(np.array(quaternion)[:, [1, 2, 3, 0]]) * Rotation.from_rotvec(
            rng.normal(0, noise_rad, (len(position), 3))
        )
        time = np.arange(len(position)) / RATE
        found.append(
            BodyMotion(
                time, np.array(position) + rng.normal(0, noise_m, (len(position), 3)), turned.as_matrix()
            )
        )
    return found


def _xml(cube: Cube) -> str:
    com, moments = (" ".join(str(value) for value in values) for values in (cube.com, cube.moments))
    half = EDGE / 2
    shape = f'<geom type="box" size="{half} {half} {half}"/>'
    if cube.rounding:
        # Its twelve edges as capsules: all of a rounded cube that can touch a plane while it does not lie
        # flat.
        inner = half - cube.rounding
        corners = inner * np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
        pairs = [
            (a, b) for a in corners for b in corners if np.count_nonzero(a != b) == 1 and tuple(a) < tuple(b)
        ]
        ends = (" ".join(str(value) for value in (*a, *b)) for a, b in pairs)
        shape = "".join(f'<geom type="capsule" size="{cube.rounding}" fromto="{end}"/>' for end in ends)
    return f"""
<mujoco>
  <option timestep="{1 / RATE / STEPS}" gravity="0 0 -{G}" cone="elliptic" impratio="10"
          integrator="implicitfast"/>
  <default>
    <geom friction="{cube.friction} 0 0" condim="3" solref="0.002 0.6" solimp="0.95 0.99 0.0005"/>
  </default>
  <worldbody>
    <geom type="plane" size="5 5 0.1"/>
    <body><freejoint/>
      <inertial pos="{com}" mass="{MASS}" diaginertia="{moments}"/>
      {shape}
    </body>
  </worldbody>
</mujoco>"""
