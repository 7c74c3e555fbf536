"""USB3 Vision cameras that are plugged in, but that this user may not open, by the library libusb.

Aravis leaves them out of its list without a word. Structures and numbers: libusb.h of version 1.0.26; classes
of interfaces: Aravis 0.8.26, arvuvinterfaceprivate.h.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_LIBRARY = "libusb-1.0.so.0"
"""the library that Aravis has loaded"""
_ACCESS = -3
_VISION = (0xEF, 0x05)
"""class and subclass of the interfaces of USB3 Vision"""


class _InterfaceDescriptor(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint8) for name in ("length", "type", "number", "alternate", "endpoints")),
        *((name, ctypes.c_uint8) for name in ("class_code", "subclass", "protocol", "index")),
    ]


class _Interface(ctypes.Structure):
    _fields_ = [("alternatives", ctypes.POINTER(_InterfaceDescriptor)), ("count", ctypes.c_int)]


class _Configuration(ctypes.Structure):
    _fields_ = [
        *((name, ctypes.c_uint8) for name in ("length", "type")),
        ("total", ctypes.c_uint16),
        *((name, ctypes.c_uint8) for name in ("interfaces", "value", "index", "attributes", "power")),
        ("interface", ctypes.POINTER(_Interface)),
    ]


def denied_usb_cameras() -> list[str]:
    """Paths, as /dev/bus/usb/002/009, of USB3 Vision cameras that this user may not open."""
    try:
        library = ctypes.CDLL(_LIBRARY)
    except OSError:  # Aravis was built without USB
        return []
    library.libusb_get_device_list.restype = ctypes.c_ssize_t
    with _devices(library) as devices:
        return [
            f"/dev/bus/usb/{library.libusb_get_bus_number(each):03}/"
            f"{library.libusb_get_device_address(each):03}"
            for each in devices
            if _is_camera(library, each) and _is_denied(library, each)
        ]


def denied_remedy(paths: list[str]) -> str:
    """Reason and advice for cameras, at least one, that this user may not open."""
    return (
        f"this user may not open the USB3 Vision camera {', '.join(paths)} (LIBUSB_ERROR_ACCESS): copy "
        "docs/99-percuss.rules to /etc/udev/rules.d, join the group video (`sudo usermod -aG video $USER`), "
        "log in again and plug the camera in again"
    )


@contextmanager
def _devices(library: Any) -> Iterator[list[ctypes.c_void_p]]:
    """Devices (libusb_device *) of all USB buses, valid in the block."""
    context, listed = ctypes.c_void_p(), ctypes.POINTER(ctypes.c_void_p)()
    if library.libusb_init(ctypes.byref(context)) != 0:
        yield []
        return
    count = library.libusb_get_device_list(context, ctypes.byref(listed))
    try:
        yield [ctypes.c_void_p(listed[index]) for index in range(count)]
    finally:
        if count >= 0:
            library.libusb_free_device_list(listed, 1)
        library.libusb_exit(context)


def _is_camera(library: Any, device: ctypes.c_void_p) -> bool:
    """True if an interface of the device is one of USB3 Vision."""
    found = ctypes.POINTER(_Configuration)()
    if library.libusb_get_config_descriptor(device, ctypes.c_uint8(0), ctypes.byref(found)) != 0:
        return False
    interfaces = [found.contents.interface[index] for index in range(found.contents.interfaces)]
    codes = [
        (each.alternatives[0].class_code, each.alternatives[0].subclass) for each in interfaces if each.count
    ]
    library.libusb_free_config_descriptor(found)
    return _VISION in codes


def _is_denied(library: Any, device: ctypes.c_void_p) -> bool:
    """True if this user may not open the device."""
    handle = ctypes.c_void_p()
    status = library.libusb_open(device, ctypes.byref(handle))
    if status == 0:
        library.libusb_close(handle)
    return status == _ACCESS
