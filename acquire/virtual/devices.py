"""Start of the virtual rig's devices: its object, world and camera, and the rig file that describes them."""

from __future__ import annotations

import contextlib
import ipaddress
import json
import os
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from acquire.errors import ConfigError
from acquire.virtual.device_kinds import USUAL_KINDS, DeviceKinds
from acquire.virtual.filled_object import with_contents
from acquire.virtual.given_contents import GivenContents
from acquire.virtual.given_truth import read_given_truth
from acquire.virtual.object_archive import SUFFIX, save_object
from acquire.virtual.objects import OBJECT_NAMES, VirtualObject, load_object, without_tags
from acquire.virtual.own_object import read_own_object
from acquire.virtual.packaging import BLANK, Packaging
from acquire.virtual.processes import running_process
from acquire.virtual.station import calibration_sheet
from acquire.virtual.usb_library import FOLDER as USB_FOLDER
from acquire.virtual.usb_library import library_environment

STALL_S = 5.0
"""time without a frame after which a client opens the virtual camera anew [s]: a second is common while the
computer is busy, and all images that wait to be drawn would be lost"""


STATED_FRICTION = 0.9
"""friction that the rig file states for a slippery table, as a share of the true one"""


@dataclass(frozen=True)
class DeviceOptions:
    """Choice of a virtual rig: object, seed of everything random, kinds and makes of camera and striker."""

    object_name: str
    """name of an object that comes with the program, or path of an object file"""
    seed: int
    """seed of everything random in the virtual rig"""
    address: str
    """loopback address of a virtual GigE camera, one per rig"""
    truth_path: Path | None = None
    """truth file of a user's object; None to draw from the seed what its object file does not state"""
    kinds: DeviceKinds = USUAL_KINDS
    """kinds and makes of camera and striker"""
    packaging: Packaging = BLANK
    """print on the object's faces; in the camera's images only"""
    tags: bool = True
    """False to leave the tags off the object, and out of its object file"""
    contents: GivenContents | None = None
    """what moves inside the object; None for what the truth file gives, else for nothing"""
    friction: float | None = None
    """coefficient of friction between object and table; None for that of the truth file or the seed"""


@dataclass(frozen=True)
class Devices:
    """Object and folder of a virtual rig, and the start of its processes."""

    options: DeviceOptions
    folder: Path
    """folder of the rig's files and sockets"""
    virtual_object: VirtualObject
    object_path: Path
    """object file to plan and measure with"""
    notes: tuple[str, ...]
    """lines for the user: repairs of the shape, tags that were added, the camera's distance"""

    @property
    def socket(self) -> Path:
        """Path of the daemon's socket, as the rig file gives it."""
        return self.folder / "run" / "daemon.sock"

    @property
    def camera_address(self) -> str:
        """Address of the camera, as the rig file gives it: IP address, video device or device id."""
        options = self.options
        return options.kinds.camera_address(options.address, self.folder, options.seed)

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables of the programs that use the camera, beside the usual ones."""
        return library_environment(self.folder / USB_FOLDER) if self.options.kinds.camera == "usb3" else {}

    @contextlib.contextmanager
    def world(self, rig_path: Path, recordings: Path | None = None) -> Iterator[None]:
        """Run the simulated world during the block, and write the rig file.

        Args:
            rig_path: rig file to write.
            recordings: folder of recordings that the rig file names; None to name none.

        Raises:
            AcquireError: the world did not start.
        """
        with running_process(
            "world",
            self.folder,
            "acquire.virtual.world_process",
            *self._arguments(),
            *self.options.kinds.world_arguments,
        ) as ready:
            thing = self.virtual_object
            sheet = calibration_sheet(self.options.seed, thing.camera_distance_m, thing.arm_inertia_kg_m2)
            sheet["table_friction"] = min(sheet["table_friction"], round(STATED_FRICTION * thing.friction, 3))
            text = rig_toml(sheet, self.camera_address, ready["port"], self.socket, self.options.kinds)
            if recordings is not None:
                entry = f"[recorder]\ndirectory = {json.dumps(str(recordings.resolve()))}"
                text = text.replace("[recorder]", entry)
            rig_path.write_text(text, encoding="utf-8")
            yield

    @contextlib.contextmanager
    def camera(self) -> Iterator[None]:
        """Run the simulated camera during the block; the world must run.

        Raises:
            AcquireError: the camera did not start.
        """
        camera = [*self.options.kinds.camera_arguments, "--address", self.options.address]
        arguments = [*self._arguments(), *camera]
        with running_process("camera", self.folder, "acquire.virtual.camera_process", *arguments):
            yield

    def _arguments(self) -> list[str]:
        archive = self.folder / f"virtual-object{SUFFIX}"
        name = str(archive) if archive.exists() else self.options.object_name
        seed, parent = str(self.options.seed), str(os.getpid())
        return ["--object", name, "--seed", seed, "--dir", str(self.folder), "--parent", parent]


def prepare_devices(options: DeviceOptions, folder: Path) -> Devices:
    """Make the object of a virtual rig, and write its files; nothing is started.

    Args:
        options: object, seed and address.
        folder: folder of the rig's files and sockets.

    Raises:
        ConfigError: the address is not a loopback address, or the object cannot be simulated.
    """
    refuse_other_address(options.address)
    if options.object_name in OBJECT_NAMES:
        named, object_path, notes = load_object(options.object_name, options.seed), folder / "object.toml", ()
    elif options.tags:
        own = read_own_object(Path(options.object_name), options.seed, options.truth_path, folder)
        named, object_path, notes = own.virtual, own.object_path, own.notes
    else:
        raise ConfigError(
            f"{options.object_name}: tags can be left off the objects that come with the program only, with"
            f" --no-tags: choose one of {', '.join(OBJECT_NAMES)}"
        )
    virtual_object = _changed(named, options)
    if options.object_name in OBJECT_NAMES:
        _write_object(virtual_object, object_path)
    if options.object_name not in OBJECT_NAMES or virtual_object is not named:
        save_object(virtual_object, folder / f"virtual-object{SUFFIX}")
    return Devices(options, folder, virtual_object, object_path, notes)


def _changed(virtual_object: VirtualObject, options: DeviceOptions) -> VirtualObject:
    """Object with print, tags, contents and friction as the options give them; the same if they give none."""
    if not options.packaging.is_plain:
        virtual_object = replace(virtual_object, packaging=options.packaging)
    if not options.tags:
        virtual_object = without_tags(virtual_object)
    if options.friction is not None:
        virtual_object = replace(virtual_object, friction=options.friction)
    contents = options.contents or read_given_truth(options.truth_path).contents
    if contents is not None:
        virtual_object = with_contents(virtual_object, contents, options.seed)
    return virtual_object


def rig_toml(
    sheet: dict[str, Any], address: str, port: str, socket: Path, kinds: DeviceKinds = USUAL_KINDS
) -> str:
    """Text of the rig file (TOML) that a person would write for the virtual rig.

    Args:
        sheet: calibrated values of the rig: gravity, friction, camera and striker.
        address: address of the virtual camera.
        port: serial port of the virtual servo or striker board.
        socket: path of the daemon's socket.
        kinds: kinds and makes of camera and striker.
    """
    camera, striker = sheet["camera"], sheet["striker"]
    return f"""# The virtual rig, described as a real one would be.
