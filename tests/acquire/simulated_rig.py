"""Session in the virtual rig's physics without images, buses or wall clock.

The session's own state machine strikes, and the analysis judges.

The motor and its control loop are the virtual servo's; the rule that turns the arm back is the striker's own,
fed a read per millisecond. The pose at 120 frames per second, with a frame's noise, goes through the analysis
that `analyze watch` runs, so that the session gets the same verdicts. The ground truth is kept apart.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from acquire.session import actions, events
from acquire.session.machine import SessionMachine
from acquire.striker.detector import ContactDetector
from acquire.striker.gains import POSITION_P_GAIN
from acquire.striker.sample import (
    ACCELERATION_UNIT_RAD_S2,
    TICK_RAD,
    VELOCITY_UNIT_RAD_S,
    Sample,
)
from acquire.striker.servo import CURRENT_BASED_POSITION, RUN_THROUGH_RAD
from acquire.virtual.dynamixel_motor import ZERO_TICKS, Motor
from acquire.virtual.dynamixel_registers import Registers
from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.operator import POSITION_SD_M, STAND_SD_M, YAW_SD_RAD
from acquire.virtual.station import ARM_INERTIA_KG_M2, ARM_LENGTH_M, G_M_S2, TABLE_FRICTION
from acquire.virtual.world import World
from acquire.virtual.world_state import StrikerContact, WorldState
from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.motion.settings import MotionSettings
from analyze.motion.strike import analyse_motion, verdict_of
from analyze.motion.strike_task import StrikeTask
from analyze.motion.tip_angle import PlanarMotion
from analyze.pipeline.sections import next_face_angle
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import prepare_object
from analyze.types import TipAngle, TipMotion
from schemas.object_spec import object_sha256
from schemas.rig import StrikerConfig
from schemas.servo_models import SERVO_MODELS
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.watch_lines import StrikeVerdict

SERVO = SERVO_MODELS["XM430-W210"]
FRAME_NS = 8_333_333
ANGLE_SD = math.radians(0.03)
"""standard deviation of the angle per frame [rad], as with a tag of 80 px"""
SPEED_SD = 0.01
"""relative standard deviation of the tip speed that the striker reports (`make bench-striker`)"""
CONTACT_TIME_SD_NS = 2e5
RETRACT_RAD = 0.15
BACK_RAD = math.radians(0.4)
PAST_RAD = 0.5
MS = 1_000_000
STRIKER = StrikerModel(effective_mass_kg=ARM_INERTIA_KG_M2 / ARM_LENGTH_M**2, restitution=0.4)
"""striker of the virtual rig's file"""


def wrong_striker_prior(rng: np.random.Generator) -> StrikerModel:
    """Striker whose effective mass and restitution are off by draws from the rig file's uncertainties."""
    mass = STRIKER.effective_mass_kg * math.exp(
        rng.normal(0.0, STRIKER.effective_mass_sd_kg / STRIKER.effective_mass_kg)
    )
    return replace(
        STRIKER,
        effective_mass_kg=mass,
        restitution=float(np.clip(rng.normal(0.4, STRIKER.restitution_sd), 0.05, 0.8)),
    )


@dataclass(frozen=True)
class Attempt:
    """One strike: command, measurements and true values."""

    axis_id: str
    command_m_s: float
    speed_m_s: float
    """true tip speed at first contact"""
    energy: float
    """true energy ratio E; 0 if the object was not met"""
    contacts: int
    impulse_n_s: float
    verdict: StrikeVerdict
    motion: TipMotion
    """analysed motion"""


thing_of = functools.cache(load_object)
"""virtual object by name and seed; cached, because it is immutable"""


@functools.cache
def model_of(name: str) -> ObjectModel:
    """Shape model from the object's files."""
    thing = thing_of(name, 1)
    shape = thing.shape_file or ("", None)
    return load_object_model(thing.spec, shape[1], shape[0])


