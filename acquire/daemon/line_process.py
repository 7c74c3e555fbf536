"""Child process that reads and writes JSON lines on its standard input and output."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from typing import Any

from schemas.document import Document, canonical_json


class LineProcess:
    """Child process `python -m MODULE ...` that answers JSON lines with JSON lines.

    Args:
        arguments: module and its arguments.
        on_line: called with each JSON object that the child writes, in a thread of its own; a ValueError
            that it raises is ignored, as the line is then none of the protocol.
        on_end: called in that thread when the child has closed its output.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        on_line: Callable[[dict[str, Any]], None],
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self._on_line, self._on_end = on_line, on_end
        self._process = subprocess.Popen(
            [sys.executable, "-m", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            start_new_session=True,  # only the daemon handles a terminal's Ctrl-C
        )
        self._reader = threading.Thread(target=self._read, name="line-process")
        self._reader.start()

    @property
    def alive(self) -> bool:
        """True while the child runs."""
        return self._process.poll() is None

    @property
    def pid(self) -> int:
        """Process id of the child."""
        return self._process.pid

    def send(self, document: Document) -> None:
        """Write a line to the child; nothing happens if it has ended."""
        with contextlib.suppress(OSError, ValueError):
            if self._process.stdin is not None:
                self._process.stdin.write(canonical_json(document) + "\n")
                self._process.stdin.flush()

    def close(self) -> None:
        """Terminate the child, which has nothing to save, and end the thread that reads from it."""
        self._process.terminate()
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        try:
            self._process.wait(3.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout is not None  # noqa: S101 - opened with PIPE
        for line in self._process.stdout:
            with contextlib.suppress(ValueError, RecursionError):  # not a line of the protocol
                data = json.loads(line)
                if isinstance(data, dict):
                    self._on_line(data)
        self._on_end()
