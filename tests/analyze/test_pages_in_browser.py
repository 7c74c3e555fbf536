"""Every page that the analysis makes in Debian's Chromium: nothing overlaps, is cut, faint, small or empty.

One check, `WatchedPage.faults`, looks at each page on a desktop and a phone, light and dark, and printed; a
page broken on purpose shows that the check finds each kind of fault.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from analyze.batch.object_output import save_object
from analyze.batch.object_sessions import object_over_sessions
from analyze.batch.summary import Repeated, Summary, summarise
from analyze.batch.summary_output import save_summary
from analyze.cards.page import render_cards
from analyze.report.comparison_page import render_comparison
from analyze.report.report import render_report
from analyze.reproduce.paper.moments_table import moments_table
from analyze.reproduce.paper.page import render_page
from analyze.reproduce.paper.tables import all_tables
from analyze.reproduce.paper.targets import targets_table
from analyze.result.answer import answer_evidence
from analyze.result.comparison import compare_evidence
from tests.analyze.batch.months_of_sessions import ageing_rig, drawn_table
from tests.analyze.cards.test_cards import planned
from tests.analyze.report.test_report_in_browser import still
from tests.analyze.reproduce.test_paper import record_of
from tests.analyze.result.test_comparison import ELSEWHERE, one
from tests.analyze.simulated_session import carton, session
from tests.analyze.watched_page import A4_CARDS_PX, A4_PX, DESKTOP, PHONE, watched
from tests.places import ROOT

SCREENS = {
    "desktop": (DESKTOP, "screen", "light"),
    "phone": (PHONE, "screen", "light"),
    "desktop-dark": (DESKTOP, "screen", "dark"),
    "phone-dark": (PHONE, "screen", "dark"),
    "print": (A4_PX, "print", "light"),
}
"""windows in which each page is looked at: size [px], medium and colour scheme"""


def report_of_few() -> str:
    evidence = session(carton(), np.random.default_rng(3), repeats=1)
    return render_report(answer_evidence(replace(evidence, motions=evidence.motions[:3])), [still("a")])


def report_of_many() -> str:
    evidence = session(carton(), np.random.default_rng(3), repeats=4)
    return render_report(answer_evidence(evidence), [still(name) for name in "abcdef"])


def comparison() -> str:
    return render_comparison(compare_evidence([one(2), one(3, **ELSEWHERE), one(1)]))


def archive() -> str:
    """Summary of three objects: one with a long name, one that drifts, one with a single session."""
    sha256 = ("a" * 64, "b" * 64, "c" * 64)
    names = "spanner with a long name, 13 mm", "tea [box]", "mug"
    objects = tuple(
        (name, each, 12, 40, 36, 2 * i) for i, (name, each) in enumerate(zip(names, sha256, strict=True))
    )
    repeated = tuple(
        Repeated(name, each, quantity, unit, 12, mean, 2 * sd, sd, 4.0, 0.15, 0.01, 0.02, 10)
        for name, each in zip(names[:2], sha256, strict=False)
        for quantity, unit, mean, sd in (
            ("centre of mass x", "mm", 10.0, 0.2),
            ("centre of mass z", "mm", -120.123, 0.002),
            ("Ixx", "10⁻⁶\u00a0kg\u00a0m²", 1234.5, 1.5),
        )
    )
    failures = (("cut", 3, "/archive/2026-01-02/a/rather/long/folder/session-17.mcap: ends early"),)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "archive.html"
        save_summary(Summary(24, failures, repeated, objects), path)
        return path.read_text(encoding="utf-8")


def control_charts() -> str:
    """Summary of an archive of a rig that drifts."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "archive.html"
        save_summary(summarise(drawn_table(40, ageing_rig)), path)
        return path.read_text(encoding="utf-8")


def page_of_object(sessions: pa.Table) -> str:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "object.html"
        save_object(object_over_sessions(sessions, "salt"), path)
        return path.read_text(encoding="utf-8")


def object_sessions() -> str:
    """One object over forty sessions, one of which stands out."""
    return page_of_object(drawn_table(40, ageing_rig))


def one_session() -> str:
    return page_of_object(drawn_table(1))


def reproduction() -> str:
    """Page of the paper's tables and figures, from one session of a carton."""
    records = [record_of("carton")]
    return render_page(records, [targets_table(records), *all_tables(records), moments_table(records)])


def rig_cards() -> str:
    return render_cards(*planned("carton"))


def hand_cards() -> str:
    return render_cards(*planned("salt"), by_hand=True)


PAGES: dict[str, Callable[[], str]] = {
    make.__name__: make
    for make in (
        *(report_of_few, report_of_many, comparison, archive, control_charts, object_sessions, one_session),
        *(reproduction, rig_cards, hand_cards),
    )
}


