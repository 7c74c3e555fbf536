"""World process of the virtual rig: physics and servo in one real-time loop.

`python -m acquire.virtual.world_process --object carton --seed 1 --dir RUN` creates in RUN: `ttyDXL` or
`ttyBoard` (serial port of the servo or of the striker board), `pose.ring` (poses for the camera process),
`world.sock` (control socket: place, push and toss the object, read the state, unplug or overload the striker,
complete the truth file, quit) and `truth.bin` (true poses and contacts). Prints one JSON line when it is
ready. Ends on SIGTERM, on SIGINT, on the request "quit" and when its parent ends.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import os
import select
import signal
import socket
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from acquire.errors import AcquireError
from acquire.virtual.arm_devices import ARM_DEVICES, ArmSetting
from acquire.virtual.dynamixel_servo import HardwareError
from acquire.virtual.object_archive import open_object
from acquire.virtual.objects import VirtualObject
from acquire.virtual.pose_ring import PoseRing
from acquire.virtual.serial_board import SerialBoard
from acquire.virtual.station import station
from acquire.virtual.toss import TossKind, hand_toss
from acquire.virtual.truth_file import TruthWriter
from acquire.virtual.world import TICK_NS, World
from acquire.virtual.world_state import StrikerContact, WorldState
from schemas.planned_toss import PlannedToss
from schemas.proto import percuss_pb2 as pb
from schemas.servo_models import DEFAULT_MODEL, MODEL_NAMES, ModelName

STATISTICS_FILE = "world.json"
_IDLE_NS = 4_000_000
"""interval between wake-ups while nothing moves [ns]"""
_SLICE_NS = 10_000_000
"""simulated time between two readings of the servo's bus if the world has fallen behind [ns]"""
_STILL_RAD_S = 0.02
"""arm velocity below which the world counts as idle [rad/s], if the object rests too"""
_RESTING_POSE_TICKS = 50
"""the truth file holds every pose while the object moves, and one in this many while it rests"""
_PARENT_CHECK_NS = 500_000_000
_REQUEST_BYTES = 1 << 16


