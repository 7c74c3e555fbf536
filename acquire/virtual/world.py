"""Simulated world: one object on a table and the striker's arm, stepped by the host's monotonic clock.

A function given by the caller computes the torque of the arm's motor once per millisecond. While the object
is at rest out of the striker's reach only the arm is integrated, so that an idle world costs almost nothing
and the object does not creep.

Frames: W (world, z up, table at z = 0) and O (the object's shape file). The arm's angle is 0 when it hangs,
positive towards W's +x.
"""
# mujoco takes its names from a compiled module that pyright cannot analyse.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

import mujoco
import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from acquire.errors import AcquireError
from acquire.virtual.contact_shape import contact_centres
from acquire.virtual.flight import Flight
from acquire.virtual.moving_contents import MovingContents
from acquire.virtual.station import ARM_LENGTH_M, G_M_S2, TIP_RADIUS_M
from acquire.virtual.world_contact import OpenContact, Push
from acquire.virtual.world_model import ARM_DAMPING, ARM_MASS_KG, TIMESTEP_S, model_xml
from acquire.virtual.world_state import StrikerContact, WorldState

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject
    from acquire.virtual.toss import TossMotion

Motor = Callable[[float, float, int], float]
"""torque on the arm [N m] as a function of its angle [rad], velocity [rad/s] and the world time [ns]"""

TICK_NS = 1_000_000
"""period of calls of the motor, and of `on_tick` [ns]"""
_SUBSTEPS = round(TICK_NS * 1e-9 / TIMESTEP_S)
_NEAR_M = 0.002
"""clearance below which every time step is examined for contact [m]"""
_REST_SPEED, _REST_RATE, _REST_TICKS = 2e-4, 2e-3, 200
"""an object slower than _REST_SPEED [m/s] and _REST_RATE [rad/s] for _REST_TICKS ms is at rest"""
_CALM_TICKS = 1000
"""time for which an object is still before it is at rest although contents move in it [ms]"""
_CONTACT_GAP_NS = 2_000_000
"""longest time without force within one contact [ns]"""
_DROP_M = 0.0001
"""height from which an object is released [m]"""


