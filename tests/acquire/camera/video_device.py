"""A virtual webcam in a process of its own, for tests; skipped where the system lets nobody make one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def pattern_video(link: Path, *habits: str) -> Iterator[subprocess.Popen[str]]:
    """Run a webcam of 656 x 492 px with the test pattern, reached by `link`, until the block ends."""
    script = Path(__file__).with_name("pattern_video.py")
    command = [sys.executable, str(script), str(link), "656", "492", *habits]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        if first != "ready\n":
            process.communicate(timeout=10)
            pytest.skip(first.strip())
        try:
            yield process
        finally:
            process.kill()
