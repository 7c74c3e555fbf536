"""`analyze replay --web` in Debian's Chromium: rerun's viewer loads and draws the data without an error."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from tests.analyze.watched_page import watched_viewer
from tests.places import FIRST_SAMPLE

SIZE = (800, 600)
SCENE = (slice(100, 400), slice(20, 420))
"""rows and columns of the window in which the answer page shows the body with its equi-planes"""
COLOURED = 0.04
"""least share of coloured pixels there, which the equi-planes give, on a dark ground; on a strike's page,
which is shown before, nearly all are grey"""
PATIENCE_S = 150.0
"""longest wait for the page on a busy computer [s]; an idle one takes a tenth"""
RERUNS_OWN = {"fonts.googleapis.com", "tel.rerun.io", "app.rerun.io", "api.github.com"}
"""hosts that rerun's web viewer contacts of its own accord: a font, telemetry, examples, version check"""


def coloured_on_dark(picture: np.ndarray) -> float:
    """Share of coloured pixels; 0 if the background is light, as that of rerun's welcome page."""
    return float((np.ptp(picture, axis=2) > 30).mean()) if np.median(picture) < 60 else 0.0


@pytest.fixture
def address():
    command = [sys.executable, "-m", "analyze", "replay", str(FIRST_SAMPLE), "--web", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        try:
            line = process.stdout.readline()
            yield line.removeprefix("replay: ").strip()
        finally:
            process.send_signal(signal.SIGINT)
            assert process.wait(20) in {0, 130}  # 130: it was still sending


@pytest.mark.slow  # draws in software: 25 s of both cores
@pytest.mark.timeout(240)
def test_web_replay_draws_the_answer_page(chromium_webgl, address):
    assert re.match(r"http://127\.0\.0\.1:\d+/", address)
    elsewhere: set[str] = set()
    with watched_viewer(chromium_webgl, SIZE, elsewhere) as shown:
        shown.page.goto(address)
        ends = time.monotonic() + PATIENCE_S
        drawn = 0.0
        while drawn < COLOURED and time.monotonic() < ends:
            shown.page.wait_for_timeout(500)
            drawn = coloured_on_dark(shown.picture()[SCENE])
        assert drawn >= COLOURED, f"the viewer shows no equi-planes: {shown.problems}"
        assert shown.problems == []
        assert elsewhere <= RERUNS_OWN