@pytest.fixture(scope="module")
def page_of(tmp_path_factory) -> Callable[[str], Path]:
    """Function that returns the file of a page by its name, made once."""
    folder = tmp_path_factory.mktemp("pages")

    @cache
    def made(name: str) -> Path:
        path = folder / f"{name}.html"
        path.write_text(PAGES[name](), encoding="utf-8")
        return path

    return made


def faults_of(chromium, path: Path, screen: str) -> list[str]:
    """Faults of a page in one of the windows of `SCREENS`; cards are printed on landscape pages."""
    size, media, scheme = SCREENS[screen]
    if media == "print" and path.stem.endswith("cards"):
        size = A4_CARDS_PX
    with watched(chromium, size) as shown:
        shown.page.emulate_media(media=media, color_scheme=scheme)
        shown.page.goto(path.as_uri())
        # Paper has several dots per px.
        return shown.faults(least_font=0.0) if media == "print" else shown.faults()


@pytest.mark.slow  # every page in every window: a minute
@pytest.mark.parametrize("screen", SCREENS)
@pytest.mark.parametrize("name", PAGES)
def test_page_has_no_fault(chromium, page_of, name, screen):
    assert faults_of(chromium, page_of(name), screen) == []


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """Start page of the documentation, built as a site."""
    folder = tmp_path_factory.mktemp("site")
    doctrees = tmp_path_factory.mktemp("doctrees")
    command = [sys.executable, "-m", "sphinx", "-q", "-b", "html", "-d", str(doctrees)]
    subprocess.run([*command, str(ROOT / "docs"), str(folder)], check=True, cwd=ROOT)
    return folder / "index.html"


@pytest.mark.slow  # builds the whole site
@pytest.mark.timeout(300)
@pytest.mark.parametrize("screen", SCREENS)
def test_start_page_of_the_documentation_has_no_fault(chromium, site, screen):
    assert faults_of(chromium, site, screen) == []


FAULTS = {
    "exception: no": "<script>throw new Error('no')</script>",
    "failed: ": "<img src='missing.png'>",
    "asked for http://127.0.0.1:9/x.png": "<img src='http://127.0.0.1:9/x.png'>",
    "empty: plot 2 of ": "<svg width='300' height='200' viewBox='0 0 300 200'></svg>",
    "overflows: DIV": "<div style='width:3000px'>x</div>",
    "cut: a long word": "<div style='width:30px;overflow:hidden;white-space:nowrap'>a long word</div>",
    "cut: outside": "<p style='margin-left:-90px;width:80px'>outside</p>",
    "cut: label": "<svg viewBox='0 0 90 40' width='90' height='40'><text x='80' y='20'>label</text></svg>",
    "overlap: first / second": "<p style='margin:0'>first</p><p style='margin:-1em 0 0'>second</p>",
    "labels overlap: text_1 / text_2": "<svg viewBox='0 0 90 40' width='90' height='40'><g id='text_1'>"
    "<rect width='30' height='9'/></g><g id='text_2'><rect x='20' width='30' height='9'/></g></svg>",
    "small: tiny: 4.0 px": "<svg viewBox='0 0 90 40' width='90' height='40'>"
    "<text x='9' y='20' font-size='4'>tiny</text></svg>",
    "broken: 1.25 ± 0.25": "<p style='width:60px'>1.25 ± 0.25 mm</p>",
    "drawn outside: path of wide": "<svg aria-label='wide' viewBox='0 0 90 40' width='300' height='40'>"
    "<path d='M-60 20H30' stroke='#000'/></svg>",
    "faint: pale": "<p style='color:#ccc;background:#fff'>pale</p>",
}
"""pieces of a page with one fault each, by the beginning of the fault that is to be found"""


def test_check_finds_each_fault_of_a_broken_page(chromium, tmp_path):
    path = tmp_path / "broken.html"
    pieces = "\n".join(f"<section><p>sound</p>{piece}</section>" for piece in FAULTS.values())
    path.write_text(f"<!DOCTYPE html><main>{pieces}</main>", encoding="utf-8")
    found = faults_of(chromium, path, "desktop")
    missed = [fault for fault in FAULTS if not any(each.startswith(fault) for each in found)]
    assert missed == [], found
    assert not any("sound" in each for each in found)


def test_page_fits_a_phone_because_its_tables_stack(chromium, page_of, tmp_path):
    path = tmp_path / "archive.html"
    page = page_of("archive").read_text(encoding="utf-8")
    path.write_text(page.replace('class="stacked"', 'class="plain"'), encoding="utf-8")
    assert any(each.startswith("cut: ") for each in faults_of(chromium, path, "phone"))
    assert faults_of(chromium, page_of("archive"), "phone") == []
