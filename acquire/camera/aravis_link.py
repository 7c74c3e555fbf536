"""Differences between GigE Vision and USB3 Vision in Aravis: control, clock, and the way to the images.

Each class makes only the calls that its kind of device has; those of the other kind fail (Aravis #781).
"""

from __future__ import annotations

import contextlib
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

from acquire.camera.aravis_library import aravis_and_glib
from acquire.camera.discovery import identify_camera, wait_for_control
from acquire.camera.receive_buffer import enlarge_receive_buffer
from acquire.camera.sender_filter import ForeignPackets, SenderFilter
from acquire.camera.stream_socket import find_udp_socket
from acquire.camera.subnet import not_found_remedy
from acquire.camera.usb_access import denied_remedy, denied_usb_cameras
from acquire.errors import CameraError, CameraNotFound

if TYPE_CHECKING:
    from acquire.clock.clock import Clock
    from schemas.rig import CameraConfig

_LATCH, _LATCH_HIGH, _LATCH_LOW, _TICKS_HIGH, _TICKS_LOW = 0x944, 0x948, 0x94C, 0x93C, 0x940
"""bootstrap registers of GigE Vision: timestamp control, latched value, tick frequency"""
_SOURCE_PORT = 0xD1C
"""bootstrap register: UDP port from which images are sent; 0 where it is not supported"""
_HEARTBEAT_MS, _USUAL_HEARTBEAT_MS = 0x938, 3000
"""bootstrap register: time after which a silent program loses control, and its default (GigE Vision 2.0)"""
_LATCH_NOW = 2
_MOST_SUBMITTED_BYTES = 8 << 20
"""bytes that Aravis submits to the USB bus at most (arvuvstream.c)"""
_ARAVIS_RETENTION_US, _LONGEST_RETENTION_US = 100_000, 1_000_000


class AravisLink(ABC):
    """Connection of one camera, as far as it depends on the kind of device.

    Args:
        config: section `camera` of the rig file.
        clock: the host's clock.
    """

    def __init__(self, config: CameraConfig, clock: Clock) -> None:
        self._config, self._clock = config, clock
        self.warnings: list[str] = []
        """limitations that were found, a line of text each"""
        self.receive_buffer_bytes = 0
        """effective size of the stream's socket buffer; 0 before the stream is made, and without a socket"""
        self.can_latch = False
        """True if the camera's clock can be read, as far as is known"""
        self.stamps_arrival = False
        """True if Aravis stamps frames by this computer's clock as they arrive, for want of the camera's"""

    @abstractmethod
    def wait_for_control(self) -> None:
        """Wait until no other program can hold the camera.

        Raises:
            CameraError: another program holds it.
        """

    @abstractmethod
    def not_connected(self, why: str) -> CameraError:
        """Exception for a camera that Aravis could not open, for the reason `why`."""

    @abstractmethod
    def require_control(self, camera: Any) -> None:
        """Refuse an opened Aravis.Camera that is of the other kind, or that another program controls.

        Raises:
            CameraError: it is of the other kind, or another program controls it.
        """

    @abstractmethod
    def prepare_clock(self, camera: Any) -> None:
        """Find out how the camera's clock is read, and add a warning if it cannot be.

        Raises:
            GLib.Error: the camera does not answer.
        """

    @abstractmethod
    def latch_now(self, device: Any) -> None:
        """Let the camera store its clock's present value.

        Raises:
            GLib.Error: the camera does not answer, or cannot.
        """

    @abstractmethod
    def latched_ns(self, device: Any) -> int:
        """Stored value of the camera's clock [ns]; 0 if it stored none.

        Raises:
            GLib.Error: the camera does not answer, or cannot.
        """

    @abstractmethod
    def prepare_stream(self, camera: Any) -> None:
        """Choose how images are sent, before the stream is made."""

    @abstractmethod
    def tune_stream(self, camera: Any, device: Any, stream: Any) -> None:
        """Prepare a stream that has no buffers yet.

        Raises:
            CameraError: the system refuses.
        """

    @property
    def lost_reason(self) -> str:
        """Reason that Aravis reports by its signal control-lost."""
        return "it left the USB bus"

    @property
    def stream_remedy(self) -> str:
        """Advice where no stream can be opened."""
        return "unplug the camera and plug it in again"

    @property
    def incomplete_remedy(self) -> str:
        """Advice where frames arrive incomplete."""
        return "use a USB 3 port of its own, and a shorter cable"

    def take_foreign_packets(self, *, any_frame: bool) -> ForeignPackets:
        """Packets of other senders since the last call; `any_frame` is True once a frame has arrived."""
        _ = any_frame
        return ForeignPackets()

    @abstractmethod
    def close(self) -> None:
        """Release what was made for the stream."""