class WorldProcess:
    """World, servo, pose ring, truth file and control socket, stepped together.

    The pose ring (a memory-mapped ring buffer) gives the poses to the camera process; the truth file keeps
    true poses and contacts for the recording.

    Args:
        virtual_object: the object.
        seed: seed of servo noise and of the camera's calibration and pose; also written to the truth file.
        folder: folder for files and sockets.
        clock_ns: function that returns the world's time [ns], that of CLOCK_MONOTONIC.
        table_tilt: (2,) rotation of gravity about x and y of W, the world frame [rad].
        striker: name of the device that moves the arm, a key of ARM_DEVICES.
        servo: model of a servo.
    """

    def __init__(
        self,
        virtual_object: VirtualObject,
        seed: int,
        folder: Path,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        table_tilt: tuple[float, float] = (0.0, 0.0),
        striker: str = "dynamixel",
        servo: ModelName = DEFAULT_MODEL,
    ) -> None:
        self._clock_ns, self._folder = clock_ns, folder
        self._object = virtual_object
        self._hand = np.random.default_rng((seed, 0x7055))
        self._ring = PoseRing.create(folder / "pose.ring")
        self._truth = TruthWriter(folder / "truth.bin", truth_body(virtual_object, seed, table_tilt))
        self._ticks = 0
        self._stale_ns = 0
        """largest delay of the physics behind the servo's answers since the last request of the state [ns]"""
        self._most_stale_ns = 0
        """the same since the start [ns]"""
        self.world = World(
            virtual_object, self._torque, clock_ns(), self._log_pose, self._log_contact, table_tilt
        )
        setting = ArmSetting(virtual_object.arm_inertia_kg_m2, folder, seed, servo)
        self.servo = ARM_DEVICES[striker](self.world, clock_ns, setting)
        self._socket_path = folder / "world.sock"
        self._socket_path.unlink(missing_ok=True)
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(str(self._socket_path))
        self._socket_path.chmod(0o600)
        self._listener.listen(4)
        self._listener.setblocking(False)
        self._clients: dict[socket.socket, bytes] = {}
        self.stopped = False

    def close(self) -> None:
        """Close control socket, servo port and truth file; truth file and pose ring stay in the folder.

        The largest delay behind real time is written to `world.json` there.
        """
        for client in self._clients:
            client.close()
        self._listener.close()
        self._socket_path.unlink(missing_ok=True)
        self.servo.close()
        self._truth.close()
        with contextlib.suppress(OSError):  # the folder may be gone already
            (self._folder / STATISTICS_FILE).write_text(
                json.dumps({"latest_ms": self._most_stale_ns / 1e6}) + "\n", encoding="utf-8"
            )

    def run(self, parent_alive: Callable[[], bool]) -> None:
        """Step the simulated world in real time until `stopped` is set, or `parent_alive` returns False.

        The request "quit" sets `stopped`; `parent_alive` is called twice a second.
        """
        next_check_ns = 0
        while not self.stopped:
            now_ns = self._clock_ns()
            if now_ns >= next_check_ns:
                if not parent_alive():
                    return
                next_check_ns = now_ns + _PARENT_CHECK_NS
            self.step(now_ns)

    def step(self, now_ns: int) -> None:
        """Step the world to `now_ns`, then wait until the next tick (1 ms) or a message on bus or socket.

        A packet on the servo's bus and a request on the control socket end the wait and are answered at once.
        While nothing moves the wait lasts until 4 ms after the last tick.

        Args:
            now_ns: host monotonic time [ns].
        """
        self._catch_up(now_ns)
        still = self.world.at_rest and abs(self.world.arm()[1]) < _STILL_RAD_S
        due_ns = self.world.time_ns + (_IDLE_NS if still else TICK_NS)
        bus = [self.servo.fd] if self.servo.plugged_in else []
        if self.servo.next_answer_ns is not None:
            due_ns = min(due_ns, self.servo.next_answer_ns)
        wait_s = max(0, due_ns - self._clock_ns()) * 1e-9
        readable, _, _ = select.select([*bus, self._listener, *self._clients], [], [], wait_s)
        if (bus and bus[0] in readable) or self.servo.next_answer_ns is not None:
            now_ns = self._clock_ns()
            self._catch_up(now_ns)
            self.servo.service(now_ns)
        for source in readable:
            if source is self._listener:
                client, _ = self._listener.accept()
                client.setblocking(False)
                self._clients[client] = b""
            elif isinstance(source, socket.socket):
                self._receive(source)

    def _catch_up(self, now_ns: int) -> None:
        """Step the simulated world to `now_ns` (host monotonic) [ns].

        If it is more than 10 ms behind, the servo's bus is served after every 10 ms of physics, so that the
        servo answers in time.
        """
        while now_ns - self.world.time_ns > _SLICE_NS:
            self.world.step_to(self.world.time_ns + _SLICE_NS)
            if self.servo.plugged_in:
                clock_ns = self._clock_ns()
                self._stale_ns = max(self._stale_ns, clock_ns - self.world.time_ns)
                self._most_stale_ns = max(self._most_stale_ns, self._stale_ns)
                self.servo.service(clock_ns)
        self.world.step_to(now_ns)

    def _torque(self, position_rad: float, velocity_rad_s: float, time_ns: int) -> float:
        return self.servo.torque(position_rad, velocity_rad_s, time_ns)

    # --- control

    def _receive(self, client: socket.socket) -> None:
        try:
            data = client.recv(_REQUEST_BYTES)
        except OSError:
            data = b""
        *lines, rest = (self._clients[client] + data).split(b"\n")
        if not data or len(rest) > _REQUEST_BYTES:
            del self._clients[client]
            client.close()
            return
        self._clients[client] = rest
        for line in lines:
            with contextlib.suppress(OSError):  # the client has disconnected
                client.sendall(json.dumps(self._answer(line)).encode() + b"\n")

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            return self._call(json.loads(line))
        except AcquireError as error:
            return {"error": str(error)}
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            return {"error": f"virtual world: request cannot be understood ({type(error).__name__}: {error})"}

    def _call(self, request: dict[str, Any]) -> dict[str, Any]:
        methods = {
            "place": self._place,
            "push": self._push,
            "toss": self._toss,
            "truth": self._flush_truth,
            "state": self._state,
            "servo": self._change_servo,
            "quit": self._quit,
        }
        method = methods.get(request["method"])
        if method is None:
            return {
                "error": f"virtual world: no method '{request['method']}': choose one of {', '.join(methods)}"
            }
        return method(request)

    def _place(self, request: dict[str, Any]) -> dict[str, Any]:
        keys = ("R_world_object", "p_world_object", "impact_point_world")
        self.world.place(*(np.array(request[key], dtype=float) for key in keys))
        return {"ok": True}

    def _push(self, request: dict[str, Any]) -> dict[str, Any]:
        p_world, impulse = (np.array(request[key], float).reshape(3) for key in ("p_world", "impulse_world"))
        self.world.push(p_world, impulse, float(request["duration_s"]))
        return {"ok": True}

    def _toss(self, request: dict[str, Any]) -> dict[str, Any]:
        if "after_s" in request:
            self.world.let_go(self._clock_ns() + round(1e9 * float(request["after_s"])))
            return {"ok": True}
        planned, kind = PlannedToss.model_validate(request["toss"]), TossKind(request["kind"])
        self.world.toss(hand_toss(planned, self._object, self._hand, kind), float(request["hold_s"]))
        return {"ok": True}

    def _flush_truth(self, _request: dict[str, Any]) -> dict[str, Any]:
        self._truth.flush()
        return {"path": str(self._truth.path)}

    def _quit(self, _request: dict[str, Any]) -> dict[str, Any]:
        self.stopped = True
        return {"ok": True}

    def _change_servo(self, request: dict[str, Any]) -> dict[str, Any]:
        match request["what"]:
            case "unplug":
                self.servo.close()
            case "plug in" if not self.servo.plugged_in:
                self.servo.plug_in()
            case "overload":
                self.servo.fail(HardwareError.OVERLOAD)
            case other:
                return {
                    "error": f"virtual world: the servo cannot '{other}' now: "
                    "choose unplug, plug in (if unplugged) or overload"
                }
        return {"ok": True}

    def _state(self, _request: dict[str, Any]) -> dict[str, Any]:
        state = self.world.state()
        stale_ns, self._stale_ns = self._stale_ns, 0
        return {
            "stale_ns": stale_ns,
            "time_ns": state.time_ns,
            "at_rest": state.at_rest,
            "arm_angle": state.arm_angle,
            "arm_velocity": state.arm_velocity,
            "p_world_object": state.p_world_object.tolist(),
            "q_world_object_wxyz": state.q_world_object_wxyz.tolist(),
        }

    # --- output

    def _log_pose(self, state: WorldState) -> None:
        self._ring.append(
            state.time_ns,
            state.p_world_object,
            state.q_world_object_wxyz,
            state.arm_angle,
            state.p_world_hinge,
        )
        self._ticks += 1
        if state.at_rest and self._ticks % _RESTING_POSE_TICKS:
            return
        self._truth.pose(
            pb.TruthPose(
                world_time_ns=state.time_ns,
                p_world_object=state.p_world_object,
                q_world_object_wxyz=state.q_world_object_wxyz,
                linear_velocity=state.linear_velocity,
                angular_velocity=state.angular_velocity,
                striker_angle_rad=state.arm_angle,
                striker_velocity_rad_s=state.arm_velocity,
            )
        )

    def _log_contact(self, contact: StrikerContact) -> None:
        if isinstance(self.servo, SerialBoard):
            self.servo.touch(contact.time_ns)
        self._truth.contact(
            pb.TruthContact(
                world_time_ns=contact.time_ns,
                impulse_n_s=contact.impulse_n_s,
                p_world_contact=contact.p_world_contact,
                duration_s=contact.duration_s,
            )
        )


