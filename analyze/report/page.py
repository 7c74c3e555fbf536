"""What all HTML pages share: one template and style, numbers set as people write them, plots in place."""

from __future__ import annotations

import re
from datetime import UTC, datetime
from functools import cache
from typing import TYPE_CHECKING

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from analyze.report.style import svg
from analyze.report.summary import DEGREES, GRAM_CM2, open_interval, with_interval

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from schemas.result import Quantity


@cache
def page_environment() -> Environment:
    """Templates with the filters that they use; one for all pages, so that each template is compiled once."""
    environment = Environment(
        loader=PackageLoader("analyze.report"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.filters.update(
        deg=_degrees,
        inertia=_inertia,
        rate=_rate,
        grams=_grams,
        millimetres=_millimetres,
        number=number,
        signed=signed,
        open_interval=open_interval,
        typeset=typeset,
        sentence=sentence,
    )
    return environment


def drawn(figure: Figure) -> Markup:
    """A figure as an element of the page."""
    return Markup(svg(figure))  # noqa: S704 - matplotlib's own SVG; text in it is drawn as outlines


def number(value: float, digits: int) -> str:
    """With so many decimals and a typographic minus; what rounds to 0 has no sign."""
    text = f"{value:.{digits}f}"
    return f"{0.0:.{digits}f}" if float(text) == 0 else text.replace("-", "−")


def typeset(sentence: str) -> Markup:
    """With typographic minus signs, and commands, which stand between backticks, as code."""
    told = str(escape(re.sub(r"(?<![\w.-])-(?=\d)", "−", sentence)))
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", told))  # noqa: S704 - escaped above


def sentence(text: str) -> str:
    """Begun with a capital, but where it begins with the name of an entry."""
    return text if "_" in text.split(" ", 1)[0] else text[:1].upper() + text[1:]


def signed(value: float, digits: int) -> str:
    """As `number`, with a plus where it is positive."""
    text = number(value, digits)
    return f"+{text}" if value > 0 and float(text) != 0 else text


def manifest_time(created: str) -> str:
    """ISO 8601 as people read it, to the minute; as it stands where it is none."""
    try:
        moment = datetime.fromisoformat(created)
    except ValueError:
        return created
    return f"{moment.astimezone(UTC):%Y-%m-%d %H:%M} UTC" if moment.tzinfo is not None else created


def _degrees(quantity: Quantity | None) -> str:
    return with_interval(quantity, DEGREES, 3)


def _inertia(quantity: Quantity | None) -> str:
    return with_interval(quantity, GRAM_CM2, 0)


def _rate(quantity: Quantity | None) -> str:
    return with_interval(quantity, 1.0, 1)


def _grams(quantity: Quantity | None) -> str:
    return with_interval(quantity, 1e3, 1)


def _millimetres(value: float | None) -> str:
    return "–" if value is None else signed(1e3 * value, 2)
