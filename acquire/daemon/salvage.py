"""Recovery of the files of a dead capture process, while the recording continues in the next file."""

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
from schemas.wording import counted

_NICENESS = 10
"""niceness of the recovery, below the capture process, with which it may share a core"""


@dataclass(frozen=True)
class Salvaged:
    """Files recovered after the death of a capture process, with the numbers of frames saved and lost."""

    files: tuple[Path, ...]
    """complete files; the `.part` file where one could not be rebuilt"""
    frames: int
    """frames in the complete files"""
    lost: int
    """frames lost in `files`, and up to the first frame of the next file"""
    text: str
    """report for the log and for people"""


class Salvage:
    """Recovery of the `.part` (unfinished) files of a dead capture process, begun on construction.

    It runs in a thread and a child process of its own.

    Args:
        files: final paths of the files that the dead process wrote, in order. Of files that are complete
            already only the frames are counted.
        camera: name of the camera whose frames are counted.
        frame_rate_hz: frame rate, to convert the gap before the next file into a number of lost frames.
        next_frame_ns: function that waits for the first frame of the file after these, and returns its log
            time [ns]; None if there is none.
        on_end: called with the result, in the thread of the recovery.
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
        """Wait until the recovery has ended; return its outcome.

        It has the paths of the complete files (or of the `.part` file where one could not be rebuilt), the
        numbers of frames saved and lost, and a report as text.
        """
        self._thread.join()
        return self._found

    def _run(self) -> None:
        next_ns = self._next_frame_ns()  # first: the next file may be closed when these are rebuilt
        frames = lost = 0
        last_ns: int | None = None
        kept: list[Path] = []
        reports: list[str] = []
        for whole in self._files:
            part = Path(f"{whole}{PART_SUFFIX}")
            if not part.exists() and not whole.exists():
                continue  # deleted, as the oldest of a limited series
            try:
                more = self._recover(part, whole) if part.exists() else ""
                times = FrameTimes.read(whole, self._camera)
            except (RecorderError, OSError) as error:
                kept.append(part)
                reports.append(f"{part.name} could not be rebuilt: {error}")
                continue
            kept.append(whole)
            reports.append(f"{whole.name} is complete: {counted(times.frames, 'frame')}{more}")
            frames += times.frames
            lost += times.lost
            last_ns = times.last_ns or last_ns
        if last_ns is not None and next_ns is not None:
            gap_s = (next_ns - last_ns) * 1e-9
            missing = max(0, round(gap_s * self._rate) - 1)
            lost += missing
            reports.append(f"after it {counted(missing, 'frame', 'is')} lost ({gap_s:.1f} s)")
        self._found = Salvaged(tuple(kept), frames, lost, "; ".join(reports) or self._found.text)
        self._on_end(self._found)

    def _recover(self, part: Path, whole: Path) -> str:
        """Rebuild a `.part` file with `acquire recover`, and delete it unless it holds damaged bytes.

        Args:
            part: file that was cut short.
            whole: path of the complete file.

        Returns:
            Text about damaged bytes, because of which `part` is kept; empty if the file only ends early.

        Raises:
            RecorderError: nothing could be recovered.
        """
        command = [sys.executable, "-m", "acquire", "recover", str(part), "-o", str(whole), "--json"]
        with subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            with contextlib.suppress(ProcessLookupError):  # it is done already
                os.setpriority(os.PRIO_PROCESS, process.pid, _NICENESS)
            output, complaint = process.communicate()
        if process.returncode not in {0, 3}:
            raise RecorderError(
                complaint.strip().removeprefix("acquire: ")
                or f"`acquire recover` ended with {process.returncode}"
            )
        report = json.loads(output)
        if report["anything_damaged"]:
            records, outside = report["damaged_records"], report["skipped_bytes"]
            held = f"{counted(records, 'damaged record')} and {counted(outside, 'byte')} outside any record"
            return f", {part.name} is kept: it holds " + "; ".join([held, *report["differences"]])
        part.unlink()
        return ""
