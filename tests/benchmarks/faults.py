"""Run every fault test, including slow ones, and write their measurements to docs/reference/faults.md."""

from __future__ import annotations

import json
import os
import platform
import re
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
PAGE = ROOT / "docs" / "reference" / "faults.md"
MEASURED_ON = re.compile(r"\(\d+ cores, \w+\)")
TABLE_ROWS = re.compile(r"(?<=\|---\|---\|---\|\n)(\|.*\n)+")


def main() -> int:
    """Run the tests and return their exit code; the page's table is replaced only if all pass."""
    with tempfile.TemporaryDirectory() as folder:
        rows = Path(folder) / "rows"
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "slow or not slow", *TESTS]
        code = subprocess.run(
            command, cwd=ROOT, env=os.environ | {TABLE_VARIABLE: str(rows)}, check=False
        ).returncode
        found = (
            [json.loads(line) for line in rows.read_text(encoding="utf-8").splitlines()]
            if rows.exists()
            else []
        )
    table = "\n".join(f"| {row['fault']} | {row['lost']} | {row['again']} |" for row in found)
    sys.stdout.write(table + "\n")
    if code == 0:
        page = MEASURED_ON.sub(
            f"({os.cpu_count()} cores, {platform.system()})", PAGE.read_text(encoding="utf-8"), count=1
        )
        PAGE.write_text(TABLE_ROWS.sub(lambda _: table + "\n", page, count=1), encoding="utf-8")
    return code


if __name__ == "__main__":
    sys.exit(main())
