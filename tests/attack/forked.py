"""Runs a command of `acquire` or `analyze` in a forked child, within limits of time and memory.

A fork of a process that has imported everything costs some hundredths of a second, a new interpreter a
second.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import pkgutil
import resource
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CPU_S = 20.0
"""longest time of the processor that a command may take on a damaged file [s]"""
WALL_S = 120.0
"""time after which a command counts as hanging [s], on a machine that does other work beside it"""
MEMORY_BYTES = 1 << 30
"""largest memory that a command may take beside what is imported [bytes]"""
_ADDRESS_BYTES = 6 << 30
"""address space beside the parent's, above which a command is refused memory [bytes]"""
CRASHED = 70
"""exit code of a command that ended with an exception"""


@dataclass(frozen=True)
class Outcome:
    """How a command ended: code, time, memory, and what it wrote."""

    code: int
    """exit code; negative: ended by this signal"""
    cpu_s: float
    """time of the processor [s]"""
    wall_s: float
    memory_bytes: int
    """largest resident memory beside that of the parent [bytes]"""
    output: str
    """standard output"""
    complaint: str
    """standard error"""
    hung: bool
    """True if it was ended after WALL_S"""


def import_everything() -> None:
    """Import every module of the project that can be imported here, and the libraries that they use late."""
    for package in ("schemas", "acquire", "analyze"):
        root = importlib.import_module(package)
        for module in pkgutil.walk_packages(root.__path__, f"{package}."):
            if not module.name.endswith("__main__"):
                with contextlib.suppress(ImportError, SystemExit, ValueError):
                    importlib.import_module(module.name)
    for name in ("lz4.frame", "zstandard", "trimesh.exchange.load", "mcap.reader", "av", "scipy.optimize"):
        with contextlib.suppress(ImportError):
            importlib.import_module(name)


def run_forked(call: Callable[[], object], folder: Path, scratch: Path) -> Outcome:
    """Run `call` in a child whose working folder is `folder`, and report how it ended.

    Args:
        call: function to run; SystemExit gives the exit code, any other exception CRASHED.
        folder: working folder of the child.
        scratch: folder for what the child writes to its standard output and error.
    """
    out, err, begin = scratch / "out", scratch / "err", scratch / "begin"
    begin.write_text("", encoding="ascii")
    address = _memory()[0]
    sys.stdout.flush()
    start = time.monotonic()
    pid = os.fork()
    if pid == 0:
        begin.write_text(str(_memory()[1]), encoding="ascii")
        _be_child(call, folder, out, err, address + _ADDRESS_BYTES)
    hung = False
    while True:
        done, status, used = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if not hung and time.monotonic() - start > WALL_S:
            hung = True
            _end_group(pid)
        time.sleep(0.003)
    _end_group(pid)  # whatever it started
    return Outcome(
        os.waitstatus_to_exitcode(status),
        used.ru_utime + used.ru_stime,
        time.monotonic() - start,
        max(0, used.ru_maxrss * 1024 - int(begin.read_text(encoding="ascii") or 0)),
        out.read_text(encoding="utf-8", errors="replace"),
        err.read_text(encoding="utf-8", errors="replace"),
        hung,
    )


def _memory() -> tuple[int, int]:
    """Address space and resident memory of this process [bytes]."""
    size, resident = Path("/proc/self/statm").read_text(encoding="ascii").split()[:2]
    return int(size) * resource.getpagesize(), int(resident) * resource.getpagesize()


def _end_group(pid: int) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, signal.SIGKILL)


def _be_child(call: Callable[[], object], folder: Path, out: Path, err: Path, address_bytes: int) -> None:
    """Run `call` as the child, and end the process."""
    code = CRASHED
    try:
        os.setsid()
        os.chdir(folder)
        for number, path in ((1, out), (2, err)):
            fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(fd, number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        limit = int(CPU_S) + 10
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit))
        resource.setrlimit(resource.RLIMIT_AS, (address_bytes, address_bytes))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        call()
        code = 0
    except SystemExit as error:
        code = error.code if isinstance(error.code, int) else int(error.code is not None)
        if isinstance(error.code, str):
            sys.stderr.write(f"{error.code}\n")
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        with contextlib.suppress(Exception):
            sys.stderr.flush()
        os._exit(code)
