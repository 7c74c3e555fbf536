"""Fixtures for programs and libraries of the system, and the order of the test files.

`make setup` installs them all. A test fails, and is not skipped, if one is missing.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from _pytest.runner import runtestprotocol

if TYPE_CHECKING:
    from playwright.sync_api import Browser

# Set before numpy is loaded, here and in every process that a test starts. OpenBLAS's threads spin while they
# wait for one another: on matrices as small as these, two of them take three times as long as one, and ten
# times as long on a machine that has other work.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# Nothing is kept from test to test, nor in the folder of the user who runs the tests.
os.environ["PERCUSS_CACHE"] = ""

# A script's background job ignores Ctrl-C, and so do the processes that it starts: programs that tests
# interrupt would not end.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

STALL_NS = 10_000_000
"""largest delay of the simulated arm that the servo's watchdog and a strike's timing allow"""
ATTEMPTS = 4
"""largest number of runs of a test whose simulated arm was delayed longer"""


LONGEST = (
    "acquire/console/web/pages/",
    "analyze/reproduce/test_paper.py",
    "analyze/batch/test_run.py",
    "analyze/verbs/calibrate/test_calibrate_command.py",
    "analyze/replay/test_run.py",
    "analyze/report/",
    "analyze/pipeline/test_answer.py",
    "analyze/geometry/test_shape_files.py",
    "analyze/tracking/test_recovery.py",
    "analyze/cards/test_cards.py",
    "analyze/planning/",
    "analyze/registration/",
    "analyze/verbs/register/",
)
"""longest test files that only compute; they begin first, so that no worker is busy with one when the others
have nothing left. Files that keep time with devices stay in their order, in which whole sessions do not run
beside a camera at full rate."""


def pytest_configure(config: pytest.Config) -> None:
    """Set up hypothesis, before any test is imported; not in the process that only distributes the tests."""
    if config.getoption("numprocesses", None) and not hasattr(config, "workerinput"):
        return
    from hypothesis import settings

    # No deadline: the duration of an example means nothing on a machine that has other work.
    settings.register_profile("percuss", deadline=None)
    settings.load_profile("percuss")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort the tests: the longest files first, the others in their order."""
    places = {
        item: next(
            (i for i, name in enumerate(LONGEST) if f"tests/{name}" in item.path.as_posix()), len(LONGEST)
        )
        for item in items
    }
    items.sort(key=places.__getitem__)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Load the stand-in for libusb, if tests need it, before one of them loads Aravis."""
    if any(item.get_closest_marker("usb_bus") for item in session.items):
        from tests.usb_bus import bus_folder

        bus_folder()


def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """Run a test again if it failed while the thread of its simulated arm was delayed by a busy computer.

    The arm measures its own delay. A failure without such a delay counts, and so does the last attempt.
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
        # New fixtures, as pytest-rerunfailures makes them.
        item._initrequest()  # pyright: ignore[reportAttributeAccessIssue]
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


@pytest.fixture(scope="session")
def aravis() -> None:
    """Fail unless Aravis and PyGObject are installed, which cameras over GigE Vision need."""
    try:
        import gi

        gi.require_version("Aravis", "0.8")
    except (ImportError, ValueError) as error:
        pytest.fail(
            f"no Aravis ({error}): run `make setup`, which installs gir1.2-aravis-0.8 and the extra [rig]"
        )


@pytest.fixture(scope="session")
def vulkan() -> None:
    """Fail without a Vulkan device, which pictures of the replay need; a software renderer suffices."""
    try:
        found = (
            subprocess.run(
                ["vulkaninfo", "--summary"], capture_output=True, timeout=20, check=False
            ).returncode
            == 0
        )
    except FileNotFoundError:
        found = any(Path("/usr/share/vulkan/icd.d").glob("*.json"))
    if not found:
        pytest.fail("no Vulkan device: run `make setup`, which installs mesa-vulkan-drivers")


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """Debian's Chromium without a window.

    One per module, because no other event loop can run in this process while it is open.
    """
    with _chromium([]) as browser:
        yield browser


@pytest.fixture(scope="module")
def chromium_webgl() -> Iterator[Browser]:
    """Debian's Chromium without a window, with WebGL drawn in software."""
    with _chromium(["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]) as browser:
        yield browser


@contextmanager
def _chromium(arguments: list[str]) -> Iterator[Browser]:
    program = shutil.which("chromium")
    if program is None:
        pytest.fail("no Chromium: run `make test`, which installs Debian's chromium")
    from playwright.sync_api import sync_playwright

    # Chromium's sandbox refuses to run as root.
    sandbox = ["--no-sandbox"] if os.geteuid() == 0 else []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=[*arguments, *sandbox])
        yield browser
        browser.close()
