"""Edits of entries of a TOML file; comments, layout and all other entries stay as they were written.

Each public function takes the text of a file and returns the changed text. It returns None if the text is not
TOML, or if the table is not written as [table] or [[table]]: an inline table or dotted keys are left to the
user.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Table


def with_table(text: str, table: str, entries: Mapping[str, str]) -> str | None:
    """Text of a TOML file with exactly these entries in [table]; a missing table is added at the end.

    Args:
        text: content of a TOML file.
        table: dotted name of the table.
        entries: values, as TOML, by key; other entries of the table are removed.

    Returns:
        The changed text; None if `text` or a value is not TOML, or the table is not written as [table].
    """
    try:
        document = tomlkit.parse(text)
        found = _find(document, table)
        if found is None:
            return _with_new_table(text, table, entries)
        if not isinstance(found, Table):
            return None
        for key in [key for key in found if key not in entries]:
            del found[key]
        for key, value in entries.items():
            _set_entry(found, key, value)
    except TOMLKitError:
        return None
    return _rendered(document)


def with_entry(text: str, table: str, key: str, value: str) -> str | None:
    """Text of a TOML file with one entry set in [table], which must exist.

    Args:
        text: content of a TOML file.
        table: dotted name of the table.
        key: key of the entry, which is added or replaced.
        value: value of the entry, as TOML.

    Returns:
        The changed text; None if `text` or `value` is not TOML, or there is no table written as [table].
    """
    try:
        document = tomlkit.parse(text)
        found = _find(document, table)
        if not isinstance(found, Table):
            return None
        _set_entry(found, key, value)
    except TOMLKitError:
        return None
    return _rendered(document)


def with_entry_in_each(text: str, table: str, key: str, values: Mapping[int, str]) -> str | None:
    """Text of a TOML file with an entry set in some of the [[table]]s.

    Args:
        text: content of a TOML file.
        table: name of an array of tables.
        key: key of the entry, which is added or replaced.
        values: values, as TOML, by the number of the [[table]], from 0.

    Returns:
        The changed text; None if `text` or a value is not TOML, or a numbered [[table]] does not exist.
    """
    try:
        document = tomlkit.parse(text)
        tables = document.get(table)
        if not isinstance(tables, AoT) or any(number >= len(tables) for number in values):
            return None
        for number, value in values.items():
            _set_entry(tables.body[number], key, value)
    except TOMLKitError:
        return None
    return _rendered(document)


def _find(document: tomlkit.TOMLDocument, table: str) -> object:
    """Table or value in a document by its dotted name; None if it is missing.

    Raises:
        TOMLKitError: the name leads through something that is not a table.
    """
    found: object = document
    for name in table.split("."):
        if not isinstance(found, Mapping):
            raise TOMLKitError(f"{name} is not in a table")
        found = found.get(name)
        if found is None:
            return None
    return found


def _set_entry(table: Table, key: str, value: str) -> None:
    """Replace an entry of a table in its place, or add it after the last entry; changes `table`.

    Raises:
        TOMLKitError: `value` is not a TOML value.
    """
    item = tomlkit.value(value)
    if key in table:
        table[key] = item
        return
    # Blank lines and comments at the end of a table belong to the next table.
    body, trailing = table.value.body, []
    while body and body[-1][0] is None:
        trailing.insert(0, body.pop())
    table.add(key, item)
    body.extend(trailing)


def _with_new_table(text: str, table: str, entries: Mapping[str, str]) -> str | None:
    before = text if not text or text.endswith("\n") else f"{text}\n"
    lines = [
        *([""] if before.strip() else []),
        f"[{table}]",
        *(f"{key} = {value}" for key, value in entries.items()),
    ]
    added = before + "\n".join(lines) + "\n"
    return added if _is_toml(added) else None


def _rendered(document: tomlkit.TOMLDocument) -> str | None:
    """Text of an edited document; None if the text, parsed again, does not have the document's content.

    The latter happens where tomlkit cannot express a change at the place of the entry.
    """
    text = document.as_string()
    return text if _is_toml(text) and tomllib.loads(text) == document.unwrap() else None


def _is_toml(text: str) -> bool:
    try:
        tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return False
    return True
