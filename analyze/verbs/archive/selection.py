"""Options of `analyze archive` that select recordings, and those of how rows are printed."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from functools import wraps
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.options import with_options
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.catalogue.listing import Selection

_DATE = re.compile(
    r"\d{4}(-(0[1-9]|1[0-2])(-(0[1-9]|[12]\d|3[01])(T([01]\d|2[0-3])(:[0-5]\d(:[0-5]\d)?)?)?)?)?"
)


class _Date(click.ParamType):
    """Year, month, day or time in ISO 8601."""

    name = "date"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        if not _DATE.fullmatch(str(value)):
            self.fail(
                f"{value!r} is not a date: write 2026, 2026-11, 2026-11-30 or 2026-11-30T14", param, ctx
            )
        return str(value)


class _Range(click.ParamType):
    """Range of numbers, as 40..60, 40.. or ..60."""

    name = "range"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, float]:
        if isinstance(value, tuple):
            return value
        low, dots, high = str(value).partition("..")
        try:
            limits = float(low or "-inf"), float(high or "inf")
        except ValueError:
            limits = math.nan, math.nan
        if not dots or not limits[0] <= limits[1]:
            self.fail(f"{value!r} is not a range: write 40..60, 40.. or ..60", param, ctx)
        return limits


_select = with_options(
    click.option("--object", metavar="GLOB", default="", help="Only objects whose name matches GLOB."),
    click.option("--rig", metavar="GLOB", default="", help="Only rigs whose name matches GLOB."),
    click.option("--since", type=_Date(), help="Only sessions from then on: 2026-11 or 2026-11-30."),
    click.option("--until", type=_Date(), help="Only sessions up to the end of that time."),
    click.option(
        "--flag", "flags", multiple=True, metavar="FLAG", help="Only with this flag; may be repeated."
    ),
    *(
        click.option(
            f"--com-{axis}",
            type=_Range(),
            metavar="LOW..HIGH",
            help=f"Only with {axis} of c in this range, in mm.",
        )
        for axis in "xyz"
    ),
    click.option(
        "--where", metavar="SQL", default="", help="Only where this SQL condition on the columns holds."
    ),
)


def with_selection(verb: Callable[..., None]) -> Callable[..., None]:
    """Decorator that adds the selecting options to a verb, which gets them as `selection`."""

    @wraps(verb)
    def call(**options: Any) -> None:
        from analyze.catalogue.listing import Selection

        texts = {name: options.pop(name) or "" for name in ("object", "rig", "since", "until", "where")}
        ranges = tuple(options.pop(f"com_{axis}") for axis in "xyz")
        chosen: Selection = Selection(**texts, flags=options.pop("flags"), com_mm=ranges)
        verb(selection=chosen, **options)

    return _select(call)


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, one line per row.")


def print_json_lines(rows: Iterable[dict[str, Any]]) -> None:
    """Print each row as a line of JSON."""
    for row in rows:
        echo(json.dumps(row, ensure_ascii=False, allow_nan=False))
