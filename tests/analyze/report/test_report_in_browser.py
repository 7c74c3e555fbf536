"""Report in Debian's Chromium, at two widths and printed: no errors, overflow, clipping or empty figures."""

from __future__ import annotations

import base64
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from analyze.report.report import Still, render_report
from analyze.result.answer import answer_evidence
from tests.analyze.simulated_session import carton, session
from tests.analyze.watched_page import A4_PX, DESKTOP, PHONE, watched

PLOTS = 22 + 2
"""number of plots: 3 views, sources, influences, regions, 3 voxel views and their scale, moments; edges,
predictions and motions of four strikes; stills"""


def still(name: str) -> Still:
    picture = np.random.default_rng(1).integers(0, 255, (120, 160), dtype=np.uint8)
    data = base64.b64encode(cv2.imencode(".jpg", picture)[1].tobytes()).decode()
    return Still(name, f"strike {name}", f"data:image/jpeg;base64,{data}")


@pytest.fixture(scope="module")
def report(tmp_path_factory) -> Path:
    evidence = session(carton(), np.random.default_rng(3), repeats=1)
    page = render_report(
        answer_evidence(replace(evidence, motions=evidence.motions[:4])), [still("a"), still("b")]
    )
    path = tmp_path_factory.mktemp("report") / "r.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_report_opens_from_disk_and_draws_all_figures(chromium, report, size):
    with watched(chromium, size) as shown:
        shown.page.goto(report.as_uri())
        assert shown.plots() == PLOTS
        assert shown.faults() == []
        assert shown.page.evaluate("document.documentElement.scrollWidth") <= size[0]


def test_report_follows_the_readers_dark_theme(chromium, report):
    with watched(chromium, PHONE) as shown:
        shown.page.emulate_media(color_scheme="dark")
        shown.page.goto(report.as_uri())
        assert shown.faults() == []
        assert shown.picture().mean() < 90
        shown.page.emulate_media(color_scheme="dark", media="print")
        assert shown.picture().mean() > 180


def test_contents_lead_to_each_section(chromium, report):
    with watched(chromium, DESKTOP) as shown:
        shown.page.goto(report.as_uri())
        found = shown.page.evaluate(
            "[...document.querySelectorAll('.toc a')].map(each => each.getAttribute('href').slice(1))"
        )
        headings = shown.page.evaluate("[...document.querySelectorAll('h2')].map(each => each.id)")
        assert found == ["top", *headings]
        assert len(set(found)) == len(found) > 5


def test_report_prints_without_clipping(chromium, report):
    with watched(chromium, A4_PX) as shown:
        shown.page.emulate_media(media="print")
        shown.page.goto(report.as_uri())
        assert shown.faults(least_font=0) == []
        tall = shown.page.evaluate(
            "[...document.querySelectorAll('figure')].map(each => each.getBoundingClientRect().height)"
        )
        assert max(tall) < A4_PX[1]
        kept = shown.page.evaluate(
            "[...document.querySelectorAll('figure')].map(each => getComputedStyle(each).breakInside)"
        )
        assert set(kept) == {"avoid"}
        printed = shown.page.pdf(format="A4")
        assert printed.startswith(b"%PDF")
