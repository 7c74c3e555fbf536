"""Stand-in for libusb-1.0, through which Aravis meets a virtual USB device.

It is compiled into the folder of the device's socket, where programs find it by LD_LIBRARY_PATH: in them, and
only in them, it takes the place of the system's library.
"""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Final

from acquire.errors import CameraError

FOLDER: Final = "usb"
"""folder of library and socket in the folder of a virtual rig"""
LIBRARY, SOCKET = "libusb-1.0.so.0", "bus.sock"
_SOURCE = Path(__file__).with_name("usb_library.c")


def compile_library(folder: Path) -> Path:
    """Compile the stand-in into a folder, which is created if missing; return its path.

    Raises:
        CameraError: there is no compiler, or it failed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / LIBRARY
    options = ["-O2", "-shared", "-fPIC", "-pthread", f"-Wl,-soname,{LIBRARY}"]
    try:
        done = subprocess.run(
            ["gcc", *options, "-o", str(path), str(_SOURCE)], check=False, capture_output=True, text=True
        )
    except FileNotFoundError:
        raise CameraError("the virtual USB camera needs a C compiler: install Debian's gcc") from None
    if done.returncode != 0:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[0]
        raise CameraError(
            f"the virtual USB camera's library cannot be compiled ({reason}): "
            "install Debian's gcc and libc6-dev"
        )
    return path


def library_environment(folder: Path) -> dict[str, str]:
    """Environment variables of a program that is to meet the device whose library is in `folder`."""
    others = os.environ.get("LD_LIBRARY_PATH", "")
    return {"LD_LIBRARY_PATH": f"{folder}:{others}" if others else str(folder)}
