"""ROS 2 bags made to harm: bombs, computed tables, pipes and forged sizes are refused in one line."""

from __future__ import annotations

import os
import resource
import sqlite3
import struct
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from analyze.errors import ImportRefused
from analyze.sources.topic_source import TopicSource
from schemas.mcap import records as container
from tests.analyze.importing.foreign_files import images, write_bag

BOMB_BYTES = 600_000_000
MAX_GROWTH_KB = 500_000


def change(bag: Path, *statements: str) -> None:
    (path,) = bag.glob("*.db3")
    with sqlite3.connect(path) as database:
        for each in statements:
            database.execute(each)
    database.close()


def pack_file(bag: Path, data: bytes | None = None) -> None:
    """Compress the bag's file as a whole, as `ros2 bag record --compression-mode file` does."""
    (path,) = bag.glob("*.db3")
    packed = zstandard.compress(path.read_bytes() if data is None else data)
    path.with_name(f"{path.name}.zstd").write_bytes(packed)
    path.unlink()
    text = (bag / "metadata.yaml").read_text(encoding="utf-8").replace(path.name, f"{path.name}.zstd")
    text = text.replace("compression_format: ''", "compression_format: zstd")
    text = text.replace("compression_mode: ''", "compression_mode: file")
    assert "compression_mode: file" in text
    (bag / "metadata.yaml").write_text(text, encoding="utf-8")


def message_bomb(bag: Path) -> None:
    (path,) = bag.glob("*.db3")
    with sqlite3.connect(path) as database:
        database.execute("UPDATE messages SET data = ?", [zstandard.compress(bytes(BOMB_BYTES))])
    database.close()


def huge_message(bag: Path) -> None:
    change(bag, "UPDATE messages SET data = zeroblob(300000000) WHERE id = 3")


def file_bomb(bag: Path) -> None:
    pack_file(bag, bytes(BOMB_BYTES))


def generated_column(bag: Path) -> None:
    change(
        bag,
        "ALTER TABLE messages RENAME TO old",
        "CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, "
        "data BLOB GENERATED ALWAYS AS (zeroblob(900000000)) VIRTUAL)",
        "INSERT INTO messages SELECT id, topic_id, timestamp FROM old",
    )


def endless_view(bag: Path) -> None:
    change(
        bag,
        "DROP TABLE schema",
        "CREATE VIEW schema AS WITH RECURSIVE n(schema_version) AS (SELECT 1 UNION ALL "
        "SELECT schema_version + 1 FROM n) SELECT max(schema_version) AS schema_version FROM n",
    )


def packed_endless_view(bag: Path) -> None:
    endless_view(bag)
    pack_file(bag)


def pipe(bag: Path) -> None:
    (path,) = bag.glob("*.db3")
    path.unlink()
    os.mkfifo(path)


def large_metadata(bag: Path) -> None:
    with (bag / "metadata.yaml").open("ab") as file:
        file.truncate(1 << 40)


@pytest.mark.parametrize(
    ("harm", "packed", "text"),
    [
        (message_bomb, True, "a message unpacks to more than 256 MB"),
        (huge_message, False, "holds a message of 300 MB"),
        (file_bomb, False, "unpacks to more than 268 MB"),
        (generated_column, False, "computes 'messages' while it is read"),
        (endless_view, False, "computes 'schema' while it is read"),
        (packed_endless_view, False, "computes 'schema' while it is read"),
        (pipe, False, "it is a pipe, not a file"),
        (large_metadata, False, "metadata.yaml is larger than 32 MB"),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_a_hostile_bag_is_refused(
    tmp_path: Path, harm: Callable[[Path], None], packed: bool, text: str
) -> None:
    bag = write_bag(tmp_path / "bag", images(), storage=StoragePlugin.SQLITE3, compressed=packed)
    harm(bag)
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
    with pytest.raises(ImportRefused) as refusal:
        list(TopicSource(bag).frames())
    assert text in str(refusal.value)
    assert str(bag) in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MAX_GROWTH_KB
    assert time.monotonic() - start < 20


def test_a_bag_that_is_compressed_as_a_whole_is_read(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", images(), storage=StoragePlugin.SQLITE3)
    pack_file(bag)
    assert len(list(TopicSource(bag).frames())) == len(images())


@pytest.mark.parametrize("index", [True, False], ids=["indexed", "without index"])
def test_a_chunk_of_a_terabyte_in_a_bag_is_refused(tmp_path: Path, index: bool) -> None:
    bag = write_bag(tmp_path / "bag", images(), storage=StoragePlugin.MCAP)
    (path,) = bag.glob("*.mcap")
    stored = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 1 << 40) + b"\x01\x00\x00"
    body = struct.pack("<QQQI", 1, 2, 1 << 40, 0) + container.pack_string("zstd")
    chunk = container.pack_record(container.CHUNK, body + struct.pack("<Q", len(stored)) + stored)
    data = path.read_bytes()
    at = data.index(b"\x06")
    path.write_bytes(data[:at] + chunk + data[at + len(chunk) :] if index else container.MAGIC + chunk)
    with pytest.raises(ImportRefused) as refusal:
        list(TopicSource(bag).frames())
    assert "\n" not in str(refusal.value)
