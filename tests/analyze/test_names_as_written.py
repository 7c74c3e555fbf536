"""Users' names come out as written on every way out: terminal, pages, Markdown, plots, PDF."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from markdown_it import MarkdownIt
from matplotlib.figure import Figure

from analyze.cards.page import render_cards
from analyze.replay.markdown import as_written, message
from analyze.replay.words import answer_text, no_answer_text, strike_text, unread_text, waiting_text
from analyze.report.archive_plots import outcomes_figure
from analyze.report.plots import strike_figure
from analyze.report.prediction_plot import prediction_figures
from analyze.report.report import render_report
from analyze.report.sensitivity_plot import influence_figure
from analyze.report.style import svg
from analyze.report.summary import render_summary
from analyze.result.answer import Answer, answer_evidence
from analyze.tags.pdf import pdf_bytes
from analyze.tags.sheet import Page
from schemas.result import ResultWarning, WarningCode
from schemas.terminal import Terminal
from tests.analyze.simulated_session import carton, session

NAME = "tea_box *2* [lid](x) $5$ <b>&amp; #1|2 ~~a~~ `b"
STARTS = ("1. tea", "12) tea", "- tea", "+ tea", "= tea", "# tea", "> tea", ": tea", "***", "tea $1", "a\\_b")


class _Words(HTMLParser):
    """Texts of a page, those of styles left out; code is marked by backticks."""

    def __init__(self, page: str) -> None:
        super().__init__(convert_charrefs=True)
        self.text, self._style = "", False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._style = tag == "style"
        self.text += "`" * (tag == "code")

    def handle_endtag(self, tag: str) -> None:
        self._style = False
        self.text += "`" * (tag == "code")

    def handle_data(self, data: str) -> None:
        self.text += "" if self._style else data


def shown(markdown: str) -> str:
    """Text that a reader sees of Markdown, by a parser that is not ours."""
    parser = MarkdownIt("commonmark").enable(["table", "strikethrough"])
    return _Words(parser.render(markdown)).text


@pytest.fixture(scope="module")
def answer() -> Answer:
    """Answer for an object and strikes with signs of every markup in their names, and a warning with one."""
    made = session(carton(), np.random.default_rng(3), repeats=1)
    ids = {strike.id: f"{NAME} {number}" for number, strike in enumerate(made.plan.strikes)}
    strikes = [each.model_copy(update={"id": ids[each.id]}) for each in made.plan.strikes]
    motions = tuple(
        replace(
            each,
            strike_id=f"{ids[each.plan_strike_id]}.1",
            plan_strike_id=ids[each.plan_strike_id],
            reason=NAME,
        )
        for each in made.motions[:4]
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analyze.pipeline.solved.CELLS", 500)
        found = answer_evidence(
            replace(
                made,
                spec=made.spec.model_copy(update={"name": NAME}),
                plan=made.plan.model_copy(update={"strikes": strikes}),
                motions=motions,
            )
        )
    warning = ResultWarning(code=WarningCode.FEW_STRIKES, text=f"{NAME}: write `[level]_x_`")
    found.result.warnings.append(warning)
    return found


def test_terminal(answer: Answer) -> None:
    out = io.StringIO()
    render_summary(answer, Terminal(file=out, width=400))
    assert out.getvalue().count(NAME) >= 6


def test_replay(answer: Answer) -> None:
    text = shown(answer_text(NAME, answer.result))
    assert text.startswith(NAME + "\n")
    assert f"{NAME}: write `[level]_x_`" in text
    motion = answer.estimate.evidence.motions[0]
    assert f"{motion.strike_id}: good. {NAME}" in shown(strike_text(motion))
    assert shown(unread_text(NAME, NAME, NAME)) == f"{NAME}. Verdict of the session: {NAME}. {NAME}\n"
    assert shown(waiting_text(NAME, 1, None)).startswith(f"{NAME}\n")
    assert shown(no_answer_text(NAME, [NAME])).count(NAME) == 2


def test_report(answer: Answer, undrawn: None) -> None:
    text = _Words(render_report(answer, [])).text
    assert text.count(NAME) >= 6
    assert f"{NAME}: write `[level]_x_`" in text


def test_cards(answer: Answer) -> None:
    evidence = answer.estimate.evidence
    plan = evidence.plan.model_copy(update={"strikes": evidence.plan.strikes[:1]})
    assert NAME in _Words(render_cards(plan, evidence.model, evidence.spec)).text


@pytest.mark.parametrize("start", STARTS)
def test_text_at_the_start_of_a_line_stays_text(start: str) -> None:
    for before in ("# ", "- ", "1. ", "", "above\n\n"):
        read = shown(f"{before}{as_written(start)}\n").replace("above\n", "")
        assert read.strip() == start
        assert shown(f"{before}{message(start)}\n") == shown(f"{before}{as_written(start)}\n")


@pytest.fixture
def no_formula(monkeypatch: pytest.MonkeyPatch) -> None:
    def parse(*_: object, **__: object) -> None:
        pytest.fail("a text was read as a formula")

    monkeypatch.setattr("matplotlib.mathtext.MathTextParser.parse", parse)


DRAWN: dict[str, Callable[[Answer], list[Figure]]] = {
    "strike": lambda answer: [strike_figure(answer.estimate.evidence.motions[0], NAME)],
    "predictions": lambda answer: prediction_figures(answer.estimate.predictions)[:1],
    "influence": lambda answer: [influence_figure(answer.estimate.sensitivity)],
    "archive": lambda _: [outcomes_figure(1, [(NAME, 2)])],
}


@pytest.mark.usefixtures("no_formula")
@pytest.mark.parametrize("what", DRAWN)
def test_plots(answer: Answer, what: str) -> None:
    for figure in DRAWN[what](answer):
        assert NAME.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;") in svg(figure)


@pytest.mark.usefixtures("no_formula")
def test_sheet_of_tags() -> None:
    assert pdf_bytes([Page(210.0, 297.0, NAME, caption=NAME)]).startswith(b"%PDF")
