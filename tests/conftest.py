"""What the tests need of the machine. `make setup` installs all of it; where it is missing they fail and say so, they do not skip."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def aravis() -> None:
    """Aravis and PyGObject, for cameras over GigE Vision."""
    try:
        import gi

        gi.require_version("Aravis", "0.8")
    except (ImportError, ValueError) as error:
        pytest.fail(f"no Aravis ({error}): run `make setup`, which installs gir1.2-aravis-0.8 and the extra [rig]")


@pytest.fixture(scope="session")
def vulkan() -> None:
    """A Vulkan device, for pictures of the replay; a software renderer does."""
    try:
        found = subprocess.run(["vulkaninfo", "--summary"], capture_output=True, timeout=20, check=False).returncode == 0
    except FileNotFoundError:
        found = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
    if not found:
        pytest.fail("no Vulkan device: run `make setup`, which installs mesa-vulkan-drivers")
