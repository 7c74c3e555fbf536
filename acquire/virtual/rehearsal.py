"""Virtual devices for a person's own `acquire run`: a rig to practise with before one is built.

World and camera run until they are stopped. Whenever the daemon asks a person to place the object, the object
is placed in the virtual world, and the person answers the prompt. A finished recording gets the ground truth.
"""

from __future__ import annotations

import contextlib
import shlex
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

import numpy as np

from acquire.config import read_rig
from acquire.daemon.client import DaemonClient
from acquire.errors import AcquireError, ConfigError, DaemonNotRunning
from acquire.virtual.devices import DeviceOptions, Devices, prepare_devices, refuse_other_address, run_folder
from acquire.virtual.operator import VirtualOperator
from acquire.virtual.operator_link import OperatorLink
from acquire.virtual.pace import read_pace
from acquire.virtual.processes import interruptible
from acquire.virtual.requirements import refuse_missing_libraries
from acquire.virtual.truth import merge_truth

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from acquire.virtual.objects import VirtualObject

_FOLDER = "percuss-virtual-"
"""prefix of a rehearsal's temporary folder: /tmp/percuss-virtual-<process id>-*"""
_HEAD = "# Written by `acquire virtual`, which replaces it.\n"
"""first line of the files that a rehearsal writes; other files are not replaced"""
_POLL_S = 0.5
_MARGIN_NS = 2_000_000_000
"""time before a recording was first seen from which the ground truth is added [ns]"""
_UPRIGHT = 0.5
"""largest vertical component of the normal of a tag that counts as on an upright side"""

Show = Callable[[str], None]
"""function that shows one line to the user"""


def rehearse(options: DeviceOptions, folder: Path, show: Show) -> None:
    """Run the virtual devices until Ctrl-C or SIGTERM, and place the object for a person's session.

    Args:
        options: object, seed and camera address.
        folder: folder for the rig file, and for the object file if it was made; created if missing.
        show: called with each line for the user: the commands to use, then what happens.

    Raises:
        ConfigError: the address or the object cannot be used, or the folder holds a rig, object or
            shape file that `acquire virtual` did not write.
        AcquireError: a library is missing, or a device did not start.
    """
    refuse_other_address(options.address)
    refuse_missing_libraries()
    rig_path = folder / "rig.toml"
    _refuse_other_file(rig_path)
    with run_folder(_FOLDER) as run:
        with interruptible(), contextlib.suppress(KeyboardInterrupt), contextlib.ExitStack() as cleanup:
            devices = prepare_devices(options, run)
            object_path = _kept_object(devices, folder)
            cleanup.enter_context(devices.world(run / "rig.toml", folder))
            _write_ours(rig_path, (run / "rig.toml").read_text(encoding="utf-8"))
            cleanup.enter_context(devices.camera())
            world = cleanup.enter_context(contextlib.closing(OperatorLink(run / "world.sock")))
            _place_for_a_look(world, devices.virtual_object)
            for line in _instructions(devices, object_path, rig_path, read_rig(rig_path).striker.port):
                show(line)
            _serve(devices, world, show)
        if note := read_pace(run).note():
            show(f"note: {note}")


def _serve(devices: Devices, world: OperatorLink, show: Show) -> None:
    """Place the object for every daemon that runs on this rig, and complete its recordings, for ever."""
    while True:
        with contextlib.suppress(DaemonNotRunning), contextlib.ExitStack() as cleanup:
            operator = VirtualOperator(devices.socket, world, devices.options.seed, answers=False)
            cleanup.enter_context(contextlib.closing(operator))
            client = cleanup.enter_context(DaemonClient(devices.socket))
            show("the daemon runs: the object is placed whenever a session asks for it")
            cleanup.callback(show, "the daemon has ended")
            recordings = _Recordings(world, show)
            while operator.connected:
                recordings.look(client.call("status")["recording"])
                time.sleep(_POLL_S)
        time.sleep(_POLL_S)


