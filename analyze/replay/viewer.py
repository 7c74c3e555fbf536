"""rerun's own processes: the viewer, and the server of its web viewer.

Only loopback is used: rerun binds 0.0.0.0 unless it is told otherwise.
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
_STARTS_S, _ENDS_S = 30.0, 5.0
_LEAST_MEMORY = 2 << 30
_PICTURE_SIZE = "1680x1050"
_NO_SCREEN = "neither WAYLAND_DISPLAY nor WAYLAND_SOCKET nor DISPLAY is set"
"""in what the viewer says where it finds none"""
_WITHOUT = "look at it with --web, write a file with --save or a picture with --screenshot"


class ReplayError(AnalyzeError):
    """The viewer cannot be started, or shows nothing."""


@dataclass(frozen=True)
class Viewer:
    """A running process of rerun's."""

    process: subprocess.Popen[bytes]
    port: int
    """of its gRPC server"""
    output: IO[bytes]
    web_port: int | None = None

    @property
    def url(self) -> str:
        """Where data is sent."""
        return f"rerun+http://{LOOPBACK}:{self.port}/proxy"

    @property
    def page(self) -> str:
        """What a browser opens."""
        return f"http://{LOOPBACK}:{self.web_port}/?url=rerun%2Bhttp%3A%2F%2F{LOOPBACK}%3A{self.port}%2Fproxy"

    def ended(self) -> bool:
        """Whether it was closed, or died."""
        return self.process.poll() is not None

    def wait_until_ready(self) -> None:
        """Until it takes data.

        Raises:
            ReplayError: it ended, or does not within `_STARTS_S`.
        """
        for port in [self.port, *([self.web_port] if self.web_port else [])]:
            ends = time.monotonic() + _STARTS_S
            while not _listens(port):
                if self.ended():
                    raise ReplayError(self.why_ended())
                if time.monotonic() > ends:
                    raise ReplayError(f"rerun's viewer does not answer on port {port} of {LOOPBACK}: is the computer very busy?")
                time.sleep(0.02)

    def why_ended(self) -> str:
        """One line."""
        self.output.seek(0)
        last = [line for line in self.output.read().decode(errors="replace").splitlines() if line.strip()][-1:]
        if any(_NO_SCREEN in line for line in last):
            return f"no screen here (DISPLAY is not set): {_WITHOUT}"
        return (
            f"rerun's viewer ended with code {self.process.returncode} {' '.join(last)}: no screen, or no Vulkan driver "
            f"(mesa-vulkan-drivers)? {_WITHOUT}"
        )


@contextmanager
def native(recording_bytes: int, files: Sequence[Path] = (), *, headless: bool = False, port: int | None = None) -> Iterator[Viewer]:
    """The viewer in a window of its own, or without any screen; it is gone with the context.

    Args:
        recording_bytes: size of what is replayed, for the memory limit.
        files: what it opens by itself.
        headless: draw to nowhere, for pictures.
        port: that it listens on; None: any.
    """
    port = port or _free_port()
    options = ["--hide-welcome-screen", "--memory-limit", _limit(recording_bytes), "--server-memory-limit", "64MB"]
    if headless:
        options += ["--headless", "--window-size", _PICTURE_SIZE]
    elif not files:
        options.append("--expect-data-soon")
    with _started([*map(str, files), "--bind", LOOPBACK, "--port", str(port), *options], port) as viewer:
        yield viewer


@contextmanager
def web(recording_bytes: int) -> Iterator[Viewer]:
    """The web viewer and the data, served on loopback; it is gone with the context."""
    port, web_port = _free_port(), _free_port()
    options = ["--serve-web", "--bind", LOOPBACK, "--port", str(port), "--web-viewer-port", str(web_port)]
    # a browser may come late or come again: what was sent has to be kept
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
            # a Ctrl-C on the terminal is ours: we end it when we are ready
            start_new_session=True,
            env={name: value for name, value in os.environ.items() if name != "RUST_LOG"},
        )
        try:
            yield Viewer(process, port, output, web_port)
        finally:
            process.terminate()
            try:
                process.wait(_ENDS_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@contextmanager
def _end_on_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end us as Ctrl-C does, so that no viewer is left behind."""

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
    # below what is shown, images vanish silently
    return f"{max(_LEAST_MEMORY, 4 * recording_bytes) >> 20}MB"


def _executable() -> str:
    """The viewer itself: `python -m rerun` would start it as a child that outlives its parent's end."""
    folder = Path(rerun_cli.__file__).parent
    found = next((folder / name for name in ("rerun", "rerun.exe") if (folder / name).exists()), None)
    if found is None:
        raise ReplayError(f"{folder}: holds no rerun viewer: install rerun-sdk again")
    return str(found)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((LOOPBACK, port)) == 0
