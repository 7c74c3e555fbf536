"""Version of this program, with the git commit if it runs from a checkout."""

from __future__ import annotations

import os
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


@cache
def software_version() -> str:
    """Name and version of this program, for example `percuss 0.1.0`.

    In a git checkout the commit follows, `percuss 0.1.0+0123456789ab`, with `-dirty` if tracked files are
    changed. Without an installed package the version is left out.
    """
    try:
        name = f"percuss {version('percuss')}"
    except PackageNotFoundError:
        name = "percuss"
    found = commit(_ROOT)
    return f"{name}+{found}" if found else name


def commit(root: Path) -> str:
    """Git commit checked out in `root`, 12 or more hexadecimal digits, with `-dirty` if files are changed.

    Returns:
        The text; "" if `root` is not a checkout, or git is missing or fails.
    """
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
