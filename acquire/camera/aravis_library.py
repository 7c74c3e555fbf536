"""What is between gi and the camera: Aravis itself, who is there, and what lives and dies with one connection. The only import of gi."""

from __future__ import annotations

import gc
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from acquire.camera.base import CameraInfo
from acquire.camera.discovery import ask
from acquire.errors import CameraError

if TYPE_CHECKING:
    from acquire.camera.buffers import FrameBuffers

_DRAIN_US = 10_000


@cache
def aravis_and_glib() -> tuple[Any, Any]:
    """Aravis and GLib.

    Raises:
        CameraError: the bindings are not installed.
    """
    try:
        import gi

        gi.require_version("Aravis", "0.8")
        from gi.repository import Aravis, GLib  # pyright: ignore[reportAttributeAccessIssue] - made by introspection
    except (ImportError, ValueError) as error:
        raise CameraError(f"Aravis cannot be loaded ({error}): install Debian's gir1.2-aravis-0.8 and the extra percuss[rig]") from None
    return Aravis, GLib


def discover(loopback: str = "127.0.0.1") -> list[CameraInfo]:
    """All cameras that answer a broadcast, and the virtual one at `loopback`. Takes about a second.

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
    virtual = ask(loopback)
    if virtual is not None and all(info.address != virtual.address for info in found):
        found.append(virtual)
    return found


@dataclass
class Connection:
    """All that must die together, in order: the stream writes into `memory`, so `memory` outlives it."""

    camera: Any
    device: Any
    stream: Any
    lost_handler: int
    buffers: list[Any]
    memory: FrameBuffers | None
    """of which `buffers` are the slots"""


def drain(stream: Any, buffers: int) -> None:
    """Give back what was not read; at most all buffers, because a camera that did not hear its stop goes on sending."""
    for _ in range(buffers):
        buffer = stream.timeout_pop_buffer(_DRAIN_US)
        if buffer is None:
            return
        stream.push_buffer(buffer)


def bury(connection: Connection, lost: bool) -> None:
    """Close it. A dead camera blocks for 7.5 s."""
    _, GLib = aravis_and_glib()
    connection.device.disconnect(connection.lost_handler)
    if not lost and connection.stream is not None:
        try:
            connection.camera.stop_acquisition()
        except GLib.Error:
            lost = True
    # The stream's thread writes into the buffers: it must have ended before their memory goes.
    connection.stream = None
    gc.collect()
    connection.camera = connection.device = None
    gc.collect()
    connection.buffers = []


def reason(error: Any) -> str:
    """GLib's, in one line."""
    return str(error.message).strip().replace("\n", " ") or "no reason given"
