"""Chunks of other programs' files that unpack to more than a bound are refused before they are unpacked."""

from __future__ import annotations

import pytest
from mcap.writer import CompressionType, Writer

from analyze.errors import ImportRefused
from analyze.sources.message_files import McapFile
from schemas.mcap import chunks


@pytest.mark.parametrize("compression", [CompressionType.LZ4, CompressionType.ZSTD])
@pytest.mark.parametrize("bound", [1 << 20, 1 << 22])
def test_a_chunk_larger_than_the_bound_is_refused(tmp_path, monkeypatch, compression, bound):
    monkeypatch.setattr(chunks, "MAX_DECOMPRESSED_BYTES", bound)
    path = tmp_path / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 30, compression=compression)
        writer.start()
        schema = writer.register_schema("T", "protobuf", b"")
        channel = writer.register_channel("/a", "protobuf", schema)
        for number in range(2):
            writer.add_message(channel, number, bytes(1 << 20), number, number)
        writer.finish()
    source = McapFile(path)
    (topic,) = source.topics()
    if bound > 1 << 21:
        assert len(list(source.messages(topic))) == 2
        return
    with pytest.raises(ImportRefused, match="chunks of a few megabytes"):
        list(source.messages(topic))
