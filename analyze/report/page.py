"""Parts that all HTML pages share: template environment, number formats, embedded plots."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import cache, partial
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from analyze.report.style import svg
from analyze.report.summary import DEGREES, GRAM_CM2, open_interval, with_interval
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
    environment.globals["counted"] = counted
    environment.filters.update(
        deg=partial(with_interval, factor=DEGREES, digits=3),
        inertia=partial(with_interval, factor=GRAM_CM2, digits=0),
        rate=partial(with_interval, factor=1.0, digits=1),
        grams=partial(with_interval, factor=1e3, digits=1),
        millimetres=_millimetres,
        number=number,
        signed=signed,
        open_interval=open_interval,
        typeset=typeset,
        sentence=sentence,
    )
    return environment


def figure_element(figure: Figure) -> Markup:
    """Figure as an SVG element of an HTML page, marked as safe for templates."""
    return Markup(svg(figure))  # noqa: S704 - matplotlib's own SVG; text in it is drawn as outlines


def number(value: float, digits: int) -> str:
    """Text of a number with `digits` decimals and a typographic minus; no sign if it rounds to 0."""
    text = f"{value:.{digits}f}"
    return f"{0.0:.{digits}f}" if float(text) == 0 else text.replace("-", "−")


def typeset(sentence: str) -> Markup:
    """Sentence as safe HTML with typographic minus signs; commands between backticks become <code>."""
    escaped = str(escape(re.sub(r"(?<![\w.-])-(?=\d)", "−", sentence)))
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", escaped))  # noqa: S704 - escaped above


def sentence(text: str) -> str:
    """Text with a capital first letter, unless its first word has an underscore (edge_radius_m)."""
    return text if "_" in text.split(" ", 1)[0] else text[:1].upper() + text[1:]


def signed(value: float, digits: int) -> str:
    """Text of a number with `digits` decimals and its sign, plus or minus; no sign if it rounds to 0."""
    text = number(value, digits)
    return f"+{text}" if value > 0 and float(text) != 0 else text


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
