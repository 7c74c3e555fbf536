"""Run every fault test, slow ones too, and write what they measured to docs/faults.md. `make bench-faults`."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.places import ROOT
from tests.system.fault_rig import TABLE_VARIABLE

TESTS = tuple(
    f"tests/system/test_{name}.py"
    for name in (
        "servo_faults",
        "striker_faults",
        "faults",
        "capture_faults",
        "session_faults",
        "session_servo_faults",
        "service_manager",
        "damaged_files",
    )
)
PAGE = """\
# What goes wrong, what is lost, and how long until it works again

Measured by `make bench-faults` ({cores} cores, {system}); each row is a test in `tests/system`, which fails where a limit is
exceeded: 0.5 s of a recording, whatever its pre-trigger time, 200 ms until the arm stands and the torque is off when the daemon dies,
200 ms until the arm stands when the servo is cut off, 300 ms when a client leaves. The camera speaks GigE Vision over loopback at
120 fps, the servo the Dynamixel protocol over a pty; the arm's motion is the simulated arm's own, not what the servo reports. Nothing
here was tried on real devices.

| fault | what is lost | works again |
|---|---|---|
{rows}

More on damaged files, full and slow disks: `tests/acquire/recorder`.

How it is done:

- The capture process owns camera and file. It finishes the file by itself when the daemon dies, and reconnects to a camera that was
  lost; the gap is in `FrameMeta.frames_lost_before` of the next frame, in `/log` and in `acquire status` (`connected`, `trouble`).
- With the daemon the recording ends. The capture process finishes what is open, and nothing is recorded until `acquire run` is up again
  and a client opens a new recording: the session that was under way has to be started anew.
- The capture process gives a sign of life every quarter second while its threads turn. The daemon ends one that gives none for 3 s of
  the daemon's own time, and starts another for one that died; the camera gives control back 3 s after a client's sudden death. The
  recording goes on in the next numbered file (same `recording_id`, `part` counts); what the dead process left is rebuilt beside it as by
  `acquire recover`, and the gap is said in the next file's `/log`, to every client and on standard error. A strike that was in the
  making is made again by the session. Waiting clients wait up to 30 s.
- `analyze watch` is started again up to twice in a recording.
- Images that come late are waited for in their own time, for up to 9 s. A strike whose images end before its tip is "unreadable": it is
  made again, and nothing is learned from it.
- While a session is open its client alone gives orders; any other may look, stop the arm, and end the recording.
- The daemon says to a waiting client once a second that it is at work; 6 s of silence are a hang, said in one line. Its own loop
  feeds systemd's watchdog (docs/percuss.service), which ends and restarts a daemon whose loop hangs. The unit leaves the daemon's
  children alone (KillMode=process): they end by themselves, and the new daemon, 3 s later, waits for the camera. `systemd-analyze verify`
  accepts the unit; its signs of life and its restart were tried with a test in systemd's place, systemd itself was not run.
- While the arm moves, the servo's bus watchdog (100 ms) runs: whatever silences the host stops the motor. It never takes the torque off,
  and no register of the servo would on silence. So a process of a few lines stands by (`acquire/striker/deadman.py`): when the daemon is
  gone it waits until the watchdog has stopped the arm, and takes the torque off, also where the arm only stood. Where the computer itself
  stops or the cable is pulled, a standing arm is held until the power is cut.
- A session whose servo is away waits for it for two minutes, and goes on with the strike that failed.
- On SIGTERM the torque goes off first, then files are finished. A client that leaves in mid-swing stops the arm.
- Nothing reads the wall clock but the anchor at a recording's start.
"""


def main() -> int:
    """Exit code of the tests; the page is written only when all pass."""
    with tempfile.TemporaryDirectory() as folder:
        rows = Path(folder) / "rows"
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "slow or not slow", *TESTS]
        code = subprocess.run(command, cwd=ROOT, env=os.environ | {TABLE_VARIABLE: str(rows)}, check=False).returncode
        found = [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()] if rows.exists() else []
    table = "\n".join(f"| {row['fault']} | {row['lost']} | {row['again']} |" for row in found)
    sys.stdout.write(table + "\n")
    if code == 0:
        page = PAGE.format(rows=table, cores=os.cpu_count(), system=platform.system())
        (ROOT / "docs" / "faults.md").write_text(page, encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(main())