class GigeLink(AravisLink):
    """GigE Vision: registers of the protocol, packets over UDP."""

    def __init__(self, config: CameraConfig, clock: Clock) -> None:
        super().__init__(config, clock)
        self._ticks_hz = 0
        self.senders: SenderFilter | None = None
        """filter of the stream's socket; None before the stream is made"""

    def wait_for_control(self) -> None:
        """Wait 3.2 s if a client controls the camera: a killed client loses control within that time.

        Raises:
            CameraError: a client controls it still.
        """
        wait_for_control(self._config.address, self._clock)

    def not_connected(self, why: str) -> CameraError:
        """Exception for a camera that refuses a connection, or that does not answer at all."""
        address = self._config.address
        if identify_camera(address) is not None:
            return CameraError(
                f"camera {address} answers discovery, but refuses a connection ({why}): switch it off and on"
            )
        return CameraNotFound(f"no camera answers at {address} ({why}): {not_found_remedy(address)}")

    def require_control(self, camera: Any) -> None:
        """Refuse a camera that is none of GigE Vision, or of which another program took control.

        The time after which control is lost is set to its default: a debugger leaves minutes, for which a
        killed program would hold the camera; less than Aravis's second between signs of life loses it.

        Raises:
            CameraError: it is on USB, or another program controls it.
        """
        if not camera.is_gv_device():
            raise CameraError(
                f"camera {self._config.address} is not a GigE Vision camera: "
                'write kind = "usb3" in the rig file'
            )
        if not camera.get_device().is_controller():
            raise CameraError(
                f"camera {self._config.address} refused control: another program took control first; "
                "close that program, then try again"
            )
        device, (_, GLib) = camera.get_device(), aravis_and_glib()
        with contextlib.suppress(GLib.Error):  # what does not answer here is noticed at the next setting
            if device.read_register(_HEARTBEAT_MS) != _USUAL_HEARTBEAT_MS:
                device.write_register(_HEARTBEAT_MS, _USUAL_HEARTBEAT_MS)

    def prepare_clock(self, camera: Any) -> None:
        """Read the frequency of the camera's clock; add a warning if the camera does not report it.

        Without that frequency Aravis silently reports system time as the camera's time (Aravis #153).

        Raises:
            GLib.Error: the camera does not answer.
        """
        Aravis, GLib = aravis_and_glib()
        device = camera.get_device()
        try:
            self._ticks_hz = (device.read_register(_TICKS_HIGH) << 32) | device.read_register(_TICKS_LOW)
        except GLib.Error as error:
            if error.matches(Aravis.device_error_quark(), Aravis.DeviceError.TIMEOUT):
                raise
            self._ticks_hz = 0  # not every camera has these registers (Aravis #153)
        self.can_latch = self._ticks_hz > 0
        self.stamps_arrival = not self.can_latch
        if not self.can_latch:
            self.warnings.append(
                f"camera {self._config.address} does not report its clock's frequency: "
                "frame times come from their arrival"
            )

    def latch_now(self, device: Any) -> None:
        """Let the camera store its clock's present value, by a bootstrap register."""
        device.write_register(_LATCH, _LATCH_NOW)

    def latched_ns(self, device: Any) -> int:
        """Stored value of the camera's clock [ns], from its ticks."""
        ticks = (device.read_register(_LATCH_HIGH) << 32) | device.read_register(_LATCH_LOW)
        return ticks * 1_000_000_000 // self._ticks_hz

    def prepare_stream(self, camera: Any) -> None:
        """Take the plain UDP socket.

        As root Aravis takes the packet socket (Aravis #503), whose 5 ms block time-out quantises arrival
        times.
        """
        Aravis, _ = aravis_and_glib()
        camera.gv_set_stream_options(Aravis.GvStreamOption.PACKET_SOCKET_DISABLED)

    def tune_stream(self, camera: Any, device: Any, stream: Any) -> None:
        """Enlarge the receive buffer of the stream's socket, and close it to all senders but the camera.

        Packets that arrived before then become no frame, as the stream has no buffers.

        Raises:
            CameraError: the socket is not found, or the kernel refuses.
        """
        Aravis, _ = aravis_and_glib()
        got = camera.gv_get_packet_size()  # Aravis tests it when the stream is made
        if got != self._config.packet_size:
            self.warnings.append(
                f"packets of {got} B are used instead of {self._config.packet_size} B: larger ones do not "
                "come through; set the interface's MTU to 9000 (`ip link set IFACE mtu 9000`)"
            )
        stream.set_property("socket-buffer", Aravis.GvStreamSocketBuffer.FIXED)
        stream.set_property("frame-retention", self._retention_us())
        # 0 leaves the socket's buffer alone: else Aravis sets it again with every frame (Aravis #994).
        stream.set_property("socket-buffer-size", 0)
        self._prepare_socket(stream.get_port(), device)

    @property
    def lost_reason(self) -> str:
        """Reason that Aravis reports by its signal control-lost: no answer to heartbeats."""
        return "it no longer answers on its control channel"

    @property
    def stream_remedy(self) -> str:
        """Advice where no stream can be opened."""
        return "check that UDP is not blocked by a firewall"

    @property
    def incomplete_remedy(self) -> str:
        """Advice where frames arrive incomplete."""
        return "raise the receive buffer or lower packet_size"

    def take_foreign_packets(self, *, any_frame: bool) -> ForeignPackets:
        """Packets of other senders at the camera's image port since the last call; none of them is used.

        If they come from the camera's own address while no frame has arrived, the camera states a wrong port
        (some do, Aravis 6c2894e10): then packets are checked by their address alone, and a warning is added.
        """
        senders = self.senders
        if senders is None:
            return ForeignPackets()
        found = senders.take_foreign_packets()
        if found.sender is None or any_frame or not senders.port or found.sender[0] != senders.address:
            return found
        self.warnings.append(
            f"camera {senders.address} sends images from UDP port {found.sender[1]}, "
            f"but reports {senders.port}: packets are checked by their address alone"
        )
        senders.accept_any_port()
        return ForeignPackets()

    def close(self) -> None:
        """Release the filter of the stream's socket."""
        if self.senders is not None:
            self.senders.close()

    def _prepare_socket(self, port: int, device: Any) -> None:
        _, GLib = aravis_and_glib()
        try:
            source_port = device.read_register(_SOURCE_PORT) & 0xFFFF
        except GLib.Error:
            source_port = 0
        wanted_bytes, address = self._config.receive_buffer_bytes, self._config.address
        with find_udp_socket(port) as stream:
            self.receive_buffer_bytes = enlarge_receive_buffer(stream, wanted_bytes)
            try:
                self.senders = SenderFilter(stream, address, source_port)
            except OSError as error:
                raise CameraError(
                    f"camera {address}: the image stream cannot be closed to other senders ({error}): "
                    "try again"
                ) from None
        if self.receive_buffer_bytes < wanted_bytes:
            self.warnings.append(
                f"the socket's receive buffer is {self.receive_buffer_bytes} B instead of {wanted_bytes} B: "
                f"frames may be lost; try sysctl -w net.core.rmem_max={wanted_bytes}"
            )

    def _retention_us(self) -> int:
        """Frame retention time [us]: how long an incomplete frame waits for resent packets.

        It is the time in which newer frames fill half of the buffers, because they wait there behind the
        incomplete one; but at least 100 ms and at most 1 s. Aravis's default of 100 ms is too short on a busy
        computer.
        """
        held_us = 1e6 * self._config.buffers / self._config.frame_rate_hz
        return round(min(_LONGEST_RETENTION_US, max(_ARAVIS_RETENTION_US, 0.5 * held_us)))