name = "virtual"
g_m_s2 = {sheet["g_m_s2"]}
g_sd_m_s2 = 0.001
gravity_tilt_sd_rad = 0.0005
table_friction = {sheet["table_friction"]}

[camera]
name = "main"{kinds.camera_lines}
address = "{address}"
width = {camera["width"]}
height = {camera["height"]}
frame_rate_hz = 120.0
exposure_us = 1500.0
stall_s = {STALL_S}  # its images are late while the computer is busy

[camera.calibration]
width = {camera["width"]}
height = {camera["height"]}
K = {json.dumps(camera["K"])}
distortion = {json.dumps(camera["distortion"])}
T_world_camera = {json.dumps(camera["T_world_camera"])}
strain_sd = 1e-4

[striker]
kind = "{kinds.striker}"
port = "{port}"{kinds.striker_lines}
arm_length_m = {striker["arm_length_m"]}
effective_mass_kg = {striker["effective_mass_kg"]:.4g}
effective_mass_sd_kg = 0.05
restitution = 0.4

[recorder]
pre_trigger_s = 0.1

[daemon]
socket = "{socket}"
"""


@contextlib.contextmanager
def run_folder(prefix: str) -> Iterator[Path]:
    """Temporary folder of a virtual rig's files and sockets, deleted at the end of the block.

    Folders that killed virtual rigs of this user have left are deleted first.

    Args:
        prefix: start of the folder's name; process id and random letters follow.
    """
    remove_leftovers(Path(tempfile.gettempdir()), prefix)
    folder = Path(tempfile.mkdtemp(prefix=f"{prefix}{os.getpid()}-"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_leftovers(temporary: Path, prefix: str) -> None:
    """Delete the folders in `temporary` that this user's killed virtual rigs have left.

    A folder's name holds the process id of its program; folders of running processes stay. The other
    processes of a killed rig end by themselves.

    Args:
        temporary: folder in which the folders lie.
        prefix: start of their names.
    """
    for folder in temporary.glob(f"{prefix}*-*"):
        pid = folder.name.removeprefix(prefix).partition("-")[0]
        with contextlib.suppress(OSError):
            ours = folder.lstat().st_uid == os.getuid() and folder.is_dir() and not folder.is_symlink()
            if ours and pid.isdecimal() and not Path(f"/proc/{pid}").exists():
                shutil.rmtree(folder, ignore_errors=True)


def _write_object(virtual_object: VirtualObject, path: Path) -> None:
    path.write_text(virtual_object.spec_toml, encoding="utf-8")
    if virtual_object.shape_file is not None:
        name, data = virtual_object.shape_file
        (path.parent / name).write_bytes(data)


def refuse_other_address(address: str) -> None:
    """Refuse an address of the virtual camera that is not a loopback address.

    Raises:
        ConfigError: it is another address, or none.
    """
    try:
        fits = ipaddress.IPv4Address(address).is_loopback
    except ValueError:
        fits = False
    if not fits:
        raise ConfigError(
            f"{address}: the virtual camera needs a loopback address: "
            "give one from 127.0.0.1 to 127.255.255.254"
        )
