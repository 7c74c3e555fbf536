"""Values survive encoding and decoding; other bytes give a value or a DecodeError, no other error."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import pytest

from analyze.cache.decoding import DecodeError, decode
from analyze.cache.encoding import encode
from analyze.types import Array, TipAngle
from schemas.object_spec import Box, Cylinder


class Colour(Enum):
    RED = "red"


@dataclass(frozen=True)
class Inner:
    number: float


@dataclass(frozen=True)
class Whole:
    number: float
    name: int | str
    perhaps: Inner | None
    shape: Box | Cylinder
    colour: Colour
    pair: tuple[int, float]
    several: tuple[Inner, ...]
    names: frozenset[str]
    table: Mapping[str, Inner]
    rows: list[bool]
    values: Array


def whole(**changes: Any) -> Whole:
    values = {
        "number": 0.1,
        "name": "25h9-3",
        "perhaps": None,
        "shape": Cylinder(radius_m=0.02, height_m=0.1),
        "colour": Colour.RED,
        "pair": (1, float("nan")),
        "several": (Inner(1e-300), Inner(-0.0)),
        "names": frozenset({"b", "a"}),
        "table": {"x": Inner(2.0)},
        "rows": [True, False],
        "values": np.arange(6.0).reshape(2, 3),
    }
    return Whole(**{**values, **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"perhaps": Inner(float("inf")), "name": 7, "shape": Box(size_m=[0.1, 0.2, 0.3])},
        {"number": np.float64(0.1), "several": (), "names": frozenset(), "table": {}, "rows": []},
        {"values": np.zeros((0, 3)), "number": 3},
    ],
)
def test_a_value_comes_back(changes):
    value = whole(**changes)
    back = decode(encode(value), Whole)
    assert encode(back) == encode(value)
    assert (type(back.number), type(back.name)) == (type(value.number), type(value.name))
    assert back.shape == value.shape
    assert back.colour is Colour.RED
    assert back.values.flags.writeable


@pytest.mark.parametrize(
    "array",
    [
        np.arange(24.0).reshape(2, 3, 4).transpose(2, 0, 1),
        np.asfortranarray(np.arange(6.0).reshape(2, 3)),
        np.arange(12.0).reshape(3, 4)[:, ::2],
        np.arange(5, dtype=np.int64),
        np.array([True, False]),
        np.array(1.5),
    ],
)
def test_an_array_lies_in_memory_as_before(array):
    @dataclass(frozen=True)
    class One:
        values: Array

    One.__annotations__["values"] = Array
    back = decode(encode(One(array)), One).values
    np.testing.assert_array_equal(back, array)
    assert (back.dtype, back.shape) == (array.dtype, array.shape)
    assert np.argsort(back.strides).tolist() == np.argsort(array.strides).tolist()


def test_values_that_are_given_are_not_written():
    large = TipAngle(*([np.zeros(0, dtype=np.int64)] * 1), *([np.zeros(1000)] * 4))
    value = whole(perhaps=Inner(5.0))
    bytes_without = encode(value, (Inner,))
    assert decode(bytes_without, Whole, {Inner: large}).perhaps is large
    with pytest.raises(DecodeError):
        decode(bytes_without, Whole)


@pytest.mark.parametrize("value", [object(), 1j, np.array(["text"]), np.array([None]), Exception()])
def test_what_has_no_encoding_is_refused(value):
    with pytest.raises(TypeError):
        encode(value)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"{}",
        b"\n",
        b"null\n",
        b"[" * 100_000 + b"\n",
        b"{}\nleft over",
        encode(Inner(1.0)) + b"left over",
        encode(whole())[:-1],
        encode(whole()).replace(b'"pair":[1,', b'"pair":[1,2,'),
        encode(whole()).replace(b'"RED"', b'"__class__"'),
        encode(whole()).replace(b'"order":[0,1]', b'"order":[1,1]'),
        encode(whole()).replace(b'"shape":[2,3]', b'"shape":[-2,-3]'),
        encode(whole()).replace(b'"shape":[2,3]', b'"shape":[0,1000000000000000000000]'),
        encode(whole()).replace(b"<f8", b"|O"),
        encode(whole()).replace(b'"Whole"', b'"Inner"'),
        encode(whole()).replace(b"radius_m", b"edge_m"),
        encode(whole()).replace(b"0.1,", b'"0.1",'),
    ],
)
def test_other_bytes_are_refused(data):
    with pytest.raises(DecodeError):
        decode(data, Whole)


def test_damaged_bytes_give_a_value_or_a_decode_error():
    random, data = np.random.default_rng(3), encode(whole(perhaps=Inner(np.float32(2.0))))
    refused = 0
    for _ in range(2000):
        damaged = bytearray(data)
        for place in random.integers(0, len(data), random.integers(1, 4)):
            damaged[place] = random.integers(0, 256)
        try:
            assert isinstance(decode(bytes(damaged[: random.integers(1, len(data) + 1)]), Whole), Whole)
        except DecodeError:
            refused += 1
    assert refused > 1000


def test_json_of_other_shapes_is_refused():
    """Every node of the JSON is replaced by values of all JSON's types."""
    head, _, rest = encode(whole()).partition(b"\n")
    tree = json.loads(head)

    def places(node, path=()):
        yield path
        for key in node if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else ():
            yield from places(node[key], (*path, key))

    for path in list(places(tree))[1:]:
        for wrong in (None, True, -1, 10**30, 0.5, "x", [], {}, [[]], {"array": []}, {"scalar": "<i4"}):
            copy = json.loads(head)
            node = copy
            for key in path[:-1]:
                node = node[key]
            node[path[-1]] = wrong
            try:
                decode(json.dumps(copy).encode() + b"\n" + rest, Whole)
            except DecodeError:
                continue