class World:
    """Physics of object, table and striker's arm, stepped by `step_to`. Not thread-safe: one loop owns it.

    At the start the object stands on the table, turned as in its shape file, with the file's origin on the z
    axis of W (the world frame: z up, table at z = 0).

    Args:
        virtual_object: the object.
        motor: torque of the arm's motor [N m] as a function of arm angle [rad], arm velocity [rad/s] and
            world time [ns]; called once per millisecond.
        start_ns: world time at the start (host monotonic) [ns].
        on_tick: called with the state after every millisecond.
        on_contact: called with every completed contact of the striker's tip with the object, and with every
            completed push.
        table_tilt: (2,) rotation of gravity against the table's normal about W's x and y [rad].
        arm_angle: initial angle of the arm [rad], 0 when it hangs, positive towards W's +x.
        table_restitution: coefficient of restitution of a contact with the table, 0 to 0.9.
    """

    def __init__(
        self,
        virtual_object: VirtualObject,
        motor: Motor,
        start_ns: int = 0,
        on_tick: Callable[[WorldState], None] = lambda _state: None,
        on_contact: Callable[[StrikerContact], None] = lambda _contact: None,
        table_tilt: tuple[float, float] = (0.0, 0.0),
        arm_angle: float = -0.5,
        table_restitution: float = 0.0,
    ) -> None:
        self._thing = virtual_object
        self._motor = motor
        self._on_tick = on_tick
        self._on_contact = on_contact
        gravity = Rotation.from_rotvec([*table_tilt, 0.0]).apply([0.0, 0.0, -G_M_S2])
        self._model = mujoco.MjModel.from_xml_string(model_xml(virtual_object, gravity, table_restitution))
        self._data = mujoco.MjData(self._model)
        self._qpos, self._qvel = self._data.qpos, self._data.qvel
        self._centres = contact_centres(virtual_object)
        self._planes = np.unique(np.round(ConvexHull(virtual_object.hull_vertices).equations, 9), axis=0)
        self._arm_body = self._model.body("arm").id
        self._object_body = self._model.body("object").id
        self._tip = self._model.geom("tip").id
        self._push: Push | None = None
        hinge = self._model.joint("arm")
        self._arm_q, self._arm_v = int(hinge.qposadr[0]), int(hinge.dofadr[0])
        self._inside = MovingContents(virtual_object.contents, self._model, self._data)
        self._flight = Flight(virtual_object, self._model, self._data, self._inside)
        self._force = np.zeros(6)
        self.time_ns = start_ns
        self._at_rest = False
        self._slow_ticks = 0
        self._contact: OpenContact | None = None
        self._gap_at_rest = (0.0, -np.inf)
        self._arm_gravity = float(-gravity[2]) * ARM_MASS_KG * ARM_LENGTH_M / 2
        self._data.qpos[self._arm_q] = arm_angle
        low = self._thing.hull_vertices.min(axis=0)
        self.place(np.eye(3), -np.array([0.0, 0.0, low[2]]), np.array([low[0], 0.0, -0.5 * low[2]]))

    # --- operator

    def place(
        self,
        R_world_object: NDArray[np.float64],
        p_world_object: NDArray[np.float64],
        impact_point_world: NDArray[np.float64],
    ) -> None:
        """Place the object, and set the arm's stand so that the hanging arm's tip touches the impact point.

        The object is released at rest a tenth of a millimetre over the table, whatever height is given. The
        arm keeps its angle. The tip passes through the object until it has once been clear of it by 2 mm,
        because the stand is moved in after the object.

        Args:
            R_world_object: (3, 3) rotation from O, the object's frame, to W, the world frame.
            p_world_object: (3,) position of the object's origin in W [m]; z is replaced.
            impact_point_world: (3,) point on the object's surface in W [m]; the tip moves along +x there.

        Raises:
            AcquireError: R_world_object is not a rotation.
        """
        R = np.asarray(R_world_object, dtype=float)
        if R.shape != (3, 3) or not np.allclose(R @ R.T, np.eye(3), atol=1e-4) or np.linalg.det(R) < 0:
            raise AcquireError(
                "virtual world: R_world_object is not a rotation matrix: "
                "give an orthonormal 3 x 3 matrix with determinant +1"
            )
        self._flight.end()
        data = self._data
        x, y, z, w = Rotation.from_matrix(R).as_quat()
        lowest = float((self._centres @ R[2]).min()) - self._thing.edge_radius_m
        data.qpos[0:3] = p_world_object
        data.qpos[2] = _DROP_M - lowest
        data.qpos[3:7] = (w, x, y, z)
        data.qvel[0:6] = 0.0
        self._inside.settle(R)
        data.qacc_warmstart[:] = 0.0
        hinge = np.asarray(impact_point_world, dtype=float) + np.array([-TIP_RADIUS_M, 0.0, ARM_LENGTH_M])
        self._model.body_pos[self._arm_body] = hinge
        self._model.geom_contype[self._tip] = 0
        self._at_rest, self._slow_ticks, self._contact = False, 0, None
        mujoco.mj_forward(self._model, data)

    def push(
        self, p_world: NDArray[np.float64], impulse_world: NDArray[np.float64], duration_s: float
    ) -> None:
        """Start to push the object like a finger: a half-sine of force over time, in steps of 1 ms.

        The force keeps its direction in W and acts at a point that moves with the object. When the push is
        complete, `on_contact` is called.

        Args:
            p_world: (3,) point of contact in W (world frame) [m].
            impulse_world: (3,) total impulse in W [N s].
            duration_s: duration of the contact [s], 0.002 to 0.1, rounded to whole milliseconds.

        Raises:
            AcquireError: the duration is out of range, or another push is under way.
        """
        ticks = round(duration_s * 1e9 / TICK_NS)
        if not 2 <= ticks <= 100 or self._push is not None:
            raise AcquireError(
                f"virtual world: a push of {duration_s} s cannot begin now: give 0.002 to 0.1 s, "
                "one at a time"
            )
        weights = np.sin(np.pi * (np.arange(ticks) + 0.5) / ticks)
        impulse = np.array(impulse_world, dtype=float)
        forces = impulse * (weights / (weights.sum() * TICK_NS * 1e-9))[:, None]
        position = np.array(p_world, dtype=float)
        self._push = Push(
            first_ns=self.time_ns,
            forces=deque(forces),
            p_object=_rotate(self._qpos[3:7] * (1, -1, -1, -1), position - self._qpos[0:3]),
            position=position,
            impulse=float(np.linalg.norm(impulse)),
            duration_s=duration_s,
        )

    def toss(self, motion: TossMotion, hold_s: float) -> None:
        """Hold the object still in the air for `hold_s` [s], then toss it; it falls on a cushion.

        The cushion takes the table's place until the next placing, and the arm's tip passes through the
        object. The air acts on the object in a toss only.
        """
        self._flight.begin(motion, self.time_ns + round(hold_s * 1e9))
        self._model.geom_contype[self._tip] = 0
        self._push, self._contact, self._at_rest, self._slow_ticks = None, None, True, 0

    def let_go(self, time_ns: int) -> None:
        """Toss the object that is held at a world time [ns]; nothing happens if none is held."""
        if self._flight.release_ns is not None:
            self._flight.release_ns = time_ns

    # --- time

    def step_to(self, time_ns: int) -> None:
        """Step by whole milliseconds, the last ending at or before `time_ns` (host monotonic time)."""
        while self.time_ns + TICK_NS <= time_ns:
            self._tick()

    @property
    def at_rest(self) -> bool:
        """True if the object came to rest (slow for 0.2 s, untouched) and was not disturbed since.

        The arm may move.
        """
        return self._at_rest

    @property
    def has_landed(self) -> bool:
        """True once an object that was tossed has touched the cushion."""
        return self._flight.touched

    def arm(self) -> tuple[float, float]:
        """Arm's angle [rad], 0 hanging, positive towards the world's +x, and its angular velocity [rad/s]."""
        return float(self._qpos[self._arm_q]), float(self._qvel[self._arm_v])

    def state(self) -> WorldState:
        """State of object and arm at the end of the last step; its arrays are copies."""
        q = self._qpos[3:7].copy()
        return WorldState(
            self.time_ns,
            self._qpos[0:3].copy(),
            q,
            self._qvel[0:3].copy(),
            _rotate(q, self._qvel[3:6]),
            *self.arm(),
            self._model.body_pos[self._arm_body].copy(),
            self._at_rest,
        )

    def _tick(self) -> None:
        angle, velocity = self.arm()
        torque = self._motor(angle, velocity, self.time_ns)
        reach = _NEAR_M + 2e-3 * ARM_LENGTH_M * abs(velocity)
        gap = self._gap_at_rest[1] - ARM_LENGTH_M * abs(angle - self._gap_at_rest[0])
        if self._flight.under_way:
            self._tick_toss(torque)
        elif self._push is None and self._at_rest and gap > reach:
            self._swing(torque)
        else:
            self._tick_near(torque, reach)
        self.time_ns += TICK_NS
        self._close_contact()
        self._on_tick(self.state())

    def _tick_near(self, torque: float, reach: float) -> None:
        """Step one tick (1 ms), after measuring the gap between the striker's tip and the object.

        Arm and object are stepped if the object moves or is pushed, or if the gap is less than `reach` [m].
        Otherwise only the arm is. After a placing the tip passes through the object until it was clear of it;
        until then the gap does not count. `torque` is the motor's torque on the arm [N m].
        """
        data = self._data
        clearance = self._clearance()
        if self._model.geom_contype[self._tip] == 0 and clearance > _NEAR_M:
            self._model.geom_contype[self._tip] = 2
        near = self._model.geom_contype[self._tip] == 2 and clearance < reach
        pushed = self._apply_push()
        if self._at_rest and not near and not pushed:
            self._gap_at_rest = (float(self._qpos[self._arm_q]), clearance)
            self._swing(torque)
            return
        self._at_rest = False
        data.qfrc_applied[self._arm_v] = torque
        if near:
            for i in range(_SUBSTEPS):
                self._inside.step()
                self._accumulate_contact(self.time_ns + (i + 1) * (TICK_NS // _SUBSTEPS))
        else:
            self._inside.step(_SUBSTEPS)
        self._update_rest(near=near or pushed)

    def _tick_toss(self, torque: float) -> None:
        """Step one tick of a toss: only the arm while the object is held or lies on the cushion."""
        if self._flight.release_ns is not None and self.time_ns >= self._flight.release_ns:
            self._flight.release()
            self._at_rest, self._slow_ticks = False, 0
        if self._at_rest:
            self._swing(torque)
            return
        self._data.qfrc_applied[self._arm_v] = torque
        self._flight.step(TICK_NS * 1e-9)
        self._update_rest(near=False)

    def _apply_push(self) -> bool:
        """Apply the force of a push under way to the object for this millisecond; True if a force acts.

        In the millisecond after its last force the push is removed and reported as a contact, and the result
        is False.
        """
        push = self._push
        applied = self._data.xfrc_applied[self._object_body]
        applied[:] = 0.0
        if push is None:
            return False
        if not push.forces:
            self._push = None
            self._on_contact(StrikerContact(push.first_ns, push.impulse, push.position, push.duration_s))
            return False
        arm = self._qpos[0:3] + _rotate(self._qpos[3:7], push.p_object) - self._data.xipos[self._object_body]
        force = push.forces.popleft()
        applied[:3], applied[3:] = force, np.cross(arm, force)
        return True

    def _swing(self, torque: float) -> None:
        """Integrate the arm alone over a tick (1 ms) under the motor's torque [N m].

        Semi-implicit Euler steps of I a'' = torque - damping a' - m g l/2 sin a, with a the arm's angle [rad]
        from hanging, I its moment of inertia about the hinge, m its mass and l its length.
        """
        angle, velocity = self.arm()
        for _ in range(_SUBSTEPS):
            acceleration = (torque - self._arm_gravity * math.sin(angle)) / self._thing.arm_inertia_kg_m2
            velocity = (velocity + TIMESTEP_S * acceleration) / (
                1 + TIMESTEP_S * ARM_DAMPING / self._thing.arm_inertia_kg_m2
            )
            angle += TIMESTEP_S * velocity
        self._qpos[self._arm_q], self._qvel[self._arm_v] = angle, velocity

    def _clearance(self) -> float:
        """Lower bound of the gap [m] between the sphere of the arm's tip and the object's convex hull.

        Negative if they overlap.
        """
        angle = float(self._qpos[self._arm_q])
        hanging = np.array([math.sin(angle), 0.0, -math.cos(angle)])
        centre = self._model.body_pos[self._arm_body] + ARM_LENGTH_M * hanging
        in_object = _rotate(self._qpos[3:7] * (1, -1, -1, -1), centre - self._qpos[0:3])
        return float((self._planes[:, :3] @ in_object + self._planes[:, 3]).max()) - TIP_RADIUS_M

    def _update_rest(self, *, near: bool) -> None:
        velocity = self._data.qvel
        slow = np.abs(velocity[0:3]).max() < _REST_SPEED and np.abs(velocity[3:6]).max() < _REST_RATE
        self._slow_ticks = self._slow_ticks + 1 if slow and not near else 0
        if self._slow_ticks >= (_REST_TICKS if self._inside.at_rest else _CALM_TICKS):
            self._at_rest = True
            self._gap_at_rest = (0.0, -np.inf)
            self._data.qvel[0:6] = 0.0
            self._inside.stop()

    def _accumulate_contact(self, now_ns: int) -> None:
        """Add the impulse of the striker tip's normal force in one time step to the contact's total impulse.

        `now_ns` is the end of the time step. The first force begins a contact.
        """
        data = self._data
        for i in range(data.ncon):
            contact = data.contact[i]
            if self._tip not in {contact.geom1, contact.geom2}:
                continue
            mujoco.mj_contactForce(self._model, data, i, self._force)
            if self._force[0] <= 0:
                continue
            if self._contact is None:
                first_ns = now_ns - self._contact_age_ns(float(contact.dist))
                self._contact = OpenContact(first_ns, 0.0, contact.pos.copy(), now_ns)
            self._contact.impulse += float(self._force[0]) * TIMESTEP_S
            self._contact.last_ns = now_ns

    def _contact_age_ns(self, distance: float) -> int:
        """Time [ns] from the tip's first touch of the object to the end of the present time step.

        It is one time step, plus the time (at most one more step) in which the tip, at its present speed,
        covers the penetration at the step's begin. `distance` is the signed gap [m] between tip and object at
        the step's begin, negative where they overlap.
        """
        speed = ARM_LENGTH_M * abs(float(self._qvel[self._arm_v]))
        return round(1e9 * (TIMESTEP_S + min(TIMESTEP_S, -distance / speed if speed > 0 else 0.0)))

    def _close_contact(self) -> None:
        contact = self._contact
        if contact is not None and self.time_ns - contact.last_ns > _CONTACT_GAP_NS:
            self._contact = None
            duration = (contact.last_ns - contact.first_ns) * 1e-9
            self._on_contact(StrikerContact(contact.first_ns, contact.impulse, contact.position, duration))


def _rotate(q_wxyz: NDArray[np.float64], vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Vector (3,) rotated by the unit quaternion (4,) (w, x, y, z)."""
    result = np.zeros(3)
    mujoco.mju_rotVecQuat(result, vector, q_wxyz)
    return result
