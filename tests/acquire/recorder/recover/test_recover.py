"""Recovery of cut and damaged recordings: every whole record is saved, and the losses are reported."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from mcap.reader import make_reader

from acquire.errors import RecorderError
from acquire.recorder.recover.recover import recover
from analyze.errors import RecordingError
from analyze.reading.recording import open_recording
from analyze.verbs.inspect.recording import inspect_recording
from schemas import topics
from schemas.document import canonical_json
from schemas.mcap import records as container
from schemas.mcap.walk import walk
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from tests import small_recording as small
from tests.mcap_writer import McapWriter


def _sequences(path: Path, topic: str) -> list[int]:
    with path.open("rb") as file:
        return [
            message.sequence
            for _, _, message in make_reader(file, validate_crcs=True).iter_messages(topics=[topic])
        ]


def _attachments(path: Path) -> dict[str, bytes]:
    with path.open("rb") as file:
        return {attachment.name: attachment.data for attachment in make_reader(file).iter_attachments()}


def test_a_killed_recording(tmp_path: Path) -> None:
    writer = McapWriter(tmp_path / "a.mcap")
    small.write_head(writer)
    small.write_body(writer)
    writer.flush()
    writer.abort()
    report = recover(tmp_path / "a.mcap.part", tmp_path / "a.mcap")
    assert not report.anything_damaged
    assert not report.ended_properly
    assert report.anything_lost  # whatever had not reached the disk: nobody can know how much
    assert report.topics["/striker/sample"] == small.SAMPLES
    assert f"lost: everything later: the file ends {report.lasts_s:.3f} s" in report.text()
    # The same messages have the same name, however they came into a file.
    assert report.content_id == small.write_recording(tmp_path / "b.mcap").content_id
    assert _attachments(tmp_path / "a.mcap") == {"plan.json": small.PLAN, "shape/box.stl": b"solid"}
    with (tmp_path / "a.mcap").open("rb") as file:
        names = [m.name for m in make_reader(file).iter_metadata()]
    assert names == ["percuss.manifest", "percuss.recovered", "percuss.seal"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.mcap", "a.mcap.part", "b.mcap"]


def test_a_complete_recording_is_recovered_unchanged(tmp_path: Path) -> None:
    seal = small.write_recording(tmp_path / "a.mcap")
    report = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert report.ended_properly
    assert not report.anything_lost
    assert (report.content_id, report.messages) == (seal.content_id, seal.messages)


def test_a_changed_manifest_is_reported_and_stays_detectable(tmp_path: Path) -> None:
    """A flipped bit in a lens coefficient must not become a valid recording by being rebuilt."""
    small.write_recording(tmp_path / "a.mcap")
    whole = (tmp_path / "a.mcap").read_bytes()
    flipped = bytearray(whole)
    flipped[whole.index(b'"g_m_s2"') + 12] ^= 1  # 9.81 becomes 9.91
    (tmp_path / "a.mcap").write_bytes(flipped)
    for source, out in (("a.mcap", "b.mcap"), ("b.mcap", "c.mcap")):
        report = recover(tmp_path / source, tmp_path / out)
        assert report.anything_lost
        assert "not what was recorded: the manifest is not the one that was recorded" in report.text()
    with (tmp_path / "c.mcap").open("rb") as file:
        entries = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    with (tmp_path / "a.mcap").open("rb") as file:
        sealed = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    assert entries["percuss.seal"] == sealed["percuss.seal"]


def test_a_changed_manifest_of_a_recording_without_seal_is_reported(tmp_path: Path) -> None:
    """The hash beside the manifest is all that a killed recording has."""
    writer = McapWriter(tmp_path / "a.mcap")
    small.write_head(writer)
    small.write_body(writer)
    writer.flush()
    writer.abort()
    part = tmp_path / "a.mcap.part"
    data = bytearray(part.read_bytes())
    data[data.index(b'"g_m_s2"') + 12] ^= 1
    part.write_bytes(data)
    report = recover(part, tmp_path / "b.mcap")
    assert "not what was recorded: the manifest is not the one that was recorded" in report.text()
    with pytest.raises(RecordingError, match="damaged: the manifest is not the one that was recorded"):
        open_recording(tmp_path / "b.mcap")


def test_what_no_hash_covers_is_marked(tmp_path: Path) -> None:
    """Nobody can say of an older killed recording whether its manifest is the one that was written."""
    writer = McapWriter(tmp_path / "a.mcap")
    writer.metadata("percuss.manifest", {"json": canonical_json(small.manifest(hashes={}))})
    small.write_body(writer)
    writer.flush()
    writer.abort()
    report = recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap")
    assert report.unverified == ["the manifest: the source states no hash of it"]
    with open_recording(tmp_path / "b.mcap") as recording:
        assert recording.recovery_losses == tuple(report.losses())
    assert (
        "rebuilt by `acquire recover`: cannot be verified: the manifest: the source states no hash of it"
        in (inspect_recording(tmp_path / "b.mcap")["health"])
    )
    # Recovered once more, the file is whole, and still says so.
    again = recover(tmp_path / "b.mcap", tmp_path / "c.mcap")
    assert not again.anything_lost
    with open_recording(tmp_path / "c.mcap") as recording:
        assert recording.recovery_losses == tuple(report.losses())


def test_a_doubled_chunk_of_a_recording_without_seal_is_reported(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    whole = (tmp_path / "a.mcap").read_bytes()
    records = list(walk(memoryview(whole), len(container.MAGIC)))
    start, end = next(
        (at, at + container.RECORD_HEAD + len(body)) for op, at, body in records if op == container.CHUNK
    )
    seal = max(at for op, at, _ in records if op == container.METADATA)
    (tmp_path / "b.mcap").write_bytes(whole[:end] + whole[start:seal])
    report = recover(tmp_path / "b.mcap", tmp_path / "c.mcap")
    assert any("stand twice or out of their order" in line for line in report.differences)
    (tmp_path / "b.mcap").write_bytes(whole[:seal])
    assert not recover(tmp_path / "b.mcap", tmp_path / "c.mcap", replace=True).anything_damaged


def test_messages_that_were_doubled_or_moved_are_reported(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    whole = (tmp_path / "a.mcap").read_bytes()
    chunks = [
        (at, at + container.RECORD_HEAD + len(body))
        for opcode, at, body in walk(memoryview(whole), len(container.MAGIC))
        if opcode == container.CHUNK
    ]
    (first, first_end), (second, second_end) = chunks[:2]
    doubled = whole[:first_end] + whole[first:first_end] + whole[first_end:]
    moved = whole[:first] + whole[second:second_end] + whole[first_end:second] + whole[first:first_end]
    for data in (doubled, moved + whole[second_end:]):
        (tmp_path / "b.mcap").write_bytes(data)
        report = recover(tmp_path / "b.mcap", tmp_path / "c.mcap", replace=True)
        assert (report.damaged_records, report.skipped_bytes, report.ended_properly) == (0, 0, True)
        assert report.anything_lost
        assert "the messages are not those that were sealed" in report.text()


def test_an_attachment_that_the_manifest_does_not_state_is_reported(tmp_path: Path) -> None:
    """With a right checksum of its own, as one that was exchanged."""
    with McapWriter(tmp_path / "a.mcap") as writer:
        small.write_head(writer)
        writer.attachment("plan.json", "application/json", b"{}")
        small.write_body(writer)
    report = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert "attachment 'plan.json' is not the one that the manifest states" in report.text()


def test_an_attachment_that_is_missing_is_reported(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap") as writer:
        text = canonical_json(small.manifest())
        writer.metadata(MANIFEST_NAME, manifest_entries(text))
        writer.attachment("plan.json", "application/json", small.PLAN)
        small.write_body(writer)
    report = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert report.differences == ["attachment 'shape/box.stl', which the manifest states, is missing"]


@pytest.mark.parametrize(
    ("opcode", "number", "line"),
    [
        (container.ATTACHMENT, 1, "1 attachment that the summary lists: 'shape/box.stl'"),
        (container.METADATA, 1, "1 metadata record that the summary lists: 'note'"),
        (container.CHUNK, 1, "1 message that the summary counts: 1 on /camera/main/image"),
    ],
)
@pytest.mark.parametrize("displaced", [False, True])
def test_what_only_the_summary_lists_is_reported(
    tmp_path: Path, opcode: int, number: int, line: str, displaced: bool
) -> None:
    """The manifest states no hashes, and the record is taken out whole: no checksum notices it.

    The footer still points at the summary, or at the place where it was.
    """
    with McapWriter(tmp_path / "a.mcap") as writer:
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(small.manifest(hashes={}))))
        writer.metadata("note", {"by": "hand"})
        writer.attachment("plan.json", "application/json", small.PLAN)
        writer.attachment("shape/box.stl", "model/stl", small.SHAPE)
        small.write_body(writer)
    whole = (tmp_path / "a.mcap").read_bytes()
    places = [
        (at, at + container.RECORD_HEAD + len(body))
        for each, at, body in walk(memoryview(whole), len(container.MAGIC))
        if each == opcode
    ]
    start, end = places[number]
    cut = len(container.MAGIC) + container.FOOTER_SIZE
    tail = bytearray(whole[-cut:])
    (summary,) = struct.unpack_from("<Q", tail, container.RECORD_HEAD)
    body = whole[summary:-cut]
    if not displaced:
        struct.pack_into("<Q", tail, container.RECORD_HEAD, summary - (end - start))
        struct.pack_into("<I", tail, container.RECORD_HEAD + 16, 0)
    (tmp_path / "b.mcap").write_bytes(whole[:start] + whole[end:summary] + body + tail)
    report = recover(tmp_path / "b.mcap", tmp_path / "c.mcap")
    assert (report.damaged_records, report.skipped_bytes, report.ended_properly) == (0, 0, True)
    assert report.anything_damaged
    assert report.missing == [line]
    with (tmp_path / "c.mcap").open("rb") as file:
        entries = {each.name: each.metadata for each in make_reader(file).iter_metadata()}
    assert f"lost: {line}" in entries["percuss.recovered"]["lines"].splitlines()


def test_a_manifest_that_stands_in_the_summary_is_reported(tmp_path: Path) -> None:
    """Exchanged with a schema of the summary, whose list then does not count: nothing told of the loss."""
    small.write_recording(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    found = list(walk(memoryview(data), len(container.MAGIC)))
    end = next(i for i, (opcode, _, _) in enumerate(found) if opcode == container.DATA_END)
    spans = [(at, at + container.RECORD_HEAD + len(body)) for _, at, body in found]
    manifest = next(i for i, (opcode, _, body) in enumerate(found) if opcode == container.METADATA)
    schema = next(i for i, (opcode, _, _) in enumerate(found) if i > end and opcode == container.SCHEMA)
    (a, b), (c, d) = spans[manifest], spans[schema]
    source = tmp_path / "b.mcap"
    source.write_bytes(data[:a] + data[c:d] + data[b:c] + data[a:b] + data[d:])
    report = recover(source, tmp_path / "c.mcap")
    assert not report.has_manifest
    assert report.anything_lost
    assert any("the manifest, whose hash" in each for each in report.losses())
    again = recover(tmp_path / "c.mcap", tmp_path / "d.mcap")
    assert not any("the manifest, whose hash" in each for each in again.missing)


def test_a_changed_declaration_is_taken_from_the_summary(tmp_path: Path) -> None:
    """Schemas and channels have no checksum where the data are, but in the summary."""
    small.write_recording(tmp_path / "a.mcap")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    data[data.index(b"percuss.v1.FrameMeta") + 3] ^= 1
    (tmp_path / "a.mcap").write_bytes(data)
    report = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert report.damaged_records == 1
    with open_recording(tmp_path / "b.mcap") as recording:
        schemas = {topic.name: topic.schema for topic in recording.topics()}
    assert schemas["/camera/main/meta"] == "percuss.v1.FrameMeta"


def test_a_cut_between_two_records_is_reported_as_a_loss(tmp_path: Path) -> None:
    """Every record up to the cut is complete; later ones, the strike's record among them, are missing."""
    small.write_recording(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    sizes = [
        (at, container.RECORD_HEAD + len(body))
        for _, at, body in walk(memoryview(data), len(container.MAGIC))
    ]
    chunks = [at + size for (at, size) in sizes if data[at] == container.CHUNK]
    cut = chunks[len(chunks) // 2]
    (tmp_path / "cut.mcap").write_bytes(data[:cut])
    report = recover(tmp_path / "cut.mcap", tmp_path / "b.mcap")
    assert (report.damaged_records, report.skipped_bytes) == (0, 0)
    assert report.anything_lost
    assert report.as_dict()["anything_lost"] is True
    assert "/session/strike" not in report.topics
    with (tmp_path / "b.mcap").open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert report.lasts_s == pytest.approx((max(times) - min(times)) * 1e-9)
    assert report.lasts_s < small.FRAMES * small.PERIOD_NS * 1e-9
    assert report.text().endswith(
        f"lost: everything later: the file ends {report.lasts_s:.3f} s after its first message"
    )


def test_a_cut_behind_the_data_loses_nothing(tmp_path: Path) -> None:
    """The summary is computed anew from the data."""
    seal = small.write_recording(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[:-60])
    report = recover(tmp_path / "cut.mcap", tmp_path / "b.mcap")
    assert not report.anything_lost
    assert report.content_id == seal.content_id


def test_a_cut_in_an_image_loses_that_image(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    cut = data[: data.find(small.image(9).tobytes()) + 50]
    (tmp_path / "cut.mcap").write_bytes(cut)
    report = recover(tmp_path / "cut.mcap", tmp_path / "b.mcap")
    assert report.anything_lost
    assert 50 < report.skipped_bytes < 400
    assert _sequences(tmp_path / "b.mcap", "/camera/main/image") == list(range(9))


def test_a_cut_in_small_topics_keeps_their_whole_messages(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "a.mcap") as writer:
        small.write_head(writer)
        channel = writer.add_topic(topics.STRIKER_SAMPLE)
        for number in range(100):
            writer.write(channel, small.START_NS + number, b"\x18\x01" * 10, sequence=number)
    data = (tmp_path / "a.mcap").read_bytes()
    middle = data.find(b"\x18\x01" * 10) + 40 * (31 + 20)
    (tmp_path / "cut.mcap").write_bytes(data[:middle])
    report = recover(tmp_path / "cut.mcap", tmp_path / "b.mcap")
    assert _sequences(tmp_path / "b.mcap", "/striker/sample") == list(range(40))
    assert 0 < report.skipped_bytes < 51


def test_a_wrong_length_costs_one_record_not_the_rest(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    start = data.find(small.image(9).tobytes())
    chunk = data.rfind(b"\x06", 0, start - 80)
    data[chunk + 5] = 0xFF  # the length becomes 1 TB
    (tmp_path / "bad.mcap").write_bytes(data)
    report = recover(tmp_path / "bad.mcap", tmp_path / "b.mcap")
    assert report.anything_lost
    assert _sequences(tmp_path / "b.mcap", "/camera/main/image")[-10:] == list(
        range(small.FRAMES - 10, small.FRAMES)
    )
    assert len(_sequences(tmp_path / "b.mcap", "/camera/main/image")) >= small.FRAMES - 1


def test_a_damaged_image_is_left_out_and_counted(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    data = bytearray((tmp_path / "a.mcap").read_bytes())
    data[data.find(small.image(5).tobytes()) + 9] ^= 4
    (tmp_path / "bad.mcap").write_bytes(data)
    report = recover(tmp_path / "bad.mcap", tmp_path / "b.mcap")
    assert (report.damaged_records, report.skipped_bytes) == (1, 0)
    assert _sequences(tmp_path / "b.mcap", "/camera/main/image") == [n for n in range(small.FRAMES) if n != 5]
    assert report.as_dict()["anything_lost"] is True


def test_what_cannot_be_saved_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "text.mcap").write_text("hello, this is text")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "head.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(100))
    (tmp_path / "taken.mcap").write_bytes(b"mine")
    for name, reason in [
        ("text", "is not a recording"),
        ("empty", "is empty"),
        ("head", "nothing can be saved"),
        ("none", "no such recording"),
    ]:
        with pytest.raises(RecorderError, match=reason):
            recover(tmp_path / f"{name}.mcap", tmp_path / "out.mcap")
    with pytest.raises(RecorderError, match="exists already"):
        recover(tmp_path / "text.mcap", tmp_path / "taken.mcap")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "empty.mcap",
        "head.mcap",
        "taken.mcap",
        "text.mcap",
    ]


def test_a_file_with_attachments_alone_is_saved(tmp_path: Path) -> None:
    """Records that another writer extended by bytes of its own are not damaged."""
    attachment = bytearray(container.pack_attachment("notes.txt", "text/plain", b"hello", 7) + b"own")
    struct.pack_into("<Q", attachment, 1, len(attachment) - container.RECORD_HEAD)
    with McapWriter(tmp_path / "a.mcap"):
        pass
    whole = (tmp_path / "a.mcap").read_bytes()
    kept = next(
        at for kind, at, _ in walk(memoryview(whole), len(container.MAGIC)) if kind != container.HEADER
    )
    (tmp_path / "a.mcap").write_bytes(whole[:kept] + attachment)
    report = recover(tmp_path / "a.mcap", tmp_path / "b.mcap")
    assert (report.messages, report.attachments, report.damaged_records) == (0, 1, 0)
    assert _attachments(tmp_path / "b.mcap") == {"notes.txt": b"hello"}
