"""Text from files made harmless where it is shown: control characters become visible, formulas text.

Names of objects, strikes, topics and files come from other people and contain whatever they like: sequences
that command a terminal, characters that reverse the order of others, cells that a spreadsheet executes.
"""

from __future__ import annotations

import codecs
import re
from typing import IO, Any, Final

import click

_UNSEEN: Final = chr(0xFFFD)
_VISIBLE: Final = (
    {code: chr(0x2400 + code) for code in range(0x20) if chr(code) not in "\n\t"}
    | dict.fromkeys(range(0x7F, 0xA0), _UNSEEN)
    | dict.fromkeys([*range(0x202A, 0x202F), *range(0x2066, 0x206A), 0x200E, 0x200F, 0x061C], _UNSEEN)
    | dict.fromkeys(range(0xD800, 0xE000), _UNSEEN)
)
"""visible signs in place of characters that move the cursor, change colours or the order of writing"""
_INVISIBLE: Final = re.compile(f"[{''.join(map(re.escape, map(chr, _VISIBLE)))}]")
_FORMULA: Final = re.compile(r"[=+\-@\t\r]")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.IGNORECASE)


def visible(text: str) -> str:
    """Text with visible signs in place of control characters other than line feed and tabulator."""
    return text.translate(_VISIBLE)


def shown_value(value: object) -> object:
    """Value of an expression in a template: texts as `visible` shows them, others as they are."""
    return visible(value) if isinstance(value, str) else value


def csv_cell(text: str) -> str:
    """Text of a cell of a CSV table, which no spreadsheet takes for a formula.

    An apostrophe goes before a text that begins with =, +, -, @ or a blank character that spreadsheets skip
    (OWASP, "CSV Injection"); numbers stay.
    """
    shown = visible(text)
    return f"'{shown}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text) else shown


def echo(text: str, *, err: bool = False) -> None:
    """Print a text and a line feed on standard output, or standard error, as `visible` shows it."""
    click.echo(visible(text), err=err)


def json_line(text: str) -> str:
    """JSON text with escapes for characters in its strings that `visible` would replace; the same values."""
    return _INVISIBLE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def write_escaped(*streams: IO[Any]) -> None:
    """Let text streams write what their encoding lacks as JSON escapes, instead of failing."""
    codecs.register_error("percuss.json", _json_escape)
    for stream in streams:
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors="percuss.json")


def _json_escape(error: UnicodeError) -> tuple[str, int]:
    r"""Replace characters that cannot be encoded by \uXXXX, two of them beyond 16 bits."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    units = error.object[error.start : error.end].encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{units[at : at + 2].hex()}" for at in range(0, len(units), 2)), error.end
