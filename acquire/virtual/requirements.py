"""Libraries that the virtual rig needs besides those of `analyze`."""

from __future__ import annotations

import importlib.util

from acquire.errors import AcquireError

REQUIRED_MODULES = ("mujoco", "gi", "dynamixel_sdk", "serial")
"""modules of the extras `virtual` and `rig`: physics, Aravis's introspection, the servo's bus and its port"""


def refuse_missing_libraries() -> None:
    """Raise AcquireError if a library of the virtual rig is not installed; called before anything starts.

    Raises:
        AcquireError: names the missing modules and the command that installs them.
    """
    missing = [name for name in REQUIRED_MODULES if importlib.util.find_spec(name) is None]
    if missing:
        raise AcquireError(
            f"the virtual rig needs {', '.join(missing)}, which analysis alone does not install: "
            "run `make setup` in the project's folder (Debian 12), then `.venv/bin/acquire`"
        )
