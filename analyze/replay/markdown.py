"""Text from users and programs as Markdown: names and messages that are shown letter by letter."""

from __future__ import annotations

import re

from schemas.plain_text import visible

_SIGNS = re.compile(r"[\\`*_\[\]<>#|~$&]")
_START = re.compile(r"^(\d+(?=[.)])|(?=[-+=:]))")
"""place of the sign that would make a line an item of a list, or the line below a heading"""
_CODE = re.compile(r"(`[^`]+`)")


def as_written(text: str) -> str:
    """Markdown that is shown as `text`, in one line, whatever signs of Markdown it holds.

    Args:
        text: name or value that users, files or programs gave; spaces at its ends are left out.
    """
    return _escaped(visible(text.strip()))


def message(text: str) -> str:
    """Markdown of a message, shown as it is, except that commands between backticks become code.

    Args:
        text: text such as a warning, a verdict or the reason of an error.
    """
    parts = _CODE.split(visible(text.strip()))
    return "".join(part if number % 2 else _escaped(part) for number, part in enumerate(parts))


def _escaped(text: str) -> str:
    one_line = " ".join(text.splitlines())
    return _START.sub(r"\1\\", _SIGNS.sub(r"\\\g<0>", one_line))
