"""Fields packed by hand equal those that protobuf packs."""

import pytest
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from hypothesis import given
from hypothesis import strategies as st

from schemas.mcap.protobuf_wire import read_fields, timestamp_field, varint
from schemas.mcap.records import ContainerError


@given(st.integers(0, 2**63 - 1), st.integers(0, 1 << 15))
def test_packed_time_and_length_are_parsed_by_protobuf(time_ns, size):
    read = RawImage.FromString(timestamp_field(time_ns) + bytes([6 << 3 | 2]) + varint(size) + bytes(size))
    assert read.timestamp.seconds * 10**9 + read.timestamp.nanos == time_ns
    assert len(read.data) == size


def test_a_field_of_64_bits_that_is_cut_off_is_damage():
    whole = bytes([1 << 3 | 1]) + bytes(8)
    assert list(read_fields(memoryview(whole))) == []
    with pytest.raises(ContainerError, match="ends early"):
        list(read_fields(memoryview(whole[:-1])))
