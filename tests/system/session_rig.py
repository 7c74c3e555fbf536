"""A whole virtual rig with a daemon, for sessions in which something breaks."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from acquire.daemon.client import DaemonClient
from acquire.session.adaptive import Target
from acquire.session.earlier import EarlierStrikes
from acquire.session.options import SessionOptions
from acquire.session.runner import Progress, SessionRunner
from acquire.session.session_input import SessionInput
from acquire.session.session_report import SessionReport
from acquire.virtual.arm_devices import ARM_DEVICES
from acquire.virtual.device_kinds import USUAL_KINDS, DeviceKinds
from acquire.virtual.devices import rig_toml
from acquire.virtual.objects import load_object
from acquire.virtual.operator import VirtualOperator
from acquire.virtual.station import calibration_sheet
from acquire.virtual.toss import TossKind
from acquire.virtual.usb_library import FOLDER, library_environment
from tests.acquire.virtual.world_link import WorldLink
from tests.loopback import loopback
from tests.system.fault_rig import Daemon

ADDRESS = loopback(123)
OBJECT, SEED = "carton", 3


def _started(module: str, *arguments: str) -> subprocess.Popen[str]:
    process = subprocess.Popen([sys.executable, "-m", module, *arguments], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert json.loads(process.stdout.readline())["ready"]
    return process


def _ended(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=60)


class PlanRefused(Exception):
    """No strike can be planned on the rig; the message is that of `analyze plan`."""


@dataclass
class SessionRig:
    """The whole virtual rig: world, camera, daemon, and a plan for its object."""

    folder: Path
    cleanup: contextlib.ExitStack
    said: list[str] = field(default_factory=list)
    strikes: int = 3
    """number of planned strikes"""
    kinds: DeviceKinds = USUAL_KINDS
    tosses: int = 0
    """number of planned tosses"""
    recorder: str = ""
    """lines of the rig file's table [recorder]"""

    def __post_init__(self) -> None:
        thing = load_object(OBJECT, SEED)
        (self.folder / "object.toml").write_text(thing.spec_toml)
        self.common = ["--object", OBJECT, "--seed", str(SEED), "--dir", str(self.folder)]
        # Where a person strikes, a servo stands by.
        moved = self.kinds if self.kinds.striker in ARM_DEVICES else replace(self.kinds, striker="dynamixel")
        world = _started("acquire.virtual.world_process", *self.common, *moved.world_arguments)
        self.cleanup.callback(_ended, world)
        rig = self.folder / "d.toml"
        sheet = calibration_sheet(SEED)
        port = self.folder / ("ttyBoard" if moved.striker == "serial" else "ttyDXL")
        address = self.kinds.camera_address(ADDRESS, self.folder, SEED)
        socket = self.folder / "d" / "d.sock"
        text = rig_toml(sheet, address, str(port), socket, self.kinds)
        rig.write_text(text.replace("[recorder]\n", f"[recorder]\n{self.recorder}\n"))
        self.camera = self.start_camera()
        plan = [
            str(self.folder / "object.toml"),
            "-o",
            str(self.folder / "plan.json"),
            "--rig",
            str(rig),
            "--strikes",
            str(self.strikes),
            "--tosses",
            str(self.tosses),
        ]
        planned = subprocess.run(
            [sys.executable, "-m", "analyze", "plan", *plan], check=False, capture_output=True, text=True
        )
        if planned.returncode != 0:
            raise PlanRefused(planned.stderr.strip().splitlines()[-1])
        usb = library_environment(self.folder / FOLDER) if self.kinds.camera == "usb3" else {}
        self.daemon = Daemon(rig, **usb)
        self.cleanup.callback(self.daemon.end)
        assert self.daemon.ready, self.daemon.complaints

    def start_camera(self) -> subprocess.Popen[str]:
        arguments = [*self.common, "--address", ADDRESS, *self.kinds.camera_arguments]
        camera = _started("acquire.virtual.camera_process", *arguments)
        self.cleanup.callback(_ended, camera)
        return camera

    def session(
        self,
        progress: Progress,
        *,
        name: str = "r.mcap",
        target: Target | None = None,
        earlier: EarlierStrikes | None = None,
        only_tosses: bool = False,
        kinds: Sequence[TossKind] = (TossKind.GOOD,),
    ) -> SessionReport:
        """Run a session with the virtual operator; its recording is called `name`."""
        world = self.world()
        client = self.cleanup.enter_context(contextlib.closing(DaemonClient(self.daemon.socket)))
        with contextlib.closing(VirtualOperator(self.daemon.socket, world, SEED, tosses=kinds)):
            given = SessionInput(self.folder / "object.toml", self.folder / "plan.json")
            output = self.folder / name
            options = SessionOptions(target, earlier, only_tosses=only_tosses)
            return SessionRunner(client, given, output, progress, options).run()

    def world(self) -> WorldLink:
        """A separate connection to the virtual world."""
        return self.cleanup.enter_context(contextlib.closing(WorldLink(self.folder / "world.sock")))


@contextlib.contextmanager
def session_rig(
    striker: str = "dynamixel",
    strikes: int = 3,
    kinds: DeviceKinds | None = None,
    tosses: int = 0,
    recorder: str = "",
) -> Iterator[SessionRig]:
    """Yield a rig in a folder with a short name, because the path of a socket is limited."""
    kinds = kinds or DeviceKinds(striker=striker)
    with tempfile.TemporaryDirectory(prefix="ps-") as name, contextlib.ExitStack() as cleanup:
        yield SessionRig(Path(name), cleanup, strikes=strikes, kinds=kinds, tosses=tosses, recorder=recorder)
