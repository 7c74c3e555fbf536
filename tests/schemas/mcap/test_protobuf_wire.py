"""Fields packed by hand equal those that protobuf packs."""

from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from hypothesis import given
from hypothesis import strategies as st

from schemas.mcap.protobuf_wire import timestamp_field, varint


@given(st.integers(0, 2**63 - 1), st.integers(0, 1 << 15))
def test_packed_time_and_length_are_parsed_by_protobuf(time_ns, size):
    read = RawImage.FromString(timestamp_field(time_ns) + bytes([6 << 3 | 2]) + varint(size) + bytes(size))
    assert read.timestamp.seconds * 10**9 + read.timestamp.nanos == time_ns
    assert len(read.data) == size
