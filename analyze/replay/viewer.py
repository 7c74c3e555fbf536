"""Processes of the viewer rerun: its window, and the server of its web viewer.

They listen on loopback only, which has to be requested: rerun binds 0.0.0.0 by default.
"""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import IO

import rerun_cli

from analyze.errors import AnalyzeError

LOOPBACK = "127.0.0.1"
_START_TIMEOUT_S, _END_TIMEOUT_S = 30.0, 5.0
_MIN_MEMORY_BYTES = 2 << 30
_PICTURE_SIZE = "1680x1050"
_NO_SCREEN = "neither WAYLAND_DISPLAY nor WAYLAND_SOCKET nor DISPLAY is set"
"""Part of the viewer's output when it finds no screen."""
_WITHOUT_SCREEN = "use --web for a browser, --save for a file or --screenshot for a picture"


class ReplayError(AnalyzeError):
    """A replay cannot be shown or written: viewer, output file, or a missing strike or page (tab)."""


@dataclass(frozen=True)
class Viewer:
    """Running process of rerun: the native viewer, or the server of the web viewer."""

    process: subprocess.Popen[bytes]
    """The process."""
    port: int
    """Port of its gRPC server, which takes the data."""
    output: IO[bytes]
    """File that its standard output and error are written to."""
    web_port: int | None = None
    """Port of the web viewer's page; None for the native viewer."""

    @property
    def url(self) -> str:
        """Address at which the viewer accepts data, in rerun's form."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    @property
    def page(self) -> str:
        """Address of the web viewer's page; meaningful only if `web_port` is set."""
        return f"http://{LOOPBACK}:{self.web_port}/?url=rerun%2Bhttp%3A%2F%2F{LOOPBACK}%3A{self.port}%2Fproxy"

    def ended(self) -> bool:
        """True if the viewer's process has ended: it was closed, or has failed."""
        return self.process.poll() is not None

    def wait_until_ready(self) -> None:
        """Wait until the viewer accepts data on its ports.

        Raises:
            ReplayError: the process ended, or does not accept data within 30 s per port.
        """
        for port in [self.port, *([self.web_port] if self.web_port else [])]:
            deadline = time.monotonic() + _START_TIMEOUT_S
            while not _listens(port):
                if self.ended():
                    raise ReplayError(self.why_ended())
                if time.monotonic() > deadline:
                    raise ReplayError(
                        f"rerun's viewer does not answer on port {port} of {LOOPBACK}: is the computer very "
                        "busy?"
                    )
                time.sleep(0.02)

    def why_ended(self) -> str:
        """Reason why the viewer's process ended, from the last line of its output, and the remedy."""
        self.output.seek(0)
        last = [line for line in self.output.read().decode(errors="replace").splitlines() if line.strip()][
            -1:
        ]
        if any(_NO_SCREEN in line for line in last):
            return f"no screen found (DISPLAY is not set): {_WITHOUT_SCREEN}"
        return (
            f"rerun's viewer ended with code {self.process.returncode} {' '.join(last)}: no screen, or no "
            f"Vulkan driver (mesa-vulkan-drivers)? {_WITHOUT_SCREEN}"
        )


@contextmanager
def native_viewer(
    recording_bytes: int, files: Sequence[Path] = (), *, headless: bool = False, port: int | None = None
) -> Iterator[Viewer]:
    """Run the viewer rerun in a window, or without a screen, for the duration of a `with` block.

    Args:
        recording_bytes: size of the recording, from which the memory limit follows.
        files: files that the viewer opens at its start.
        headless: True to run without a screen, for pictures.
        port: port to listen on; None for any free one.

    Yields:
        The running process, which may not accept data yet.

    Raises:
        ReplayError: rerun's viewer is not installed.
    """
    port = port or _free_port()
    options = [
        "--hide-welcome-screen",
        "--memory-limit",
        _limit(recording_bytes),
        "--server-memory-limit",
        "64MB",
    ]
    if headless:
        options += ["--headless", "--window-size", _PICTURE_SIZE]
    elif not files:
        options.append("--expect-data-soon")
    with _started([*map(str, files), "--bind", LOOPBACK, "--port", str(port), *options], port) as viewer:
        yield viewer


@contextmanager
def web_viewer(recording_bytes: int) -> Iterator[Viewer]:
    """Serve rerun's web viewer and its data on loopback for the duration of a `with` block.

    Args:
        recording_bytes: size of the recording, from which the memory limit follows.

    Yields:
        The running server, which may not accept data yet.

    Raises:
        ReplayError: rerun's viewer is not installed.
    """
    port, web_port = _free_port(), _free_port()
    options = ["--serve-web", "--bind", LOOPBACK, "--port", str(port), "--web-viewer-port", str(web_port)]
    # A browser may connect late or again: the data sent so far has to be kept.
    with _started([*options, "--server-memory-limit", _limit(recording_bytes)], port, web_port) as viewer:
        yield viewer


@contextmanager
def _started(arguments: list[str], port: int, web_port: int | None = None) -> Iterator[Viewer]:
    with _end_on_signals(), tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [_executable(), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            # Ctrl-C on the terminal must not reach the viewer: this process ends it.
            start_new_session=True,
            env={name: value for name, value in os.environ.items() if name != "RUST_LOG"},
        )
        try:
            yield Viewer(process, port, output, web_port)
        finally:
            process.terminate()
            try:
                process.wait(_END_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextmanager
def _end_on_signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into KeyboardInterrupt in a `with` block, so that no viewer keeps running.

    Outside the main thread, which alone can handle signals, nothing changes.
    """

    def interrupt(_number: int, _frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.signal(number, interrupt) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _limit(recording_bytes: int) -> str:
    # With a limit below the size of the data, rerun drops images silently.
    return f"{max(_MIN_MEMORY_BYTES, 4 * recording_bytes) >> 20}MB"


def _executable() -> str:
    """Path of rerun's viewer program, to be run directly.

    `python -m rerun` would start the program as a child process, which outlives its parent.

    Raises:
        ReplayError: the package rerun_cli holds no viewer.
    """
    folder = Path(rerun_cli.__file__).parent
    found = next((folder / name for name in ("rerun", "rerun.exe") if (folder / name).exists()), None)
    if found is None:
        raise ReplayError(f"{folder}: has no rerun viewer: install rerun-sdk again")
    return str(found)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((LOOPBACK, port)) == 0
