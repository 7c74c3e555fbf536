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

PLOTS = 19 + 2
"""number of plots: views, sources, influences, regions, voxels, moments; edges, predictions and motions of
four strikes; stills"""


LEAST_CONTRAST = 4.5
"""contrast of text against the page that WCAG 2 asks for (level AA)"""


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
        assert shown.empty_plots() == []
        assert shown.overflowing() == []
        assert shown.cut_text() == []
        assert shown.overlapping() == []
        assert shown.overlapping_labels(".panels svg, .edges svg") == []
        assert shown.page.evaluate("document.documentElement.scrollWidth") <= size[0]
        assert shown.problems == []


def test_report_follows_the_readers_dark_theme(chromium, report):
    with watched(chromium, PHONE) as shown:
        shown.page.emulate_media(color_scheme="dark")
        shown.page.goto(report.as_uri())
        assert min(shown.contrasts()) >= LEAST_CONTRAST
        assert shown.picture().mean() < 90
        assert shown.empty_plots() == []
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


def test_checks_detect_overlapping_texts(chromium, tmp_path):
    path = tmp_path / "overlapping.html"
    path.write_text(
        "<main><p style='margin:0'>first</p><p style='margin:-1em 0 0'>second</p><svg width='90' height='40'>"
        "<g id='text_1'><rect width='30' height='9'/></g><g id='text_2'><rect x='20' width='30' height='9'/>"
        "</g></svg><p>apart</p></main>",
        encoding="utf-8",
    )
    with watched(chromium) as shown:
        shown.page.goto(path.as_uri())
        assert shown.overlapping() == ["first / second"]
        assert shown.overlapping_labels("svg") == ["text_1 / text_2"]


def test_report_prints_without_clipping(chromium, report):
    with watched(chromium, A4_PX) as shown:
        shown.page.emulate_media(media="print")
        shown.page.goto(report.as_uri())
        assert shown.overflowing(scrolls=False) == []
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
        assert shown.problems == []


@pytest.mark.parametrize(
    ("broken", "problem"),
    [
        ("<script>throw new Error('no')</script>", "exception: no"),
        ("<img src='missing.png'>", "failed: "),
        ("<img src='http://127.0.0.1:9/x.png'>", "asked for http://127.0.0.1:9/x.png"),
    ],
)
def test_checks_detect_broken_pages(chromium, tmp_path, broken, problem):
    path = tmp_path / "broken.html"
    path.write_text(
        f"<!DOCTYPE html><main>{broken}<svg width='300' height='200'></svg><div style='width:"
        " 3000px'>x</div></main>",
        encoding="utf-8",
    )
    with watched(chromium) as shown:
        shown.page.goto(path.as_uri())
        assert any(each.startswith(problem) for each in shown.problems), shown.problems
        assert any("300 x 200" in each for each in shown.empty_plots())
        assert shown.overflowing()