def truth_body(virtual_object: VirtualObject, seed: int, table_tilt: tuple[float, float]) -> pb.TruthBody:
    """Protobuf message with the object's true mass properties, and the true camera pose and table tilt.

    Args:
        virtual_object: the object.
        seed: seed of the virtual rig's camera calibration and pose; also stored in the message.
        table_tilt: (2,) rotation of gravity about x and y of W, the world frame [rad].
    """
    body = virtual_object.body
    normal, offset = body.region_plane
    camera = station(seed, virtual_object.camera_distance_m)
    return pb.TruthBody(
        mass_kg=body.mass_kg,
        com_object=body.com_object,
        inertia_com=body.inertia_com.ravel(),
        edge_radius_m=virtual_object.edge_radius_m,
        region_mass_kg=body.region_masses,
        region_plane=[*normal, offset],
        shell_thickness_m=body.shell_thickness_m,
        friction=virtual_object.friction,
        table_tilt_x_rad=table_tilt[0],
        table_tilt_y_rad=table_tilt[1],
        T_camera_world=np.linalg.inv(camera.T_world_camera).ravel(),
        seed=seed,
        drag_coefficient=virtual_object.drag_coefficient,
    )


def main() -> None:
    """Run the world process with the command line's arguments until it is asked to end.

    It is asked by SIGTERM, SIGINT or the request "quit" on its control socket; it also ends with its parent.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--object", required=True, help="name of an object, or its .npz file")
    parser.add_argument("--seed", type=int, required=True, help="seed of object, station and servo noise")
    parser.add_argument("--dir", type=Path, required=True, help="folder for the run's files")
    parser.add_argument(
        "--striker", choices=ARM_DEVICES, default="dynamixel", help="kind of the device that moves the arm"
    )
    parser.add_argument("--servo", choices=MODEL_NAMES, default=DEFAULT_MODEL, help="model of a servo")
    parser.add_argument(
        "--tilt-deg", type=float, nargs=2, default=(0.0, 0.0), help="rotation of gravity about W's x and y"
    )
    # The default is wrong if the parent has ended by now, hence the option.
    parser.add_argument(
        "--parent", type=int, default=os.getppid(), help="end with this process; default: parent"
    )
    arguments = parser.parse_args()
    tilt_x, tilt_y = np.radians(arguments.tilt_deg)
    try:
        virtual_object = open_object(arguments.object, arguments.seed)
    except AcquireError as error:
        sys.exit(str(error))
    process = WorldProcess(
        virtual_object,
        arguments.seed,
        arguments.dir,
        table_tilt=(float(tilt_x), float(tilt_y)),
        striker=arguments.striker,
        servo=arguments.servo,
    )

    def stop(_signal: int, _frame: object) -> None:
        process.stopped = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    gc.freeze()
    # A real world does not wait for the programs that watch it. An ordinary user may not raise the priority.
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    try:
        sys.stdout.write(json.dumps({"ready": True, "port": str(process.servo.port_path)}) + "\n")
        sys.stdout.flush()
        process.run(parent_alive=lambda: os.getppid() == arguments.parent)
    finally:
        process.close()


if __name__ == "__main__":
    main()
