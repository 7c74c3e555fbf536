"""Version of this program, with the commit if it runs from a checkout."""

from __future__ import annotations

import os
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


@cache
def software_version() -> str:
    """Name and version, `percuss 0.1.0`.

    From a checkout `percuss 0.1.0+0123456789ab`, with `-dirty` if files are changed.
    """
    try:
        name = f"percuss {version('percuss')}"
    except PackageNotFoundError:
        name = "percuss"
    found = commit(_ROOT)
    return f"{name}+{found}" if found else name


def commit(root: Path) -> str:
    """Commit checked out in `root`; "" if `root` is not a checkout, or git is missing or fails."""
    if not (root / ".git").exists():
        return ""
    # GIT_DIR and similar variables, set in hooks, would name another repository; reading needs no lock.
    environment = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")} | {
        "GIT_OPTIONAL_LOCKS": "0"
    }
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=5, env=environment)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
