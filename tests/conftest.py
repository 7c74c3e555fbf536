"""What the tests need of the machine. `make setup` installs all of it; where it is missing they fail and say so, they do not skip."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol
from hypothesis import settings

# How long an example takes says nothing on a machine that has other work.
settings.register_profile("percuss", deadline=None)
settings.load_profile("percuss")

# Before numpy is loaded, here and in every process that a test starts. OpenBLAS's threads spin while they wait for one another: on
# matrices as small as ours two of them take three times as long as one, and ten times on a machine that has other work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A script's background job ignores Ctrl-C, and so does whatever it starts: the programs that tests interrupt would go on.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

STALL_NS = 10_000_000
"""of the simulated arm: the servo's watchdog and a strike's timing allow no more"""
ATTEMPTS = 4


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """A test whose simulated arm stood still, because this computer had no time for its thread, has tested nothing: it is run again.

    Only that is forgiven. The arm measures its own delay; a failure while it kept its time is a failure, and so is the last attempt.
    """
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(1, ATTEMPTS + 1):
        plant = sys.modules.get("tests.acquire.striker.plant")
        if plant is not None:
            plant.Plant.latest_ns = 0
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        plant = sys.modules.get("tests.acquire.striker.plant")
        stalled = plant is not None and plant.Plant.latest_ns > STALL_NS
        if not (stalled and any(report.failed for report in reports)) or attempt == ATTEMPTS:
            break
        item._initrequest()  # pyright: ignore[reportAttributeAccessIssue] - new fixtures, as pytest-rerunfailures does it
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


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
