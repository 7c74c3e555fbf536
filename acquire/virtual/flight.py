"""A toss in the simulated world: the object held by a hand, in the air, and on a cushion.

In the air the object moves by Newton's and Euler's laws under gravity and the air's drag, in Runge-Kutta
steps of fourth order; the drag is that of the middle of each step. The table's plane serves as the cushion:
during a toss it lies lower or higher, is soft, and is met by a falling object only. Not modelled: the hand's
acceleration (the object is held still and then has its velocity at once), the hand and the cushion in the
images.
"""
# mujoco takes its names from a compiled module that pyright cannot analyse.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from acquire.virtual.air_drag import AirDrag
from acquire.virtual.world_model import TIMESTEP_S

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.moving_contents import MovingContents
    from acquire.virtual.objects import VirtualObject
    from acquire.virtual.toss import TossMotion

FREE_STEP_S = 0.0005
"""time step in the air [s]"""
CUSHION_CONTACT = ((0.04, 1.0), (0.9, 0.95, 0.01))
"""MuJoCo's solref and solimp of the cushion: soft, 40 ms, critically damped"""
CUSHION_FRICTION = (1.0, 0.01, 0.01)
"""sliding, torsional [m] and rolling [m] friction of the cushion: it is dented, and a can soon lies still"""

_MIDPHASE = int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)


class Flight:
    """One toss after the other of one object in a world's model; `begin` starts one.

    Args:
        virtual_object: the object.
        model: the world's MuJoCo model.
        data: its state.
        inside: what moves inside the object.
    """

    def __init__(
        self,
        virtual_object: VirtualObject,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        inside: MovingContents,
    ) -> None:
        body = virtual_object.rigid_body
        self._com = np.array(body.com_object)
        self._whole_com = np.array(virtual_object.body.com_object)
        self._inertia = np.array(body.inertia_com)
        self._inverse = np.linalg.inv(self._inertia)
        self._drag = AirDrag(
            virtual_object.mesh_vertices,
            virtual_object.mesh_faces,
            self._com,
            virtual_object.drag_coefficient,
        )
        self._model, self._data, self._inside = model, data, inside
        self._gravity = np.array(model.opt.gravity)
        self._table_frame = int(model.geom_sameframe[model.geom("table").id])
        self._table, self._object = model.geom("table").id, model.body("object").id
        self._matrix = np.zeros(9)
        self._motion: TossMotion | None = None
        self.release_ns: int | None = None
        """world time at which the hand lets go [ns]; None if the object is not held"""
        self._rising_s = 0.0
        self.touched = False
        """True once the tossed object has touched the cushion"""

    @property
    def under_way(self) -> bool:
        """True from `begin` to `end`: the object is held, flies or lies on the cushion."""
        return self._motion is not None

    def begin(self, motion: TossMotion, release_ns: int) -> None:
        """Hold the object still in the air, until the world time `release_ns` [ns]."""
        self.end()
        self._motion, self.release_ns, self.touched = motion, release_ns, False
        model, table = self._model, self._table
        self._table_is = (
            model.geom_solref[table].copy(),
            model.geom_solimp[table].copy(),
            model.geom_friction[table].copy(),
        )
        model.geom_pos[table, 2] = motion.cushion_z
        model.geom_sameframe[table] = 0  # otherwise the position is taken from the body's
        model.opt.disableflags |= _MIDPHASE  # its boxes are those of the table's place in the model
        model.geom_solref[table] = CUSHION_CONTACT[0]
        model.geom_solimp[table, :3] = CUSHION_CONTACT[1]
        model.geom_friction[table] = CUSHION_FRICTION
        model.geom_condim[table] = 6
        model.geom_contype[table] = 0
        self._rising_s = float(motion.velocity_world[2] / -self._gravity[2])
        data = self._data
        x, y, z, w = Rotation.from_matrix(motion.R_world_object).as_quat()
        data.qpos[0:3] = motion.p_world_com - motion.R_world_object @ self._whole_com
        data.qpos[3:7] = (w, x, y, z)
        data.qvel[0:6] = 0.0
        self._inside.settle(motion.R_world_object)
        data.qacc_warmstart[:] = 0.0
        mujoco.mj_forward(model, data)

    def release(self) -> None:
        """Let the object go with the velocity of the toss."""
        if self._motion is None:
            return
        turning = self._motion.R_world_object @ self._motion.rate_object
        arm = self._motion.R_world_object @ self._whole_com
        self._data.qvel[0:3] = self._motion.velocity_world - np.cross(turning, arm)
        self._data.qvel[3:6] = self._motion.rate_object
        self.release_ns = None

    def step(self, duration_s: float) -> None:
        """Step object and arm by a duration [s], a multiple of both time steps."""
        self._rising_s -= duration_s
        if self._rising_s < 0:
            self._model.geom_contype[self._table] = 1
        option = self._model.opt
        free = self._data.ncon == 0
        self.touched = self.touched or not free
        option.integrator = (
            mujoco.mjtIntegrator.mjINT_RK4 if free else mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        )
        option.timestep = FREE_STEP_S if free else TIMESTEP_S
        for _ in range(round(duration_s / option.timestep)):
            self._apply_drag(option.timestep)
            self._inside.step()

    def end(self) -> None:
        """Put the table back where it was; without a toss under way nothing happens."""
        if self._motion is None:
            return
        model, table = self._model, self._table
        model.geom_pos[table, 2], model.geom_sameframe[table] = 0.0, self._table_frame
        model.geom_solref[table], model.geom_solimp[table], model.geom_friction[table] = self._table_is
        model.opt.disableflags &= ~_MIDPHASE
        model.geom_condim[table], model.geom_contype[table] = 3, 1
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, TIMESTEP_S
        self._data.xfrc_applied[self._object] = 0.0
        self._motion = self.release_ns = None

    def _apply_drag(self, timestep_s: float) -> None:
        """Apply the air's force in the middle of the next time step [s] to the object."""
        velocity = self._data.qvel
        mujoco.mju_quat2Mat(self._matrix, self._data.qpos[3:7])
        R, rate = self._matrix.reshape(3, 3), velocity[3:6]
        half = 0.5 * timestep_s
        later = rate - half * (self._inverse @ _cross(rate, self._inertia @ rate))
        middle = R + R @ _cross_matrix(half * later)
        of_com = velocity[0:3] + R @ _cross(rate, self._com) + half * self._gravity
        wrench = self._drag.wrench(of_com @ middle, later)
        applied = self._data.xfrc_applied[self._object]
        applied[:3], applied[3:] = middle @ wrench[:3], middle @ wrench[3:]


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cross product (3,) of two vectors (3,); numpy's own takes ten times as long for so few numbers."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _cross_matrix(a: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrix (3, 3) of the cross product with a vector (3,)."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
