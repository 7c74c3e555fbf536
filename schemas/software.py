"""Which program wrote a document: its version, and the commit where it runs from a checkout."""

from __future__ import annotations

import os
import subprocess
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent


@cache
def software_version() -> str:
    """`percuss 0.1.0` as installed; from a checkout `percuss 0.1.0+0123456789ab`, with `-dirty` where files differ from the commit."""
    try:
        name = f"percuss {version('percuss')}"
    except PackageNotFoundError:
        name = "percuss"
    found = commit(_ROOT)
    return f"{name}+{found}" if found else name


def commit(root: Path) -> str:
    """The commit that is checked out in `root`; empty where `root` is no checkout, or git is absent or does not answer."""
    if not (root / ".git").exists():
        return ""
    # GIT_DIR and its like, set in hooks, would name another repository; no lock is taken, because this only looks.
    environment = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")} | {"GIT_OPTIONAL_LOCKS": "0"}
    command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=5, env=environment)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
