"""Version of this program, with the git commit that it runs from or was built from."""

from __future__ import annotations

import os
import subprocess
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_ROOT = Path(__file__).resolve().parent.parent
BUILT_COMMIT = "built_commit.txt"
"""file beside this module, written into wheels and source archives (hatch_build.py): the commit they hold"""


@cache
def software_version() -> str:
    """Name and version of this program, for example `percuss 0.1.0`.

    If the commit is known it follows, `percuss 0.1.0+0123456789ab`, with `-dirty` if tracked files were
    changed. Without an installed package the version is left out.
    """
    try:
        name = f"percuss {version('percuss')}"
    except PackageNotFoundError:
        name = "percuss"
    found = software_commit()
    return f"{name}+{found}" if found else name


def extra_command(extra: str) -> str:
    """Command that installs an extra (optional dependencies) of this package from the project's folder.

    The package is on no package index.

    Args:
        extra: name of the extra in pyproject.toml, for example "export".
    """
    by_uv = Path(sys.prefix, "uv-receipt.toml").exists()  # `uv tool install` leaves it; there is no pip
    return f"{'uv tool' if by_uv else 'pip'} install '.[{extra}]' in the project's folder"


def software_commit() -> str:
    """Git commit of this program: of its checkout, or the one from which the installed package was built.

    Returns:
        12 or more hexadecimal digits, with `-dirty` if tracked files were changed; "" if it is unknown.
    """
    return commit(_ROOT) or built_commit(_ROOT)


def built_commit(root: Path) -> str:
    """Git commit from which the package or source archive in `root` was built; "" if it states none."""
    try:
        return (root / "schemas" / BUILT_COMMIT).read_text(encoding="ascii").strip()
    except OSError:
        return ""


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
