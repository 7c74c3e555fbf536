"""Time of a command that analyses a recording for the first and for the second time.

`make bench-cache` (SESSION=recordings/demo-carton-1.mcap; without it the sample). Each command starts with an
empty cache of its own; the start of the interpreter counts. Wall time depends on the computer's load; CPU
time hardly does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLE = ROOT / "recordings" / "sample-1.0.mcap"
COMMANDS = {
    "estimate": [],
    "report": ["-o", "report.html"],
    "export": ["--format", "urdf", "-o", "body.urdf"],
    "replay": ["--save", "replay.rrd"],
}
"""options of each command, which writes into a temporary folder"""
TURNS = 3
"""number of second runs, of which the fastest counts"""


def run(name: str, options: list[str], recording: Path, folder: Path) -> tuple[float, float]:
    """Wall and CPU time [s] of one run of `analyze NAME`, with the cache in `folder`."""
    for made in folder.glob("*.*"):
        made.unlink()
    command = [sys.executable, "-m", "analyze", name, str(recording), *options]
    environment = os.environ | {"PERCUSS_CACHE": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
    start = time.monotonic()
    with subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    return time.monotonic() - start, used.ru_utime + used.ru_stime


def main() -> None:
    """Print a table of both times of the first and the second run of each command."""
    recording = Path(sys.argv[1]).resolve() if len(sys.argv) > 1 else SAMPLE
    sys.stdout.write(f"{recording.name}, {recording.stat().st_size / 1e6:.0f} MB\n\n")
    sys.stdout.write("| command | first [s] | second [s] | CPU, first [s] | CPU, second [s] |\n")
    sys.stdout.write("|---|---|---|---|---|\n")
    for name, options in COMMANDS.items():
        with tempfile.TemporaryDirectory(prefix="percuss-bench-") as folder:
            first = run(name, options, recording, Path(folder))
            second = min(run(name, options, recording, Path(folder)) for _ in range(TURNS))
        times = [first[0], second[0], first[1], second[1]]
        sys.stdout.write(f"| {name} | {' | '.join(f'{each:.1f}' for each in times)} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
