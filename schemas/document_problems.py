"""Problems of a document in one line: unknown keys, missing keys and wrong values.

Each problem comes with its remedy where one is known. A key's place is given by its path `loc`: names of
tables and numbers of list elements (from 0), as in pydantic's errors.
"""

from __future__ import annotations

import difflib
import json
from collections.abc import Sequence
from typing import Any, cast, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

MAX_NAMED_KEYS = 5
"""Keys of one problem that the line names; further ones are counted."""
MAX_KNOWN_KEYS = 16
"""Keys of a section that the line lists; a section with more is not listed."""
MAX_SHOWN_LENGTH = 40
"""Characters of a key or value that the line shows."""

EXPECTED_VALUES = {
    "float": ("a number", "NUMBER"),
    "int": ("a whole number", "NUMBER"),
    "string": ("text in quotes", '"TEXT"'),
    "bool": ("true or false", "true"),
    "list": ("a list", "[...]"),
    "tuple": ("a list", "[...]"),
}
"""Expected value in words and as TOML, by the first word of pydantic's error type."""
WRONG_TYPE_ERRORS = {f"{kind}_{how}" for kind in EXPECTED_VALUES for how in ("type", "parsing")} | {
    "int_from_float",
    "int_parsing_size",
}
RANGE_ERRORS = {"greater_than", "greater_than_equal", "less_than", "less_than_equal"}
BOUNDS = {"gt": "more than", "ge": "at least", "lt": "less than", "le": "at most"}
"""Bounds of a field's value in words, by pydantic's names."""

Path = tuple[int | str, ...]


def problems_in_one_line(
    error: ValidationError, model: type[BaseModel], data: object, *, by_hand: bool
) -> str:
    """Line of text that lists why `data` are not a valid document of class `model`.

    Named are unknown keys, missing keys and wrong values. At most MAX_NAMED_KEYS keys of a kind are named;
    further ones are counted. Of wrong values the first is explained, the others are only named.

    Args:
        error: pydantic's error.
        model: class of the expected document.
        data: content that was read.
        by_hand: True if people write such documents (TOML): explain how to add what is missing. Otherwise
            keys are only named.
    """
    found = error.errors()
    unknown = [each["loc"] for each in found if each["type"] == "extra_forbidden"]
    missing = [each["loc"] for each in found if each["type"] == "missing"]
    wrong = [each for each in found if each["type"] not in {"extra_forbidden", "missing"}]
    parts: list[str] = []
    if unknown:
        # A misspelt or misplaced key is both unknown and missing: it is named once, as the user wrote it.
        hints = [_hint(loc, model, data, missing) for loc in unknown[:MAX_NAMED_KEYS]] if by_hand else []
        meant = [loc for _, loc in hints if loc is not None]
        missing = [loc for loc in missing if loc not in meant]
        parts.append(_unknown_text(unknown, list(dict.fromkeys(text for text, _ in hints if text))))
    if missing:
        named = [_remedy(loc, model) if by_hand else f"'{_dotted(loc)}'" for loc in missing]
        parts.append(f"missing: {'add ' if by_hand else ''}{_listed(named)}")
    if wrong:
        parts.append(_wrong_text(wrong, model, by_hand=by_hand))
    return "; ".join(parts)


def _unknown_text(unknown: Sequence[Path], hints: Sequence[str]) -> str:
    names = _listed([f"'{_dotted(loc)}'" for loc in unknown])
    one = len(unknown) == 1
    text = (
        f"unknown key {names}: remove it or correct its spelling"
        if one
        else f"unknown keys {names}: remove them or correct their spelling"
    )
    return f"{text} ({', '.join(hints)})" if hints else text


def _wrong_text(wrong: Sequence[ErrorDetails], model: type[BaseModel], *, by_hand: bool) -> str:
    first = wrong[0]
    where = _dotted(first["loc"])
    message = first["msg"].removeprefix("Value error, ")
    field = _field_at(model, first["loc"]) if first["loc"] else None
    if (
        by_hand
        and field is not None
        and _model_of(field.annotation) is not None
        and first["type"] in {"model_type", "list_type"}
    ):
        message = f"should be {_remedy(first['loc'], model)}"
    elif first["type"] == "model_type":
        message = "should be an object with keys"
    elif first["type"] in WRONG_TYPE_ERRORS:
        message = f"should be {EXPECTED_VALUES[first['type'].partition('_')[0]][0]}"
    elif first["type"] in RANGE_ERRORS and field is not None:
        message = _range_text(field) or message
    if first["type"] != "value_error":
        message += _shown(first["input"])
    if by_hand and first["type"] in WRONG_TYPE_ERRORS:
        message += _correction(first["loc"], first["type"], model)
    others = [f"'{_dotted(each['loc'])}'" for each in wrong[1:]]
    more = f"; wrong too: {_listed(others)}" if others else ""
    return f"{where}: {message}{more}" if where else f"{message}{more}"


def _range_text(field: FieldInfo) -> str:
    """Allowed range of a field's value, as "should be more than 0 and at most 10"; "" if it has one bound."""
    bounds = [
        f"{words} {value}"
        for name, words in BOUNDS.items()
        for each in field.metadata
        if (value := getattr(each, name, None)) is not None
    ]
    return f"should be {' and '.join(bounds)}" if len(bounds) > 1 else ""


