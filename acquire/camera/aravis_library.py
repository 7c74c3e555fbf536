"""Aravis through GObject introspection: loading, discovery, objects of a connection. Only import of gi."""

from __future__ import annotations

import gc
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from acquire.camera.base import CameraInfo
from acquire.camera.discovery import identify_camera
from acquire.errors import CameraError

if TYPE_CHECKING:
    from acquire.frames.buffer_pool import BufferPool

_DRAIN_US = 10_000


@cache
def aravis_and_glib() -> tuple[Any, Any]:
    """Load the bindings of Aravis and GLib.

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
            "install Debian's gir1.2-aravis-0.8 and the extra percuss[rig]"
        ) from None
    return Aravis, GLib


def discover(loopback: str = "127.0.0.1") -> list[CameraInfo]:
    """List all cameras that answer a broadcast, and the virtual one at `loopback`. Takes about a second.

    Raises:
        CameraError: Aravis is not installed.
    """
    Aravis, _ = aravis_and_glib()
    Aravis.update_device_list()
    found = [
        CameraInfo(
            vendor=Aravis.get_device_vendor(index) or "",
            model=Aravis.get_device_model(index) or "",
            serial=Aravis.get_device_serial_nbr(index) or "",
            address=Aravis.get_device_address(index) or Aravis.get_device_id(index),
        )
        for index in range(Aravis.get_n_devices())
        if Aravis.get_device_protocol(index) == "GigEVision"
    ]
    virtual = identify_camera(loopback)
    if virtual is not None and all(info.address != virtual.address for info in found):
        found.append(virtual)
    return found


@dataclass
class Connection:
    """Objects that are closed together, in order: the stream writes into `memory`, which must outlive it."""

    camera: Any
    device: Any
    stream: Any
    lost_handler: int
    buffers: list[Any]
    memory: BufferPool | None
    """pool whose slots are `buffers`"""


def drain(stream: Any, buffers: int) -> None:
    """Return the frames that were not read to the stream.

    At most `buffers` are returned, because a camera that missed its stop command goes on sending.
    """
    for _ in range(buffers):
        buffer = stream.timeout_pop_buffer(_DRAIN_US)
        if buffer is None:
            return
        stream.push_buffer(buffer)


def close_connection(connection: Connection, lost: bool) -> None:
    """Close a connection. Blocks for 7.5 s if the camera is dead."""
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
    """Message of a GLib error, in one line."""
    return str(error.message).strip().replace("\n", " ") or "no reason given"
