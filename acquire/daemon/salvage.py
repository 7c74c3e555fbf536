"""Makes a whole file of what a dead capture process left, while the recording goes on in the next one, and says what is lost between."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from acquire.errors import RecorderError
from acquire.recorder.frame_times import FrameTimes
from acquire.recorder.writer import PART_SUFFIX

_NICENESS = 10
"""below the camera's process, which it may share a core with"""


@dataclass(frozen=True)
class Salvaged:
    """What became of the files of a dead process."""

    files: tuple[Path, ...]
    """whole; of one that could not be rebuilt, the `.part`"""
    frames: int
    lost: int
    """in them, and up to the first frame of the next file"""
    text: str
    """for the log and for people"""


class Salvage:
    """The `.part` files of a dead process, in a process and a thread of its own.

    Args:
        files: what it wrote, in order, by the names that they have when they are whole; those that are need nothing but to be counted.
        camera: whose frames are counted.
        frame_rate_hz: to tell from a gap how many frames it is.
        next_frame_ns: waits for the next file's first frame, gives its log time; None where none comes.
        on_end: hears what became of it.
    """

    def __init__(
        self,
        files: Sequence[Path],
        camera: str,
        frame_rate_hz: float,
        next_frame_ns: Callable[[], int | None],
        on_end: Callable[[Salvaged], None] = lambda _: None,
    ) -> None:
        self._files = files
        self._camera = camera
        self._rate = frame_rate_hz
        self._next_frame_ns = next_frame_ns
        self._on_end = on_end
        self._found = Salvaged((), 0, 0, "nothing was rebuilt")
        self._thread = threading.Thread(target=self._run, name="salvage")
        self._thread.start()

    def result(self) -> Salvaged:
        """Waits for it."""
        self._thread.join()
        return self._found

    def _run(self) -> None:
        next_ns = self._next_frame_ns()  # now: the next file may be closed when these are rebuilt
        frames = lost = 0
        last_ns: int | None = None
        kept: list[Path] = []
        said: list[str] = []
        for whole in self._files:
            part = Path(f"{whole}{PART_SUFFIX}")
            if not part.exists() and not whole.exists():
                continue  # deleted, as the oldest of a ring
            try:
                more = self._recover(part, whole) if part.exists() else ""
                times = FrameTimes.of(whole, self._camera)
            except (RecorderError, OSError) as error:
                kept.append(part)
                said.append(f"{part.name} could not be rebuilt: {error}")
                continue
            kept.append(whole)
            said.append(f"{whole.name} is whole: {times.frames} frames{more}")
            frames += times.frames
            lost += times.lost
            last_ns = times.last_ns or last_ns
        if last_ns is not None and next_ns is not None:
            gap_s = (next_ns - last_ns) * 1e-9
            missing = max(0, round(gap_s * self._rate) - 1)
            lost += missing
            said.append(f"after it {gap_s:.1f} s are lost, {missing} frames")
        self._found = Salvaged(tuple(kept), frames, lost, "; ".join(said) or self._found.text)
        self._on_end(self._found)

    def _recover(self, part: Path, whole: Path) -> str:
        """Run `acquire recover`; what it could not save of the bytes that are there, in words. That they end early is known."""
        command = [sys.executable, "-m", "acquire", "recover", str(part), "-o", str(whole), "--json"]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            with contextlib.suppress(ProcessLookupError):  # it is done already
                os.setpriority(os.PRIO_PROCESS, process.pid, _NICENESS)
            output, complaint = process.communicate()
        if process.returncode not in {0, 3}:
            raise RecorderError(complaint.strip().removeprefix("acquire: ") or f"`acquire recover` ended with {process.returncode}")
        report = json.loads(output)
        if report["anything_damaged"]:
            damaged = f"{report['damaged_records']} damaged records and {report['skipped_bytes']} bytes of none"
            return f", {part.name} is kept: it holds {damaged}"
        part.unlink()
        return ""
