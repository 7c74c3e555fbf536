"""Values from the bytes that `encoding.encode` makes, built by the annotations of the expected type.

Only classes that the expected type's annotations name are created, so that no data can run code.
"""

from __future__ import annotations

import json
import sys
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, TypeVar, Union, cast, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import ValidationError

from analyze.cache.encoding import ARRAY, CLASS, DOCUMENT, DTYPES, FIELDS, GIVEN, MEMBER, PAIRS, SCALAR, SET
from schemas.document import Document

T = TypeVar("T")
MAX_DEPTH = 40
"""deepest nesting of a value; the deepest of an estimate is 10"""


class DecodeError(ValueError):
    """Bytes that do not stand for a value of the expected type."""


def decode(data: bytes, kind: type[T], given: Mapping[type, object] | None = None) -> T:
    """Decode a value of type `kind` from the bytes that `encode` made of it.

    Args:
        data: the bytes.
        kind: type of the value.
        given: values of the types that were left out of the bytes, by type.

    Raises:
        DecodeError: the bytes do not stand for such a value.
        TypeError: an annotation within `kind` has no decoding.
    """
    head, separator, rest = data.partition(b"\n")
    if not separator:
        raise DecodeError("ends early")
    try:
        tree = json.loads(head)
    except (ValueError, RecursionError):
        raise DecodeError("is not JSON") from None
    reader = _Reader(rest, given or {})
    value = reader.value(tree, kind, 0)
    if reader.rest:
        raise DecodeError(f"{reader.rest} bytes are left over")
    return cast("T", value)


@cache
def field_types(kind: type) -> dict[str, Any]:
    """Types of a dataclass's fields, by name.

    Names that the class's module imports for type checkers only are looked up in the modules of this package
    that are loaded.

    Raises:
        TypeError: an annotation names a class that is not loaded.
    """
    module = vars(sys.modules[kind.__module__])
    names = _Names(module)
    try:
        hints = get_type_hints(kind, module, names)
    except NameError as error:
        raise TypeError(f"{kind.__qualname__}: {error}") from None
    return {field.name: hints[field.name] for field in fields(kind)}


class _Names(dict[str, Any]):
    """Names of a module, and those of other modules of the package where it has none of that name."""

    def __missing__(self, name: str) -> Any:
        for known, module in list(sys.modules.items()):
            if known.startswith("analyze.") and name in vars(module):
                return vars(module)[name]
        raise KeyError(name)


