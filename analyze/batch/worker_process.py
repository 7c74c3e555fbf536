"""Worker process that analyses one recording after the other, within limits of time and memory."""

from __future__ import annotations

import contextlib
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from analyze.batch.worker_messages import DIED, OUT_OF_MEMORY, TIME_LIMIT, Outcome, Request, write_failure
from analyze.errors import ArchiveError

SCRATCH = "unfinished"
"""folder of the results for unfinished files"""
ONE_THREAD_ENVIRONMENT = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
"""variables that limit numerical libraries to one thread: results must not depend on the number of workers,
and several threads would compete for the cores"""
ERROR_TAIL_BYTES = 2000


class WorkerStoppedError(Exception):
    """The worker process was stopped before it finished an analysis; the recording has no outcome."""


@dataclass(frozen=True)
class Limits:
    """Limits of time and memory for the analysis of one recording."""

    seconds: float = 900.0
    """longest time that an analysis may take [s]"""
    memory_bytes: int = 4 << 30
    """largest data memory of the worker process [bytes]; 0 for no limit"""


class WorkerProcess:
    """Worker process that analyses recordings one after the other, within limits of time and memory.

    It is started when first needed, and again after it ended. Used by one thread; `stop` may be called from
    another. A context manager that ends the process.

    Args:
        output: folder of the results; a folder for unfinished files is created in it.
        limits: limits of time and memory per recording.
    """

    def __init__(self, output: Path, limits: Limits) -> None:
        self._limits = limits
        (output / SCRATCH).mkdir(parents=True, exist_ok=True)
        self.scratch = Path(
            tempfile.mkdtemp(prefix=f"{socket.gethostname()}-{os.getpid()}-", dir=output / SCRATCH)
        )
        """folder for the worker process's unfinished files, on the disk of the results"""
        self._errors = (self.scratch / "errors").open("a+b", buffering=0)
        self._process: subprocess.Popen[bytes] | None = None
        self._stopped = False

    def analyse(self, request: Request) -> Outcome:
        """Analyse one recording; if the process ends or takes too long, write a failure row.

        Returns:
            Outcome of the recording, which may be a failure.

        Raises:
            WorkerStoppedError: `stop` was called.
            ArchiveError: the results cannot be written, or the object file changed during the run.
        """
        start = time.monotonic()
        process = self._running()
        assert process.stdin is not None  # noqa: S101 - a pipe
        self._errors.truncate(0)  # messages about earlier recordings do not concern this one
        try:
            process.stdin.write(json.dumps(asdict(request)).encode() + b"\n")
            process.stdin.flush()
            answer = self._answer(process, start + self._limits.seconds)
        except (BrokenPipeError, EOFError):
            return self._failure(request, time.monotonic() - start)
        except TimeoutError:
            self._end()
            limit = f"took more than {self._limits.seconds:.0f} s"
            text = f"{request.source.url}: {limit}: raise --time-limit and add --only-failed"
            return write_failure(request, TIME_LIMIT, text, time.monotonic() - start, self._emptied_scratch())
        if "error" in answer:
            raise ArchiveError(answer["error"])
        return Outcome(**answer)

    def stop(self) -> None:
        """Kill the worker process for good; `analyse`, waiting or called later, raises WorkerStoppedError."""
        self._stopped = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """Kill the worker process for good and remove its unfinished files."""
        self.stop()
        self._end()
        self._errors.close()
        shutil.rmtree(self.scratch, ignore_errors=True)

    def __enter__(self) -> WorkerProcess:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _running(self) -> subprocess.Popen[bytes]:
        if self._stopped:
            raise WorkerStoppedError
        if self._process is None or self._process.poll() is not None:
            self._end()
            command = [
                sys.executable,
                "-m",
                "analyze.batch.worker_main",
                str(self._emptied_scratch()),
                str(self._limits.memory_bytes),
                str(os.getpid()),
            ]
            # In a session of its own the process does not get Ctrl-C: the run stops it in order.
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                env=os.environ | ONE_THREAD_ENVIRONMENT,
                start_new_session=True,
            )
            if self._stopped:
                self._process.kill()
        return self._process

    def _answer(self, process: subprocess.Popen[bytes], until: float) -> dict[str, Any]:
        assert process.stdout is not None  # noqa: S101 - a pipe
        descriptor, line = process.stdout.fileno(), b""
        while not line.endswith(b"\n"):
            ready, _, _ = select.select([descriptor], [], [], max(0.0, until - time.monotonic()))
            if not ready:
                raise TimeoutError
            more = os.read(descriptor, 1 << 16)
            if not more:
                raise EOFError
            line += more
        answer = json.loads(line)
        assert isinstance(answer, dict)  # noqa: S101 - the worker writes nothing else
        return answer

    def _failure(self, request: Request, seconds: float) -> Outcome:
        if self._stopped:
            raise WorkerStoppedError
        assert self._process is not None  # noqa: S101 - it ran
        code = self._process.wait()
        url, last = request.source.url, self._last_line()
        kind = OUT_OF_MEMORY
        if code == -signal.SIGKILL:
            text = "its worker was killed, as the system does when memory runs out"
        elif "memory" in last.lower() or "bad_alloc" in last:
            text = "needs more memory than a worker may use: raise --memory-limit and add --only-failed"
        else:
            how = f"by {signal.Signals(-code).name}" if code < 0 else f"with code {code}"
            kind, text = DIED, f"its worker ended {how} {last}".strip()
        return write_failure(request, kind, f"{url}: {text}", seconds, self._emptied_scratch())

    def _last_line(self) -> str:
        self._errors.seek(0, os.SEEK_END)
        self._errors.seek(max(0, self._errors.tell() - ERROR_TAIL_BYTES))
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""

    def _emptied_scratch(self) -> Path:
        for left in self.scratch.iterdir():
            if left.name != "errors":
                left.unlink(missing_ok=True)
        return self.scratch

    def _end(self) -> None:
        process = self._process
        if process is None:
            return
        if process.poll() is None:
            process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            # Unread output is lost, which does not matter any more.
            with contextlib.suppress(OSError, ValueError):
                if pipe is not None:
                    pipe.close()
