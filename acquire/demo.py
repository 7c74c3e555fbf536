"""Virtual rig as a whole: simulated world, camera and operator, with the real daemon and session.

Only this module imports both the virtual rig and the daemon. The daemon is started as `acquire run RIG.toml`;
it is given a camera address and a serial port, as with real hardware.
"""

from __future__ import annotations

import contextlib
import ipaddress
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from acquire.config import read_rig
from acquire.daemon.client import DaemonClient, wait_for_socket
from acquire.errors import ConfigError, SessionError
from acquire.recorder.atomic import refuse_taken, refuse_unwritable
from acquire.session.runner import Progress, SessionRunner
from acquire.session.session_input import SessionInput
from acquire.session.session_report import SessionReport
from acquire.virtual.objects import VirtualObject, load_object
from acquire.virtual.operator import VirtualOperator
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.processes import interruptible, running_process
from acquire.virtual.requirements import refuse_missing_libraries
from acquire.virtual.station import calibration_sheet
from acquire.virtual.truth import merge_truth

START_TIMEOUT_S = 30.0
"""longest wait for the daemon's socket [s]"""
_FOLDER = "percuss-demo-"
"""prefix of a demo's temporary folder: /tmp/percuss-demo-<process id>-*"""


@dataclass(frozen=True)
class DemoOutput:
    """Path of the recording to write, with the older files that it replaces."""

    path: Path
    replaced: tuple[Path, ...] = ()
    """older files to delete once the rig is up"""


def fresh_output(path: Path) -> DemoOutput:
    """Path of a demo's recording, which must not exist yet; nor may its .part file (unfinished recording).

    Raises:
        RecorderError: the path or its .part file exists already, or cannot be written.
    """
    refuse_unwritable(path)
    for taken in (path, Path(f"{path}.part")):
        refuse_taken(taken, force=False)
    return DemoOutput(path)


def replaced_output(path: Path) -> DemoOutput:
    """Path of a demo's recording, with the older recording and .part file there that it will replace.

    Nothing is deleted yet.

    Raises:
        RecorderError: the path is a folder or cannot be written.
    """
    refuse_unwritable(path)
    return DemoOutput(path, tuple(taken for taken in (path, Path(f"{path}.part")) if taken.exists()))


@dataclass(frozen=True)
class DemoPlan:
    """Options of `analyze plan` that a demo passes on: number of strikes, number of pivot axes, method."""

    strikes: int = 9
    """number of strikes to plan"""
    axes: int | None = None
    """largest number of different pivot axes; None for as many as pay"""
    method: str = "ours"
    """way to choose the strikes: "ours" or "paper\""""

    def arguments(self) -> list[str]:
        """Command-line arguments of `analyze plan` for these options."""
        most = [] if self.axes is None else ["--axes", str(self.axes)]
        return ["--strikes", str(self.strikes), *most, "--method", self.method]


def run_demo(
    object_name: str, seed: int, output: DemoOutput, *, address: str, plan: DemoPlan, progress: Progress
) -> SessionReport:
    """Plan and run a session on the virtual rig, then add the true values to its recording.

    Args:
        object_name: name of a virtual object: carton, spray, juice, salt or parcel.
        seed: seed of everything random in the virtual rig.
        output: the recording to write, and older files to delete once the rig is up.
        address: loopback address of the virtual camera, one per rig.
        plan: options of `analyze plan`.
        progress: called with a text, the number of strikes done, and the number of all strikes.

    Returns:
        Files, and numbers of strikes and frames, of the session.

    Raises:
        ConfigError: the address is not a loopback address.
        AcquireError: a library is missing, or the session failed; the rig is taken down in any case.
    """
    _refuse_other_address(address)
    refuse_missing_libraries()
    _remove_leftovers(Path(tempfile.gettempdir()))
    folder = Path(tempfile.mkdtemp(prefix=f"{_FOLDER}{os.getpid()}-"))
    truth_path = folder / "kept-truth.bin"
    try:
        with interruptible(), contextlib.ExitStack() as cleanup:
            return _session(object_name, seed, output, address, plan, progress, truth_path, cleanup)
    finally:
        if truth_path.exists() and output.path.exists():
            progress("finishing: adding the ground truth to the recording", 1, 1)
            merge_truth(output.path, truth_path)
        shutil.rmtree(folder, ignore_errors=True)