class UsbLink(AravisLink):
    """USB3 Vision: no registers of its own for the clock, stamps in nanoseconds (Aravis, arvuvstream.c)."""

    def __init__(self, config: CameraConfig, clock: Clock) -> None:
        super().__init__(config, clock)
        self._ns_per_tick = 1

    def wait_for_control(self) -> None:
        """Nothing to wait for: the system takes the camera from a program that ends."""

    def not_connected(self, why: str) -> CameraError:
        """Exception for a camera that is in use, that this user may not open, or that is not there."""
        address = self._config.address
        if "LIBUSB_ERROR_BUSY" in why:
            return CameraError(f"camera {address} is used by another program: close it, then try again")
        if denied := denied_usb_cameras():
            return CameraError(f"camera {address} cannot be opened: {denied_remedy(denied)}")
        return CameraNotFound(
            f"no USB3 Vision camera answers as {address} ({why}): check its cable; `acquire discover` lists "
            "the cameras with their addresses"
        )

    def require_control(self, camera: Any) -> None:
        """Refuse a GigE camera; the system lets only one program open a USB camera.

        Raises:
            CameraError: it is a GigE Vision camera.
        """
        if camera.is_gv_device():
            raise CameraError(
                f'camera {self._config.address} is a GigE Vision camera: write kind = "gige" in the rig file'
            )

    def prepare_clock(self, camera: Any) -> None:
        """Look for the standard feature (SFNC) that latches the clock; add a warning if it is missing."""
        self.can_latch = all(
            camera.is_feature_available(name) for name in ("TimestampLatch", "TimestampLatchValue")
        )
        if self.can_latch and camera.is_feature_available("TimestampIncrement"):
            self._ns_per_tick = max(1, camera.get_integer("TimestampIncrement"))
        if not self.can_latch:
            self.warnings.append(
                f"camera {self._config.address} cannot latch its clock: frame times come from their arrival"
            )

    def latch_now(self, device: Any) -> None:
        """Let the camera store its clock's present value, by its standard feature."""
        device.execute_command("TimestampLatch")

    def latched_ns(self, device: Any) -> int:
        """Stored value of the camera's clock [ns]."""
        return int(device.get_integer_feature_value("TimestampLatchValue")) * self._ns_per_tick

    def prepare_stream(self, camera: Any) -> None:
        """Let the kernel hold the transfers of many images, if there are buffers for them.

        Aravis's default asks for one transfer after the other (0.8.26), so that a camera with a small memory
        loses images while this computer is busy. With fewer bytes of buffers than Aravis submits at a time,
        its thread would wait busily (Aravis 603a33f6a).
        """
        Aravis, _ = aravis_and_glib()
        if not camera.is_uv_device():
            return
        enough = self._config.buffers * camera.get_payload() > _MOST_SUBMITTED_BYTES
        camera.uv_set_usb_mode(Aravis.UvUsbMode.ASYNC if enough else Aravis.UvUsbMode.SYNC)

    def tune_stream(self, camera: Any, device: Any, stream: Any) -> None:
        """Nothing to prepare: the stream has no socket."""

    def close(self) -> None:
        """Nothing to release."""
