"""Parts that all HTML pages share: template environment, number formats, embedded plots."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import cache, partial
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from analyze.report.style import svg
from analyze.report.summary import DEGREES
from analyze.result.digits import number, open_interval, signed, with_interval
from schemas.plain_text import shown_value
from schemas.wording import counted

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@cache
def page_environment() -> Environment:
    """Environment of the HTML templates (Jinja2), with filters for quantities, numbers and sentences.

    All pages share one environment, so that each template is compiled once.
    """
    environment = Environment(
        loader=PackageLoader("analyze.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.finalize = shown_value
    environment.globals["counted"] = counted
    environment.filters.update(
        deg=partial(with_interval, factor=DEGREES),
        shown=with_interval,
        millimetres=_millimetres,
        number=number,
        signed=signed,
        open_interval=open_interval,
        typeset=typeset,
        sentence=sentence,
        contents=contents,
        anchored=anchored,
        stackable=stackable,
        unbroken=unbroken,
    )
    return environment


def figure_element(figure: Figure) -> Markup:
    """Figure as an SVG element of an HTML page, marked as safe for templates."""
    return Markup(svg(figure))  # noqa: S704 - matplotlib's own SVG; text in it is drawn as outlines


def typeset(sentence: str) -> Markup:
    """Sentence as safe HTML: typographic minus signs, s_r and s_R with indices, `commands` as <code>."""
    escaped = str(escape(re.sub(r"(?<![\w.-])-(?=\d)", "−", sentence)))
    lowered = re.sub(r"\bs_([rR])\b", r"s<sub>\1</sub>", escaped)
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", lowered))  # noqa: S704 - escaped above


def sentence(text: str) -> str:
    """Text with a capital first letter, unless its first word has an underscore (edge_radius_m)."""
    return text if "_" in text.split(" ", 1)[0] else text[:1].upper() + text[1:]


_HEADING = re.compile(r"<h2>(.*?)</h2>", re.DOTALL)


def contents(page: Markup) -> list[tuple[str, str]]:
    """Headings (h2) of a page's HTML in their order: pairs of anchor and title, for a table of contents."""
    titles = [re.sub(r"<[^>]*>", "", title).strip() for title in _HEADING.findall(page)]
    return [(_anchor(title), title) for title in titles]


def anchored(page: Markup) -> Markup:
    """HTML of a page with the anchors of `contents` on its headings (h2)."""
    html = _HEADING.sub(lambda found: f'<h2 id="{_anchor(found[1])}">{found[1]}</h2>', page)
    return Markup(html)  # noqa: S704 - templates escaped it


_STACKED = re.compile(r'<table class="stacked">.*?</table>', re.DOTALL)
_HEADER = re.compile(r"<th(?:\s[^>]*)?>(.*?)</th>", re.DOTALL)
_ROW = re.compile(r"<tr\b[^>]*>\s*<td.*?</tr>", re.DOTALL)
_CELL = re.compile(r"(<td[^>]*>)")


def stackable(page: Markup) -> Markup:
    """HTML of a page in which each cell of a table of the class `stacked` holds its column's heading too.

    Narrow pages show each row of such a table as a block of its own, with the headings in it; others hide
    them.
    """
    return Markup(_STACKED.sub(lambda found: _headed(found[0]), page))  # noqa: S704 - templates escaped it


def _headed(table: str) -> str:
    headers = _HEADER.findall(table)

    def row(found: re.Match[str]) -> str:
        labels = iter(headers)
        return _CELL.sub(lambda cell: f'{cell[1]}<span class="label">{next(labels)}</span>', found[0])

    return _ROW.sub(row, table)


def unbroken(page: Markup) -> Markup:
    """HTML of a page in which no line ends between a number and its unit, or its interval."""
    page = Markup(re.sub(r"(?<=\d)[ \n]±[ \n\u00a0](?=\d)", "\u00a0±\u00a0", page))  # noqa: S704
    return Markup(re.sub(r"(?<=\d)[ \n](?=(?:%|mm|g|kg|°)(?![\w/]))", "\u00a0", page))  # noqa: S704


def _anchor(title: str) -> str:
    """Anchor of a heading: its words in lower case, joined by hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", re.sub(r"<[^>]*>|&[a-z]+;", "", title).lower()).strip("-")


def manifest_time(created: str) -> str:
    """Start time of a recording (ISO 8601) as date and minute in UTC, such as 2025-03-01 14:05 UTC.

    The text is returned unchanged if it cannot be parsed or has no time zone.
    """
    try:
        moment = datetime.fromisoformat(created)
    except ValueError:
        return created
    return f"{moment.astimezone(UTC):%Y-%m-%d %H:%M} UTC" if moment.tzinfo is not None else created


def _millimetres(value: float | None) -> str:
    return "–" if value is None else signed(1e3 * value, 2)