class _Reader:
    """Reader of one value: its JSON, and the data of its arrays, which it takes in their order."""

    def __init__(self, data: bytes, given: Mapping[type, object]) -> None:
        self._data, self._place, self._given = data, 0, given

    @property
    def rest(self) -> int:
        """Number of bytes of array data that were not taken."""
        return len(self._data) - self._place

    def value(self, tree: Any, kind: Any, depth: int) -> Any:
        """Value of type `kind` that the JSON value `tree`, nested in `depth` others, stands for."""
        if depth > MAX_DEPTH:
            raise DecodeError("is nested too deeply")
        origin = get_origin(kind)
        if origin in {Union, types.UnionType}:
            return self._any_of(tree, get_args(kind), depth)
        if (read := _READERS.get(origin or kind)) is not None:
            return read(self, tree, get_args(kind), depth + 1)
        if isinstance(kind, type) and origin is None:
            return self._instance(tree, kind, depth + 1)
        raise TypeError(f"{kind} has no decoding")

    def _any_of(self, tree: Any, kinds: Sequence[Any], depth: int) -> Any:
        place = self._place
        for kind in kinds:
            try:
                return self.value(tree, kind, depth)
            except DecodeError:
                self._place = place
        raise DecodeError("is of none of the expected types")

    def _instance(self, tree: Any, kind: type, depth: int) -> Any:
        if kind in _PLAIN:
            return _plain(tree, kind)
        if kind in self._given:
            if tree != {GIVEN: kind.__qualname__}:
                raise DecodeError(f"is no {kind.__qualname__}")
            return self._given[kind]
        if not isinstance(tree, dict) or tree.get(CLASS) != kind.__qualname__:
            raise DecodeError(f"is no {kind.__qualname__}")
        if issubclass(kind, Enum):
            return _member(tree.get(MEMBER), kind)
        if issubclass(kind, Document):
            return _document(tree.get(DOCUMENT), kind)
        if not is_dataclass(kind):
            raise TypeError(f"{kind.__qualname__} has no decoding")
        expected, found = field_types(kind), tree.get(FIELDS)
        if not isinstance(found, dict) or found.keys() != expected.keys():
            raise DecodeError(f"has other fields than {kind.__qualname__}")
        return kind(**{name: self.value(found[name], each, depth) for name, each in expected.items()})

    def tuple(self, tree: Any, kinds: Sequence[Any], depth: int) -> tuple[Any, ...]:
        """Tuple of values: all of type `kinds[0]` if an ellipsis follows it, else item i of `kinds[i]`."""
        items = _list(tree)
        each = [kinds[0]] * len(items) if len(kinds) == 2 and kinds[1] is Ellipsis else list(kinds)
        if len(each) != len(items):
            raise DecodeError(f"has {len(items)} entries, not {len(each)}")
        return tuple(self.value(item, kind, depth) for item, kind in zip(items, each, strict=True))

    def list(self, tree: Any, kinds: Sequence[Any], depth: int) -> list[Any]:
        """List of values of the only type in `kinds`."""
        return [self.value(item, kinds[0], depth) for item in _list(tree)]

    def set(self, tree: Any, kinds: Sequence[Any], depth: int) -> frozenset[Any]:
        """Set of values of the only type in `kinds`."""
        return frozenset(self.value(item, kinds[0], depth) for item in _list(_entry(tree, SET)))

    def mapping(self, tree: Any, kinds: Sequence[Any], depth: int) -> dict[Any, Any]:
        """Mapping, of the two types in `kinds`: key and value."""
        pairs = [_list(pair) for pair in _list(_entry(tree, PAIRS))]
        if any(len(pair) != 2 for pair in pairs):
            raise DecodeError("is no mapping")
        return {self.value(key, kinds[0], depth): self.value(each, kinds[1], depth) for key, each in pairs}

    def array(self, tree: Any, _kinds: Sequence[Any], _depth: int) -> np.ndarray:
        """Array with the order of axes in memory that it had when it was encoded."""
        dtype = _dtype(_entry(tree, ARRAY))
        shape, order = _list(tree.get("shape")), _list(tree.get("order"))
        if not all(type(each) is int and each >= 0 for each in [*shape, *order]):
            raise DecodeError("has an impossible shape")
        if sorted(order) != list(range(len(shape))):
            raise DecodeError("has an impossible order of axes")
        size = dtype.itemsize
        for each in shape:
            size *= each
        if size > self.rest:
            raise DecodeError("has more entries than data")
        data = np.frombuffer(self._data, dtype, size // dtype.itemsize, self._place).copy()
        self._place += size
        axes = [order.index(axis) for axis in range(len(shape))]
        try:
            return data.reshape([shape[axis] for axis in order]).transpose(axes)
        except (ValueError, OverflowError):
            raise DecodeError("has an impossible shape") from None


_READERS: dict[Any, Callable[[_Reader, Any, Sequence[Any], int], Any]] = {
    tuple: _Reader.tuple,
    list: _Reader.list,
    frozenset: _Reader.set,
    dict: _Reader.mapping,
    Mapping: _Reader.mapping,
    np.ndarray: _Reader.array,
}
_PLAIN: dict[type, tuple[type, ...]] = {
    bool: (bool,),
    int: (int,),
    float: (float, int),
    str: (str,),
    types.NoneType: (types.NoneType,),
}
"""types of JSON values by the type that they stand for"""


def _plain(tree: Any, kind: type) -> Any:
    """Plain value of type `kind` that `tree` stands for: text, number, True, False, None or numpy scalar.

    Raises:
        DecodeError: it stands for a value of another type, or out of range.
    """
    if isinstance(tree, dict) and kind is not types.NoneType:
        value, dtype = tree.get("value"), _dtype(_entry(tree, SCALAR))
        if type(value) not in {bool, int, float}:
            raise DecodeError("is no number")
        try:
            return dtype.type(value)
        except (OverflowError, ValueError):
            raise DecodeError("is out of range") from None
    if type(tree) not in _PLAIN[kind]:
        raise DecodeError(f"is no {kind.__name__}")
    return tree


def _member(name: Any, kind: type[Enum]) -> Enum:
    if not isinstance(name, str) or name not in kind.__members__:
        raise DecodeError(f"is no {kind.__qualname__}")
    return kind[name]


def _document(text: Any, kind: type[Document]) -> Document:
    if not isinstance(text, str):
        raise DecodeError(f"is no {kind.__qualname__}")
    try:
        return kind.model_validate_json(text)
    except ValidationError:
        raise DecodeError(f"is no {kind.__qualname__}") from None


def _list(tree: Any) -> list[Any]:
    if not isinstance(tree, list):
        raise DecodeError("is no list")
    return tree


def _entry(tree: Any, name: str) -> Any:
    if not isinstance(tree, dict) or name not in tree:
        raise DecodeError(f"has no entry {name}")
    return tree[name]


def _dtype(name: Any) -> np.dtype:
    if not isinstance(name, str) or name not in DTYPES:
        raise DecodeError("has an unknown dtype")
    return DTYPES[name]
