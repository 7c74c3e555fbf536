"""One table of a TOML file written anew; every other line stays as people wrote it."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from typing import Any

_HEADER = re.compile(r"""\s*\[{1,2}\s*[\w"'.\- ]+\s*\]{1,2}\s*(#.*)?$""")


def with_table(text: str, table: str, entries: Mapping[str, str]) -> str | None:
    """`text` with [table] holding just these entries (key -> value as TOML); None where that cannot be done by lines.

    Args:
        text: a TOML file's content.
        table: its dotted name.
        entries: what shall stand in it, in this order.
    """
    lines = text.splitlines()
    headers = [i for i, line in enumerate(lines) if _HEADER.match(line)]
    named = re.compile(r"\s*\[\s*" + r"\s*\.\s*".join(map(re.escape, table.split("."))) + r"\s*\]\s*(#.*)?$")
    start = next((i for i in headers if named.match(lines[i])), None)
    body = [f"{key} = {value}" for key, value in entries.items()]
    if start is None:
        new = [*lines, *([""] if lines and lines[-1].strip() else []), f"[{table}]", *body]
    else:
        end = next((i for i in headers if i > start), len(lines))
        # Blank lines and remarks just before the next table are its own.
        after = end
        while after > start + 1 and (not lines[after - 1].strip() or lines[after - 1].lstrip().startswith("#")):
            after -= 1
        new = [*lines[: start + 1], *body, *lines[after:]]
    changed = "\n".join(new) + "\n"
    return changed if _only_changes(text, changed, table, "\n".join(body)) else None


def _only_changes(before: str, after: str, table: str, body: str) -> bool:
    """Whether the file means the same but for this table: a table can be written in ways that a line editor does not see."""
    old: dict[str, Any]
    try:
        old, new, wanted = tomllib.loads(before), tomllib.loads(after), tomllib.loads(body)
    except tomllib.TOMLDecodeError:
        return False
    at = old
    *path, last = table.split(".")
    for key in path:
        at = at.setdefault(key, {})
        if not isinstance(at, dict):
            return False
    at[last] = wanted
    return old == new