def _session(
    object_name: str,
    seed: int,
    output: DemoOutput,
    address: str,
    plan: DemoPlan,
    progress: Progress,
    truth_path: Path,
    cleanup: contextlib.ExitStack,
) -> SessionReport:
    folder = truth_path.parent
    virtual_object = load_object(object_name, seed)
    object_path, plan_path, rig_path = folder / "object.toml", folder / "plan.json", folder / "rig.toml"
    _write_object(virtual_object, object_path)

    progress("starting: world", 0, 1)
    common = [
        "--object",
        object_name,
        "--seed",
        str(seed),
        "--dir",
        str(folder),
        "--parent",
        str(os.getpid()),
    ]
    world_ready = cleanup.enter_context(
        running_process("world", folder, "acquire.virtual.world_process", *common)
    )
    rig_path.write_text(
        rig_toml(calibration_sheet(seed), address, world_ready["port"], folder / "run" / "daemon.sock"),
        encoding="utf-8",
    )
    planning = cleanup.enter_context(_planning(object_path, plan_path, rig_path, plan))
    progress("starting: camera", 0, 1)
    cleanup.enter_context(
        running_process("camera", folder, "acquire.virtual.camera_process", *common, "--address", address)
    )
    progress("starting: daemon", 0, 1)
    socket = read_rig(rig_path).daemon.socket_path()
    cleanup.enter_context(
        running_process(
            "daemon", folder, "acquire", "run", str(rig_path), "--json", "--parent", str(os.getpid())
        )
    )
    wait_for_socket(socket, lambda: True, START_TIMEOUT_S)
    progress("starting: plan", 0, 1)
    _wait_for_plan(planning)

    world = cleanup.enter_context(contextlib.closing(OperatorLink(folder / "world.sock")))
    client = cleanup.enter_context(contextlib.closing(DaemonClient(socket)))
    cleanup.enter_context(contextlib.closing(VirtualOperator(socket, world, seed)))
    for older in output.replaced:
        older.unlink(missing_ok=True)
    try:
        return SessionRunner(client, SessionInput(object_path, plan_path), output.path, progress).run()
    finally:  # a session that ends early leaves a recording as well
        shutil.copyfile(world.truth(), truth_path)


def rig_toml(sheet: dict[str, Any], address: str, port: str, socket: Path) -> str:
    """Text of the rig file (TOML) that a person would write for the virtual rig.

    Args:
        sheet: calibrated values of the rig: gravity, friction, camera and striker.
        address: address of the virtual camera.
        port: serial port of the virtual servo.
        socket: path of the daemon's socket.
    """
    camera, striker = sheet["camera"], sheet["striker"]
    return f"""# The virtual rig, described as a real one would be.
name = "virtual"
g_m_s2 = {sheet["g_m_s2"]}
g_sd_m_s2 = 0.001
gravity_tilt_sd_rad = 0.0005
table_friction = {sheet["table_friction"]}

[camera]
name = "main"
address = "{address}"
width = {camera["width"]}
height = {camera["height"]}
frame_rate_hz = 120.0
exposure_us = 1500.0

[camera.calibration]
width = {camera["width"]}
height = {camera["height"]}
K = {json.dumps(camera["K"])}
distortion = {json.dumps(camera["distortion"])}
T_world_camera = {json.dumps(camera["T_world_camera"])}
strain_sd = 1e-4

[striker]
kind = "dynamixel"
port = "{port}"
arm_length_m = {striker["arm_length_m"]}
effective_mass_kg = {striker["effective_mass_kg"]:.4g}
effective_mass_sd_kg = 0.05
restitution = 0.4

[recorder]
pre_trigger_s = 0.1

[daemon]
socket = "{socket}"
"""


def _remove_leftovers(temporary: Path) -> None:
    """Delete the folders in `temporary` that this user's killed demos have left.

    A folder's name holds the process id of its demo; folders of running processes stay. The other processes
    of a killed demo end by themselves.
    """
    for folder in temporary.glob(f"{_FOLDER}*-*"):
        pid = folder.name.removeprefix(_FOLDER).partition("-")[0]
        with contextlib.suppress(OSError):
            ours = folder.lstat().st_uid == os.getuid() and folder.is_dir() and not folder.is_symlink()
            if ours and pid.isdecimal() and not Path(f"/proc/{pid}").exists():
                shutil.rmtree(folder, ignore_errors=True)


def _write_object(virtual_object: VirtualObject, path: Path) -> None:
    path.write_text(virtual_object.spec_toml, encoding="utf-8")
    if virtual_object.shape_file is not None:
        name, data = virtual_object.shape_file
        (path.parent / name).write_bytes(data)


@contextlib.contextmanager
def _planning(
    object_path: Path, plan_path: Path, rig_path: Path, plan: DemoPlan
) -> Iterator[subprocess.Popen[str]]:
    """Context in which `analyze plan` runs while the rig starts; yields the `analyze plan` process.

    The process is killed at the end of the context.
    """
    command = [
        sys.executable,
        "-m",
        "analyze",
        "plan",
        str(object_path),
        "-o",
        str(plan_path),
        "--rig",
        str(rig_path),
        *plan.arguments(),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _wait_for_plan(planning: subprocess.Popen[str]) -> None:
    """Wait until `analyze plan` has written the plan.

    Raises:
        SessionError: `analyze plan` failed; with the message that it printed.
    """
    stdout, stderr = planning.communicate()
    if planning.returncode != 0:
        raise SessionError(f"`analyze plan` failed: {stderr.strip() or stdout.strip()}")


def _refuse_other_address(address: str) -> None:
    try:
        fits = ipaddress.IPv4Address(address).is_loopback
    except ValueError:
        fits = False
    if not fits:
        raise ConfigError(
            f"{address}: the virtual camera needs a loopback address: "
            "give one from 127.0.0.1 to 127.255.255.254"
        )