@functools.cache
def plan_for(
    name: str, strikes: int = 9, striker: StrikerModel = STRIKER, most_axes: int | None = None
) -> StrikePlan:
    """Plan that `analyze plan` makes for the object `name` and a striker, without its true masses."""
    thing = thing_of(name, 1)
    shape = thing.shape_file or ("", None)
    prepared = prepare_object(
        model_of(name), thing.spec, Bench(striker, view.default_camera(), TABLE_FRICTION[0])
    )
    return plan_strikes(
        prepared, object_sha256(thing.spec, shape[1]), PlanRequest(strikes, most_axes=most_axes)
    )


class ServoArm:
    """Motor of the arm with the host that swings the arm and turns it back at contact."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._motor, self._registers = Motor(SERVO), Registers(1, 1, "XM430-W210")
        self._config = StrikerConfig()
        self._registers["Operating Mode"] = CURRENT_BASED_POSITION
        self._registers["Goal Current"] = round(self._config.current_limit_a / SERVO.current_unit_a)
        self._registers["Position P Gain"] = POSITION_P_GAIN
        self._registers["Torque Enable"] = 1
        self._motor.hold(self._config.cocked_angle_rad)
        self._go(self._config.cocked_angle_rad, 0.8, 8.0)
        self._detector: ContactDetector | None = None
        self._turn_ns = 0

    def swing(self, tip_speed_m_s: float) -> None:
        """Start a swing at the commanded tip speed [m/s]."""
        velocity = tip_speed_m_s / ARM_LENGTH_M
        self._go(RUN_THROUGH_RAD, velocity, 0.0)
        self._detector, self._turn_ns = ContactDetector(ARM_LENGTH_M, velocity), 0

    def __call__(self, position: float, velocity: float, time_ns: int) -> float:
        """Motor torque [N m] for the next millisecond, from arm angle [rad], velocity [rad/s], time [ns]."""
        torque = self._motor.step(self._registers, position, velocity, 1e-3)
        if self._detector is not None:
            shown = (
                round(position / TICK_RAD) * TICK_RAD,
                round(self._motor.velocity / VELOCITY_UNIT_RAD_S) * VELOCITY_UNIT_RAD_S,
            )
            if not self._turn_ns and self._detector.must_turn_back(Sample(time_ns, time_ns, 0, *shown, 0.0)):
                self._turn_ns = time_ns + int(
                    self._rng.uniform(0.5, 2.5) * MS
                )  # the order's way over the bus
            if self._turn_ns and time_ns >= self._turn_ns:
                self._go(-RETRACT_RAD, 0.0, 0.0)
                if position < -0.7 * RETRACT_RAD:
                    self._go(self._config.cocked_angle_rad, 1.6, 16.0)
                    self._detector = None
        return torque

    def _go(self, angle: float, velocity: float, acceleration: float) -> None:
        self._registers["Profile Acceleration"] = round(acceleration / ACCELERATION_UNIT_RAD_S2)
        self._registers["Profile Velocity"] = max(1, round(velocity / VELOCITY_UNIT_RAD_S)) if velocity else 0
        self._registers["Goal Position"] = ZERO_TICKS + round(angle / TICK_RAD)


@dataclass
class SimulatedRig:
    """Simulated table with one virtual object and the striker's arm, on which a session strikes."""

    thing: VirtualObject
    rng: np.random.Generator
    attempts: list[Attempt] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._arm = ServoArm(self.rng)
        shape = self.thing.shape_file or ("", None)
        self._model = load_object_model(self.thing.spec, shape[1], shape[0])
        self._states: list[WorldState] = []
        self._contacts: list[StrikerContact] = []
        self._world = World(
            self.thing,
            self._arm,
            on_tick=self._states.append,
            on_contact=self._contacts.append,
            arm_angle=-0.6,
        )
        self._yaw = 0.0

    def run(self, machine: SessionMachine) -> list[Attempt]:
        """Run a whole session and return its strikes."""
        event: events.Event = events.Started()
        struck: PlannedStrike | None = None
        while True:
            match machine.handle(event)[-1]:
                case actions.AskToPlace(strike=strike):
                    struck = strike
                    self.place(strike)
                    event = events.Placed()
                case actions.CheckPose():
                    event = events.PoseChecked(good=True)
                case actions.Arm():
                    event = events.Ready()
                case actions.Strike(strike=strike, tip_speed_m_s=speed):
                    attempt = self.strike(strike, speed)
                    self.attempts.append(attempt)
                    reported = attempt.speed_m_s * (1 + self.rng.normal(0.0, SPEED_SD))
                    event = events.Struck(1, CONTACT_TIME_SD_NS, reported, 1)
                case actions.RecordUntilRest():
                    event = events.Recorded(1, 2, 100, 0)
                case actions.Judge():
                    event = events.Judged(self.attempts[-1].verdict)
                case actions.CloseRecording():
                    return self.attempts
                case other:
                    raise AssertionError(f"{other} for {struck}")

    def place(self, strike: PlannedStrike) -> None:
        """Place the object with the virtual operator's errors."""
        rng = self.rng
        yaw = self._yaw = float(rng.normal(0.0, YAW_SD_RAD))
        turn = Rotation.from_euler("z", yaw).as_matrix()
        shift = np.array([*rng.normal(0.0, POSITION_SD_M, 2), 0.0])
        R, p = np.array(strike.R_world_object), np.array(strike.p_world_object)
        impact = turn @ (R @ np.array(strike.impact.point) + p) + shift
        impact += np.array([-abs(rng.normal(0.0, STAND_SD_M)), 0.0, rng.normal(0.0, STAND_SD_M)])
        impact[1] = 0.0
        self._world.place(turn @ R, turn @ p + shift, impact)

    def strike(self, strike: PlannedStrike, tip_speed_m_s: float) -> Attempt:
        """Strike once and judge the motion: settle, swing, observe, analyse."""
        world = self._world
        end = world.time_ns + 3000 * MS
        while not (world.at_rest and abs(world.arm()[0] + 0.6) < 0.01) and world.time_ns < end:
            world.step_to(world.time_ns + 10 * MS)
        self._states.clear()
        self._contacts.clear()
        world.step_to(world.time_ns + 150 * MS)
        self._arm.swing(tip_speed_m_s)
        tip = _Tip(self.thing, strike, self._states[0], self._yaw)
        released = world.time_ns
        while world.time_ns < released + 2200 * MS:
            world.step_to(world.time_ns + 10 * MS)
            theta = float(tip.theta(self._states[-1:])[0])
            since = world.time_ns - (self._contacts[0].time_ns if self._contacts else world.time_ns)
            if theta > tip.phi + PAST_RAD or (since > 250 * MS and theta < BACK_RAD) or since > 1500 * MS:
                break
        return self._seen(strike, tip, tip_speed_m_s)

    def _seen(self, strike: PlannedStrike, tip: _Tip, command: float) -> Attempt:
        contact_ns = self._contacts[0].time_ns if self._contacts else 0
        before = [state for state in self._states if state.time_ns <= contact_ns]
        speed = before[-1].arm_velocity * ARM_LENGTH_M if before else 0.0
        motion = tip.motion(self._states[:: round(FRAME_NS / MS)], self.rng)
        heard = contact_ns + int(self.rng.normal(0.0, CONTACT_TIME_SD_NS)) if contact_ns else 0
        landing_angle_rad = next_face_angle(self._model, strike)
        task = StrikeTask(
            f"{strike.id}.{len(self.attempts) + 1}", strike, heard, landing_angle_rad=landing_angle_rad
        )
        found = analyse_motion(motion, task, MotionSettings())
        verdict = verdict_of(found)
        energy = tip.energy(
            [state for state in self._states if contact_ns and state.time_ns > contact_ns + 30 * MS]
        )
        impulse = sum(contact.impulse_n_s for contact in self._contacts)
        return Attempt(strike.axis_id, command, speed, energy, len(self._contacts), impulse, verdict, found)