@dataclass
class _Recordings:
    """Recordings of a daemon, each completed with the ground truth once it is finished."""

    world: OperatorLink
    show: Show
    path: Path | None = None
    """recording that is being written, its first file; None if there is none"""
    since_ns: int = 0
    """host monotonic time at which it was first seen [ns]"""

    def look(self, recording: str | None) -> None:
        """Note the recording that the daemon writes now, None for none; complete one that has ended."""
        if recording is not None and self.path is None:
            self.path, self.since_ns = Path(recording.removesuffix(".part")), time.monotonic_ns()
        elif recording is None and self.path is not None and not Path(f"{self.path}.part").exists():
            finished, self.path = self.path, None
            if finished.exists():
                self._complete(finished)

    def _complete(self, path: Path) -> None:
        try:
            merge_truth(path, Path(self.world.truth()), self.since_ns - _MARGIN_NS)
        except (AcquireError, OSError) as error:
            if path.exists():  # the video of a check is deleted at once
                self.show(f"the ground truth was not added to {path}: {error}")
        else:
            self.show(f"the ground truth was added: analyze score {shlex.quote(str(path))}")


def _instructions(devices: Devices, object_path: Path, rig_path: Path, port: str) -> list[str]:
    """Lines for the user: what runs, and which commands rehearse a session."""
    rig, thing = shlex.quote(str(rig_path)), shlex.quote(str(object_path))
    folder = rig_path.parent
    test = " --contents" if devices.virtual_object.contents is not None else ""
    plan, recording = (shlex.quote(str(folder / name)) for name in ("plan.json", "session.mcap"))
    return [
        *(f"note: {note}" for note in devices.notes),
        f"virtual rig: camera at {devices.camera_address}, striker at {port}",
        f"rig file: {rig_path}",
        "It runs until Ctrl-C. In other terminals:",
        *(f"  export {name}={shlex.quote(value)}" for name, value in devices.environment.items()),
        f"  acquire check {rig}",
        f"  acquire run {rig}",
        f"  analyze plan {thing} --rig {rig} --strikes 3{test} -o {plan}",
        f"  acquire session {thing} {plan} --rig {rig} -o {recording}",
        f"  acquire status --rig {rig}",
        f"  acquire stop --rig {rig}              # the arm; with --daemon, the daemon too",
        f"  analyze report {recording}",
    ]


def _kept_object(devices: Devices, folder: Path) -> Path:
    """Object file for the user's commands; one that the rig made is written to `folder` with its shape.

    Args:
        devices: the rig's devices, not yet started.
        folder: folder for the files; created if missing.

    Raises:
        ConfigError: an object file that `acquire virtual` did not write, or another shape file, is there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    made = devices.object_path
    if not made.is_relative_to(devices.folder):
        return made
    kept = folder / f"{PurePath(devices.options.object_name).stem}.toml"
    _write_ours(kept, made.read_text(encoding="utf-8"))
    name = devices.virtual_object.spec.shape.file
    if name is not None and not PurePath(name).is_absolute():
        source, target = devices.folder / name, folder / name
        if target.exists() and target.read_bytes() != source.read_bytes():
            raise ConfigError(f"{target}: another shape file is in the way: give another --dir")
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, target)
    return kept


def _write_ours(path: Path, text: str) -> None:
    _refuse_other_file(path)
    path.write_text(_HEAD + text, encoding="utf-8")


def _refuse_other_file(path: Path) -> None:
    """Refuse to replace a file that no rehearsal has written.

    Raises:
        ConfigError: there is such a file.
    """
    if path.exists() and not path.read_text(encoding="utf-8", errors="replace").startswith(_HEAD):
        raise ConfigError(f"{path}: exists, and was not written by `acquire virtual`: give another --dir")


def _place_for_a_look(world: OperatorLink, virtual_object: VirtualObject) -> None:
    """Place the object over the world frame's origin, with the largest tag on its upright sides in view.

    The tag faces the camera. Without such a tag the object is not turned.
    """
    tags = [
        (marker.size_m, np.array(marker.T_object_marker)[:3, 2])
        for marker in virtual_object.spec.marker
        if marker.T_object_marker is not None
    ]
    upright = [(size, normal) for size, normal in tags if abs(normal[2]) < _UPRIGHT]
    R = _turned_to_camera(max(upright, key=lambda one: one[0])[1]) if upright else np.eye(3)
    vertices = virtual_object.mesh_vertices @ R.T
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle = np.array([low[0] + high[0], low[1] + high[1], 0.0]) / 2
    world.place(R, -middle, np.array([(low[0] - high[0]) / 2, 0.0, (high[2] - low[2]) / 2]))


def _turned_to_camera(normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation (3, 3) about z that turns the horizontal direction of `normal` (3,) to -y."""
    x, y = normal[:2] / np.linalg.norm(normal[:2])
    return np.array([[-y, x, 0.0], [-x, -y, 0.0], [0.0, 0.0, 1.0]])
