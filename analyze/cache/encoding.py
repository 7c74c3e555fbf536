"""Values as bytes: dataclasses, arrays, documents and plain values, without pickle.

The bytes are a line of JSON, followed by the data of the arrays. The same value gives the same bytes, so
that their hash identifies it. `decoding` is the reverse.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from schemas.document import Document, canonical_json

_NAMES = ("b1", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "f4", "f8")
DTYPES = {np.dtype(name).str: np.dtype(name) for name in _NAMES}
"""dtypes that an array or a numpy scalar may have, by name"""
CLASS, FIELDS, MEMBER, DOCUMENT, GIVEN = "class", "fields", "member", "document", "given"
ARRAY, SCALAR, SET, PAIRS = "array", "scalar", "set", "pairs"
"""keys of the JSON objects that stand for values which JSON does not have"""


def encode(value: object, without: tuple[type, ...] = ()) -> bytes:
    """Encode a value as bytes; `decoding.decode` gives back an equal value.

    Values are dataclasses, documents (pydantic), numpy arrays and scalars, enumerations, tuples, lists, sets,
    mappings, texts, numbers, True, False and None, nested in any way. Of values of the types in `without`
    only the type is written; `decode` is given them.

    Raises:
        TypeError: the value, or one within it, is of another type.
    """
    arrays: list[bytes] = []
    tree = _Encoder(arrays, without).tree(value)
    return json.dumps(tree, separators=(",", ":"), ensure_ascii=True).encode() + b"\n" + b"".join(arrays)


class _Encoder:
    """Encoder of one value: turns it into JSON values, and appends the data of its arrays to `arrays`."""

    def __init__(self, arrays: list[bytes], without: tuple[type, ...]) -> None:
        self._arrays, self._without = arrays, without

    def tree(self, value: object) -> Any:
        """JSON value that stands for `value`."""
        # An enumeration's members may be texts, and numpy's float64 is a float: both are asked for first.
        if isinstance(value, Enum):
            return {MEMBER: value.name, CLASS: type(value).__qualname__}
        if isinstance(value, np.generic):
            return {SCALAR: _dtype(value.dtype), "value": value.item()}
        if value is None or isinstance(value, bool | int | float | str):
            return value
        if isinstance(value, tuple | list):
            return [self.tree(each) for each in value]
        if isinstance(value, np.ndarray):
            return self._array(value)
        return self._labelled(value)

    def _labelled(self, value: object) -> dict[str, Any]:
        """JSON object that stands for a set, a mapping, a document or a dataclass."""
        name = type(value).__qualname__
        if type(value) in self._without:
            return {GIVEN: name}
        if isinstance(value, set | frozenset):
            return {SET: [self.tree(each) for each in sorted(value)]}
        if isinstance(value, Mapping):
            return {PAIRS: [[self.tree(key), self.tree(each)] for key, each in value.items()]}
        if isinstance(value, Document):
            return {DOCUMENT: canonical_json(value), CLASS: name}
        if is_dataclass(value) and not isinstance(value, type):
            named = {field.name: self.tree(getattr(value, field.name)) for field in fields(value)}
            return {CLASS: name, FIELDS: named}
        raise TypeError(f"{name} has no encoding")

    def _array(self, array: np.ndarray) -> dict[str, Any]:
        """JSON object that describes an array.

        The data are in the order in which they lie in memory: sums may depend on it in their last digit.
        """
        order = sorted(range(array.ndim), key=lambda axis: -abs(array.strides[axis]))
        self._arrays.append(array.transpose(order).tobytes())
        return {ARRAY: _dtype(array.dtype), "shape": list(array.shape), "order": order}


def _dtype(dtype: np.dtype) -> str:
    if dtype.str not in DTYPES:
        raise TypeError(f"dtype {dtype} has no encoding")
    return dtype.str
