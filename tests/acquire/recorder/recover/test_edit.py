"""Topics are added to and removed from finished recordings; the original is complete at every moment."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.recorder.recover.edit import append_topics, read_manifest
from schemas import topics
from schemas.mcap.content_hash import ContentHash
from schemas.proto import percuss_pb2 as pb
from tests import small_recording as small
from tests.removed_topics import remove_topics


def _poses(count: int) -> Iterator[tuple[topics.Topic, int, bytes]]:
    for number in range(count):
        yield (
            topics.TRUTH_POSE,
            small.START_NS + number,
            pb.TruthPose(world_time_ns=number, p_world_object=[0, 0, number]).SerializeToString(),
        )
        if number % 50 == 0:
            yield (
                topics.TRUTH_CONTACT,
                small.START_NS + number,
                pb.TruthContact(world_time_ns=number).SerializeToString(),
            )


def _messages(path: Path) -> list[tuple[str, int, int, bytes]]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [
            (channel.topic, message.log_time, message.sequence, message.data)
            for _, channel, message in reader.iter_messages()
        ]


def _content_id(path: Path) -> str:
    with path.open("rb") as file:
        return next(
            m.metadata["content_id"] for m in make_reader(file).iter_metadata() if m.name == "percuss.seal"
        )


def test_added_truth_reads_in_the_reference_implementation(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    seal = small.write_recording(path)
    before = _messages(path)
    append_topics(path, _poses(30_000))
    after = _messages(path)
    assert [message for message in after if not message[0].startswith("/truth/")] == before
    poses = [message for message in after if message[0] == "/truth/pose"]
    assert [pb.TruthPose.FromString(data).world_time_ns for _, _, _, data in poses] == list(range(30_000))
    assert _content_id(path) == seal.content_id
    assert read_manifest(path) == small.manifest()
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(after)


def test_removing_added_topics_restores_the_recording(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    seal = small.write_recording(path)
    before = _messages(path)
    append_topics(path, _poses(100))
    remove_topics(path, tmp_path / "b.mcap", "/truth/")
    assert _messages(tmp_path / "b.mcap") == before
    assert _content_id(tmp_path / "b.mcap") == seal.content_id
    append_topics(tmp_path / "b.mcap", _poses(7))
    assert len(_messages(tmp_path / "b.mcap")) == len(before) + 8


def test_removing_a_sealed_topic_computes_a_new_seal(tmp_path: Path) -> None:
    """Striker samples are removed from chunks shared with other topics; the hash of the rest is sealed."""
    seal = small.write_recording(tmp_path / "a.mcap")
    remove_topics(tmp_path / "a.mcap", tmp_path / "b.mcap", "/striker/")
    left = _messages(tmp_path / "b.mcap")
    assert left == [
        message for message in _messages(tmp_path / "a.mcap") if not message[0].startswith("/striker/")
    ]
    assert _content_id(tmp_path / "b.mcap") != seal.content_id
    digest = ContentHash()
    for topic, log_time, _, data in left:
        digest.add(topic, log_time, len(data), data)
    assert _content_id(tmp_path / "b.mcap") == digest.hexdigest()


def test_a_refused_topic_leaves_the_recording_unchanged(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    small.write_recording(path)
    before = path.read_bytes()

    def breaks() -> Iterator[tuple[topics.Topic, int, bytes]]:
        yield from _poses(10)
        raise RuntimeError

    with pytest.raises(RecorderError, match="can be added later"):
        append_topics(path, [(topics.LOG, small.START_NS, b"")])
    with pytest.raises(RuntimeError):
        append_topics(path, breaks())
    assert path.read_bytes() == before
    append_topics(path, _poses(10))
    with pytest.raises(RecorderError, match="holds /truth/pose already"):
        append_topics(path, _poses(10))
    with pytest.raises(RecorderError, match="no such recording"):
        append_topics(tmp_path / "missing.mcap", [])
    (tmp_path / "cut.mcap").write_bytes(before[:-20])
    with pytest.raises(RecorderError, match="acquire recover"):
        append_topics(tmp_path / "cut.mcap", [])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "cut.mcap"]
