"""Virtual rig as a whole: simulated world, camera and operator, with the real daemon and session.

Only this module imports both the virtual rig and the daemon. The daemon is started as `acquire run RIG.toml`;
it is given a camera address and a serial port, as with real hardware.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from acquire.config import read_rig
from acquire.daemon.client import DaemonClient, wait_for_socket
from acquire.errors import SessionError
from acquire.recorder.atomic import refuse_taken, refuse_unwritable
from acquire.session.adaptive import Target
from acquire.session.options import SessionOptions
from acquire.session.runner import Progress, SessionRunner
from acquire.session.session_input import SessionInput
from acquire.session.session_report import SessionReport
from acquire.session.waits import at_most
from acquire.virtual.devices import DeviceOptions, Devices, prepare_devices, refuse_other_address, run_folder
from acquire.virtual.operator import VirtualOperator
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.pace import read_pace
from acquire.virtual.processes import START_S, interruptible, running_process
from acquire.virtual.requirements import refuse_missing_libraries
from acquire.virtual.truth import merge_truth

START_TIMEOUT_S = 30.0
"""longest wait for the daemon's socket [s]"""
PLAN_TIMEOUT_S = 600.0
"""longest wait for `analyze plan` [s]; the objects that come with the program take two to five"""
SERVO_TIMEOUT_S = 20.0
"""longest wait for a servo that does not answer [s]: nobody plugs in a virtual one"""
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
    """Options of a demo's session: those of `analyze plan`, and the precision at which it stops itself."""

    strikes: int = 9
    """number of strikes to plan"""
    axes: int | None = None
    """largest number of different pivot axes; None for as many as improve the estimate"""
    method: str = "ours"
    """way to choose the strikes: "ours" or "paper\""""
    tosses: int = 0
    """number of tosses after the strikes"""
    target: Target | None = None
    """precision at which the session stops itself; None to make every planned strike"""

    def arguments(self, *, contents: bool) -> list[str]:
        """Command-line arguments of `analyze plan` for these options.

        Args:
            contents: True to plan strikes that test whether anything moves inside.
        """
        most = [] if self.axes is None else ["--axes", str(self.axes)]
        test = ["--contents"] if contents else []
        tosses = ["--tosses", str(self.tosses)] if self.tosses else []
        return ["--strikes", str(self.strikes), *most, "--method", self.method, *tosses, *test]


def run_demo(
    devices: DeviceOptions, output: DemoOutput, *, plan: DemoPlan, progress: Progress
) -> SessionReport:
    """Plan and run a session on the virtual rig, then add the true values to its recording.

    Args:
        devices: object, seed and camera address of the virtual rig.
        output: the recording to write, and older files to delete once the rig is up.
        plan: options of plan and session.
        progress: called with a text, the number of strikes done, and the number of all strikes.

    Returns:
        Files, and numbers of strikes and frames, of the session.

    Raises:
        ConfigError: the address is not a loopback address, or the object cannot be simulated.
        AcquireError: a library is missing, or the session failed, for example because the object cannot be
            planned; the rig is taken down in any case.
    """
    refuse_other_address(devices.address)
    refuse_missing_libraries()
    with run_folder(_FOLDER) as folder:
        truth_path = folder / "kept-truth.bin"
        try:
            with interruptible(), contextlib.ExitStack() as cleanup:
                progress("starting: object", 0, 1)
                rig = prepare_devices(devices, folder)
                for note in rig.notes:
                    progress(f"note: {note}", 0, 1)
                return _session(rig, output, plan, progress, truth_path, cleanup)
        finally:
            if note := read_pace(folder).note():
                progress(f"note: {note}", 1, 1)
            if truth_path.exists() and output.path.exists():
                progress("finishing: adding the ground truth to the recording", 1, 1)
                merge_truth(output.path, truth_path)


def _session(
    rig: Devices,
    output: DemoOutput,
    plan: DemoPlan,
    progress: Progress,
    truth_path: Path,
    cleanup: contextlib.ExitStack,
) -> SessionReport:
    """Run a session on a virtual rig; copy its ground truth to `truth_path`, also if it ends early.

    Args:
        rig: devices of the virtual rig, not yet started.
        output: the recording to write, and older files to delete once the rig is up.
        plan: options of plan and session.
        progress: called with a text, the number of strikes done, and the number of all strikes.
        truth_path: file to copy the ground truth to.
        cleanup: ends the started processes.
    """
    folder = rig.folder
    plan_path, rig_path = folder / "plan.json", folder / "rig.toml"
    progress(f"starting: world{at_most(START_S)}", 0, 1)
    cleanup.enter_context(rig.world(rig_path))
    planning = cleanup.enter_context(_planning(rig, plan_path, rig_path, plan))
    progress(f"starting: camera{at_most(START_S)}", 0, 1)
    cleanup.enter_context(rig.camera())
    progress(f"starting: daemon{at_most(START_S + START_TIMEOUT_S)}", 0, 1)
    socket = read_rig(rig_path).daemon.socket_path()
    cleanup.enter_context(
        running_process(
            "daemon",
            folder,
            "acquire",
            *("run", str(rig_path), "--json", "--parent", str(os.getpid())),
            environment=rig.environment,
        )
    )
    wait_for_socket(socket, lambda: True, START_TIMEOUT_S)
    progress(f"starting: plan{at_most(PLAN_TIMEOUT_S)}", 0, 1)
    _wait_for_plan(planning)

    world = cleanup.enter_context(contextlib.closing(OperatorLink(folder / "world.sock")))
    client = cleanup.enter_context(contextlib.closing(DaemonClient(socket)))
    cleanup.enter_context(contextlib.closing(VirtualOperator(socket, world, rig.options.seed)))
    for older in output.replaced:
        older.unlink(missing_ok=True)
    try:
        given = SessionInput(rig.object_path, plan_path)
        options = SessionOptions(plan.target, servo_timeout_s=SERVO_TIMEOUT_S)
        return SessionRunner(client, given, output.path, progress, options).run()
    finally:  # a session that ends early leaves a recording as well
        shutil.copyfile(world.truth(), truth_path)


@contextlib.contextmanager
def _planning(
    rig: Devices, plan_path: Path, rig_path: Path, plan: DemoPlan
) -> Iterator[subprocess.Popen[str]]:
    """Context in which `analyze plan` runs while the rig starts; yields the `analyze plan` process.

    The process is killed at the end of the context.
    """
    command = [
        sys.executable,
        "-m",
        "analyze",
        "plan",
        str(rig.object_path),
        "-o",
        str(plan_path),
        "--rig",
        str(rig_path),
        *plan.arguments(contents=rig.virtual_object.contents is not None),
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def _wait_for_plan(planning: subprocess.Popen[str]) -> None:
    """Wait until `analyze plan` has written the plan.

    Raises:
        SessionError: `analyze plan` failed, with the message that it printed, or took longer than
            PLAN_TIMEOUT_S (600 s).
    """
    try:
        stdout, stderr = planning.communicate(timeout=PLAN_TIMEOUT_S)
    except subprocess.TimeoutExpired:
        raise SessionError(
            f"`analyze plan` took longer than {PLAN_TIMEOUT_S:g} s: try it alone, with fewer --strikes"
        ) from None
    if planning.returncode != 0:
        raise SessionError(f"`analyze plan` failed: {stderr.strip() or stdout.strip()}")