def _hint(
    loc: Path, model: type[BaseModel], data: object, missing: Sequence[Path]
) -> tuple[str, Path | None]:
    """Suggestion for the unknown key at path `loc`, and the path of the key that it probably stands for.

    Returns:
        The text ("mass_kg?", or the advice to move the key above the first section) and the path of a missing
        or optional key. If no key of the table has a similar name, the text lists the keys that a section
        takes ("" for the document itself), and the path is None.
    """
    table, name = loc[:-1], str(loc[-1])
    if table and (name,) in missing:
        return f"{name} belongs above the first [section]", (name,)
    here = _model_at(model, table)
    if here is None:
        return "", None
    given = _value_at(data, table)
    free = [field for field in here.model_fields if not isinstance(given, dict) or field not in given]
    wanted = [field for field in free if (*table, field) in missing]
    for names in (wanted, free):
        for likely in difflib.get_close_matches(name, names, n=1):
            return f"{likely}?", (*table, likely)
    return (_known_keys(table, here), None) if table else ("", None)


def _known_keys(table: Path, model: type[BaseModel]) -> str:
    """Keys that a table may have, as "[shape] takes file, unit, box and cylinder"; "" if they are many."""
    *names, last = model.model_fields
    if len(names) >= MAX_KNOWN_KEYS:
        return ""
    return f"{_section(table)} takes {', '.join(names)} and {last}" if names else f"it takes {last}"


def _remedy(loc: Path, model: type[BaseModel]) -> str:
    """Words for an error message that show how to write the key at path `loc`: "size_m = ... in [shape.box]".

    A table is shown by its header, as "[shape]" or "[[marker]]". The key's description, if it has one,
    follows in brackets.
    """
    field = _field_at(model, loc)
    name, table = str(loc[-1]), loc[:-1]
    inner = None if field is None else _model_of(field.annotation)
    if inner is None:
        text = f"{name} = ..." + (f" in {_section(table)}" if table else "")
    else:
        text = (
            f"[[{_dotted(loc)}]]"
            if field is not None and "list" in str(field.annotation)
            else f"[{_dotted(loc)}]"
        )
    return f"{text} ({field.description})" if field is not None and field.description else text


def _correction(loc: Path, kind: str, model: type[BaseModel]) -> str:
    """Clause for an error message that shows how to write the value at path `loc` with the right type.

    The example is the entry's default or, without one, a placeholder; for an element of a list only the list
    is named. The clause is "" if `model` has no such entry.

    Args:
        loc: path of the wrong value.
        kind: pydantic's error type, for example "float_parsing".
        model: class of the document.
    """
    entry = loc
    while entry and isinstance(entry[-1], int):
        entry = entry[:-1]
    field = _field_at(model, entry) if entry else None
    if field is None:
        return ""
    place = f" in {_section(entry[:-1])}" if entry[:-1] else ""
    if entry != loc:
        return f": correct {entry[-1]}{place}"
    plain = isinstance(field.default, int | float | str)
    example = json.dumps(field.default) if plain else EXPECTED_VALUES[kind.partition("_")[0]][1]
    return f": write it like {entry[-1]} = {example}{place}"


def _section(table: Path) -> str:
    """Name of a table as written in TOML: `[a.b]`, or `[[a]] number 2` (from 1) in an array of tables."""
    rows = [part for part in table if isinstance(part, int)]
    name = ".".join(_clean(part) for part in table if isinstance(part, str))
    return f"[[{name}]] number {rows[-1] + 1}" if rows else f"[{name}]"


def _field_at(model: type[BaseModel], loc: Path) -> FieldInfo | None:
    here = _model_at(model, loc[:-1])
    return None if here is None else here.model_fields.get(str(loc[-1]))


def _model_at(model: type[BaseModel], loc: Path) -> type[BaseModel] | None:
    here: type[BaseModel] | None = model
    for part in loc:
        if isinstance(part, int):
            continue
        field = here.model_fields.get(part) if here is not None else None
        here = None if field is None else _model_of(field.annotation)
    return here


def _model_of(annotation: Any) -> type[BaseModel] | None:
    """Class of the nested document in a field's annotation; None if there is none.

    The annotation is `X`, `X | None` or `list[X]`, with X the class.
    """
    if isinstance(annotation, type) and not get_args(annotation):
        return annotation if issubclass(annotation, BaseModel) else None
    return next((found for inner in get_args(annotation) if (found := _model_of(inner)) is not None), None)


def _value_at(data: object, loc: Path) -> object:
    for part in loc:
        if isinstance(part, int) and isinstance(data, list):
            data = cast("list[object]", data)[part]
        elif isinstance(data, dict):
            data = cast("dict[object, object]", data).get(part)
        else:
            return None
    return data


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MAX_NAMED_KEYS} more" if len(names) > MAX_NAMED_KEYS else ""
    return ", ".join(names[:MAX_NAMED_KEYS]) + more


def _dotted(loc: Path) -> str:
    return ".".join(_clean(part) for part in loc)


def _clean(part: int | str) -> str:
    """Printable text of one name or number in a key's path.

    Characters that cannot be printed become "?". A text longer than MAX_SHOWN_LENGTH is cut to that length
    and followed by "...".
    """
    text = "".join(letter if letter.isprintable() else "?" for letter in str(part))
    return text if len(text) <= MAX_SHOWN_LENGTH else f"{text[:MAX_SHOWN_LENGTH]}..."


def _shown(value: object) -> str:
    """Clause ", not VALUE" for an error message, VALUE the text or number found.

    It is "" if the value is neither, or a text too long to show; of a long number the digits are counted.
    """
    text = repr(value) if isinstance(value, str | int | float) else ""
    if isinstance(value, int) and len(text) > MAX_SHOWN_LENGTH:
        text = f"{text[:8]}... ({len(text.removeprefix('-'))} digits)"
    return f", not {text}" if text and len(text) <= MAX_SHOWN_LENGTH else ""
