"""Aravis through GObject introspection: loading, discovery, objects of a connection.

This is the only module that imports gi.
"""

from __future__ import annotations

import gc
import warnings
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from acquire.camera.base import CameraInfo
from acquire.camera.discovery import identify_camera
from acquire.errors import CameraError
from schemas.software import extra_command

if TYPE_CHECKING:
    from acquire.frames.buffer_pool import BufferPool
    from schemas.camera_kind import CameraKindName

_DRAIN_US = 10_000
_KINDS: dict[str, CameraKindName] = {"GigEVision": "gige", "USB3Vision": "usb3"}
"""kind of camera in the rig file, by Aravis's name of the protocol"""


@cache
def aravis_and_glib() -> tuple[Any, Any]:
    """Load the Python bindings of Aravis and GLib, and return these two modules in that order.

    Raises:
        CameraError: the bindings are not installed.
    """
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        # The modules are made by introspection.
        from gi.repository import Aravis, GLib  # pyright: ignore[reportAttributeAccessIssue]
    except (ImportError, ValueError) as error:
        raise CameraError(
            f"Aravis cannot be loaded ({error}): "
            f"install Debian's gir1.2-aravis-0.8, then {extra_command('rig')}"
        ) from None
    # A USB camera that cannot be opened: Aravis 0.8.26 joins a thread that was never started (3c217bfac).
    warnings.filterwarnings("ignore", message="g_thread_join")
    return Aravis, GLib


def discover(loopback: str = "127.0.0.1") -> list[CameraInfo]:
    """List the GigE and USB3 Vision cameras that answer, and a virtual camera at a loopback address.

    Takes about a second.

    Args:
        loopback: IP address that is asked for a virtual camera, because loopback carries no broadcasts.

    Returns:
        Identities of the cameras; empty if none answers.

    Raises:
        CameraError: Aravis's Python bindings are not installed.
    """
    Aravis, _ = aravis_and_glib()
    Aravis.update_device_list()
    found = [
        CameraInfo(
            vendor=Aravis.get_device_vendor(index) or "",
            model=Aravis.get_device_model(index) or "",
            serial=Aravis.get_device_serial_nbr(index) or "",
            address=_address(Aravis, index),
            kind=_KINDS[Aravis.get_device_protocol(index)],
        )
        for index in range(Aravis.get_n_devices())
        if Aravis.get_device_protocol(index) in _KINDS
    ]
    virtual = identify_camera(loopback)
    if virtual is not None and all(info.address != virtual.address for info in found):
        found.append(virtual)
    return found


def _address(Aravis: Any, index: int) -> str:
    """Address of a found camera: its IP address, or its device id where it has none (USB)."""
    device_id = Aravis.get_device_id(index) or ""
    if Aravis.get_device_protocol(index) == "USB3Vision":
        return device_id
    return Aravis.get_device_address(index) or device_id


@dataclass
class Connection:
    """Aravis objects of one camera that are released together: stream, camera and device, then buffers.

    The stream writes images into `memory`, the memory of the buffers, which must outlive the stream.
    """

    camera: Any
    """Aravis.Camera; None once closed"""
    device: Any
    """Aravis.Device of the camera; None once closed"""
    stream: Any
    """Aravis.Stream; None before it is made and once closed"""
    lost_handler: int
    """id of the handler of the device's signal control-lost"""
    buffers: list[Any]
    """Aravis.Buffer objects of the stream"""
    memory: BufferPool | None
    """pool whose slots are the memory of `buffers`; None before the stream is made"""


def drain(stream: Any, buffers: int) -> None:
    """Drop frames that were not read: return their buffers to the Aravis stream.

    Ends when no frame arrives for 10 ms, or after `buffers` (a number of) frames, because a camera that
    missed its stop command goes on sending.
    """
    for _ in range(buffers):
        buffer = stream.timeout_pop_buffer(_DRAIN_US)
        if buffer is None:
            return
        stream.push_buffer(buffer)


def close_connection(connection: Connection, lost: bool) -> None:
    """Stop acquisition and release the objects of a connection, in place.

    Blocks for 7.5 s if the camera is dead.

    Args:
        connection: objects to release; its camera, device and stream are None afterwards, its `buffers` an
            empty list.
        lost: True if the camera is known not to answer; it is then not asked to stop.
    """
    _, GLib = aravis_and_glib()
    connection.device.disconnect(connection.lost_handler)
    if not lost and connection.stream is not None:
        try:
            connection.camera.stop_acquisition()
        except GLib.Error:
            lost = True
    # The stream's thread writes into the buffers: it must have ended before their memory is freed.
    connection.stream = None
    gc.collect()
    connection.camera = connection.device = None
    gc.collect()
    connection.buffers = []


def reason(error: Any) -> str:
    """Message of a GLib error as one line of text; "no reason given" if it is empty."""
    return str(error.message).strip().replace("\n", " ") or "no reason given"