class _Tip:
    """True values of one tip: balance angle phi [rad], energy needed to reach it, angle over time."""

    def __init__(self, thing: VirtualObject, strike: PlannedStrike, rest: WorldState, yaw: float) -> None:
        self._thing, self._rest = thing, rest
        (self._R0,) = _rotations([rest])
        self._axis = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
        self._pivot, self._radius = np.array(strike.pivot.point), strike.pivot.radius_m
        arm = self._R0 @ (thing.body.com_object - self._pivot)
        forward = -float(arm @ np.cross(self._axis, [0.0, 0.0, 1.0]))
        self.phi = math.atan2(forward, float(arm[2]))
        weight = thing.body.mass_kg * G_M_S2
        reach = math.hypot(forward, float(arm[2]))
        self._needed = weight * (reach - float(arm[2]))
        self._at_rest = weight * float((rest.p_world_object + self._R0 @ thing.body.com_object)[2])

    def theta(self, states: list[WorldState]) -> np.ndarray:
        """Angle (n,) [rad] about the pivot axis since rest."""
        return Rotation.from_matrix(_rotations(states) @ self._R0.T).as_rotvec() @ self._axis

    def energy(self, states: list[WorldState]) -> float:
        """Median of kinetic plus potential energy on the way up, over the energy needed to reach balance.

        It is 0 if the object turned by less than 0.2 degrees.
        """
        if not states:
            return 0.0
        theta = self.theta(states)
        if theta.max() < math.radians(0.2):
            return 0.0
        top = int(np.argmax(theta > self.phi)) if theta.max() > self.phi else int(np.argmax(theta))
        return float(np.median(self._energies(states[: max(top, 1)])))

    def _energies(self, states: list[WorldState]) -> np.ndarray:
        body, A = self._thing.body, _rotations(states)
        c = A @ body.com_object
        turning = np.array([state.angular_velocity for state in states])
        v = np.array([state.linear_velocity for state in states]) + np.cross(turning, c)
        w = np.einsum("nij,ni->nj", A, turning)
        kinetic = 0.5 * body.mass_kg * np.sum(v * v, axis=1) + 0.5 * np.einsum(
            "ni,ij,nj->n", w, body.inertia_com, w
        )
        height = np.array([state.p_world_object[2] for state in states]) + c[:, 2]
        return (kinetic + body.mass_kg * G_M_S2 * height - self._at_rest) / self._needed

    def motion(self, states: list[WorldState], rng: np.random.Generator) -> PlanarMotion:
        """Motion, with noise, that a camera looking along the pivot axis would measure for true states."""
        n = len(states)
        A = _rotations(states)
        turned = Rotation.from_matrix(A @ self._R0.T).as_rotvec()
        start = self._rest.p_world_object + self._R0 @ self._pivot
        moved = np.array([state.p_world_object for state in states]) + A @ self._pivot - start
        along = np.cross(self._axis, [0.0, 0.0, 1.0])
        theta = turned @ self._axis
        sd = np.full(n, ANGLE_SD)
        angle = TipAngle(
            np.array([state.time_ns for state in states]),
            theta + rng.normal(0.0, ANGLE_SD, n),
            sd,
            np.linalg.norm(turned - theta[:, None] * self._axis, axis=1),
            moved @ along - self._radius * theta,
            1e-4,
        )
        small = np.full(n, 1e-4)
        return PlanarMotion(
            angle,
            moved[:, 2],
            small,
            np.full(n, 1e-3),
            0.0,
            np.repeat(np.diag([1e-8, 1e-10, 1e-10])[None], n, axis=0),
        )


def _rotations(states: list[WorldState]) -> np.ndarray:
    """Rotations (n, 3, 3) of the object, from its frame to the world's, in n states."""
    return Rotation.from_quat(
        np.array([state.q_world_object_wxyz for state in states])[:, [1, 2, 3, 0]]
    ).as_matrix()
