"""One table of a TOML file, one entry of it, or of one of its [[tables]], written anew; every other line stays as people wrote it."""

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
    start = _start(lines, headers, table)
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


def with_entry_in_each(text: str, table: str, key: str, values: Mapping[int, str]) -> str | None:
    """`text` with `key` = value (as TOML) in some of the [[table]]s; None where that cannot be done by lines.

    Args:
        text: a TOML file's content.
        table: name of an array of tables.
        key: of the entry; where it is there it is replaced.
        values: by the number of the [[table]], from 0.
    """
    lines = text.splitlines()
    headers = [i for i, line in enumerate(lines) if _HEADER.match(line)]
    named = re.compile(r"\s*\[\[\s*" + re.escape(table) + r"\s*\]\]\s*(#.*)?$")
    starts = [i for i in headers if named.match(lines[i])]
    if any(number >= len(starts) for number in values):
        return None
    for number in sorted(values, reverse=True):
        if not _write_entry(lines, headers, starts[number], key, values[number]):
            return None
    changed = "\n".join(lines) + "\n"
    try:
        old, new = tomllib.loads(text), tomllib.loads(changed)
        for number, value in values.items():
            old[table][number][key] = tomllib.loads(f"{key} = {value}")[key]
    except (tomllib.TOMLDecodeError, KeyError, IndexError, TypeError):
        return None
    return changed if old == new else None


def with_entry(text: str, table: str, key: str, value: str) -> str | None:
    """`text` with `key` = value (as TOML) in [table]; None where that cannot be done by lines, or there is no such table.

    Args:
        text: a TOML file's content.
        table: its dotted name.
        key: of the entry; where it is there it is replaced.
        value: as TOML.
    """
    lines = text.splitlines()
    headers = [i for i, line in enumerate(lines) if _HEADER.match(line)]
    start = _start(lines, headers, table)
    if start is None or not _write_entry(lines, headers, start, key, value):
        return None
    changed = "\n".join(lines) + "\n"
    try:
        old, new = tomllib.loads(text), tomllib.loads(changed)
        at = old
        for name in table.split("."):
            at = at[name]
        at[key] = tomllib.loads(f"{key} = {value}")[key]
    except (tomllib.TOMLDecodeError, KeyError, TypeError):
        return None
    return changed if old == new else None


def _start(lines: list[str], headers: list[int], table: str) -> int | None:
    """Line of the header [table]."""
    named = re.compile(r"\s*\[\s*" + r"\s*\.\s*".join(map(re.escape, table.split("."))) + r"\s*\]\s*(#.*)?$")
    return next((i for i in headers if named.match(lines[i])), None)


def _write_entry(lines: list[str], headers: list[int], start: int, key: str, value: str) -> bool:
    """Put the entry into the table whose header is line `start`, in place; False where the end of the old one cannot be told."""
    first = start + 1
    last = next((i for i in headers if i >= first), len(lines))
    body = _without_entry(lines[first:last], key)
    if body is None:
        return False
    # Blank lines and remarks just before the next table are its own.
    after = len(body)
    while after > 0 and (not body[after - 1].strip() or body[after - 1].lstrip().startswith("#")):
        after -= 1
    lines[first:last] = [*body[:after], f"{key} = {value}", *body[after:]]
    return True


def _without_entry(body: list[str], key: str) -> list[str] | None:
    """A table's lines without an entry, over however many lines it goes; None where its end cannot be told."""
    entry = re.compile(rf"\s*{re.escape(key)}\s*=")
    first = next((i for i, line in enumerate(body) if entry.match(line)), None)
    if first is None:
        return body
    for last in range(first + 1, len(body) + 1):
        try:
            tomllib.loads("\n".join(body[first:last]))
        except tomllib.TOMLDecodeError:
            continue
        return [*body[:first], *body[last:]]
    return None


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
