"""Reading recordings: written content is read back, and any fault of a file is one line."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from acquire.errors import RecorderError
from acquire.recorder.recover.edit import append_topics
from acquire.recorder.recover.recover import recover
from analyze.errors import RecordingCut, RecordingError, RecordingVersion
from analyze.reading.followed_recording import FollowedRecording
from analyze.reading.recording import Recording, open_partial, open_recording
from analyze.reading.truth import read_truth
from schemas import topics
from schemas.document import canonical_json
from schemas.proto import percuss_pb2 as pb
from schemas.session_manifest import TimeSource
from tests import small_recording as small
from tests.mcap_writer import McapWriter
from tests.removed_topics import remove_topics


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "a.mcap"
    small.write_recording(path)
    return path


def _everything(path: Path) -> int:
    """Read everything in a recording; the number of messages."""
    with open_recording(path) as recording:
        count = sum(1 for topic in recording.topics() for _ in recording.messages(topic.name))
        assert sum(int(frame.image.sum()) > 0 for frame in recording.images()) >= 0
        assert list(recording.frame_meta()) is not None
        return count + len(recording.strikes)


def test_written_content_is_read_back(whole: Path) -> None:
    with open_recording(whole) as recording:
        assert recording.manifest == small.manifest()
        assert recording.content_id is not None
        assert recording.attachments == {"plan.json": small.PLAN, "shape/box.stl": b"solid"}
        assert recording.shape_bytes == b"solid"
        assert recording.object_spec.name == "box"
        assert [strike.strike_id for strike in recording.strikes] == ["s1.1"]
        assert [meta.sequence for meta in recording.frame_meta()] == list(range(small.FRAMES))
        ticks = [sample.tick_ms for _, sample in recording.decoded("/striker/sample", pb.StrikerSample)]
        assert ticks == list(range(small.SAMPLES))
        counts = {topic.name: (topic.schema, topic.count) for topic in recording.topics()}
        frames = list(recording.images())
    assert counts["/camera/main/image"] == ("foxglove.RawImage", small.FRAMES)
    assert counts["/striker/sample"] == ("percuss.v1.StrikerSample", small.SAMPLES)
    # The images are views of the file and outlive the recording.
    for number, frame in enumerate(frames):
        assert (frame.time_ns, frame.sequence) == (small.frame_time(number), number)
        assert not frame.image.flags.owndata
        assert not frame.image.flags.writeable
        np.testing.assert_array_equal(frame.image, small.image(number))


def test_a_range_includes_both_ends(whole: Path) -> None:
    with open_recording(whole) as recording:
        found = [
            frame.sequence for frame in recording.images("main", small.frame_time(3), small.frame_time(7))
        ]
        assert found == [3, 4, 5, 6, 7]
        assert list(recording.messages("/no/such/topic")) == []


def test_png_images_are_decoded(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap", png=True)
    with open_recording(tmp_path / "a.mcap") as recording:
        for number, frame in enumerate(recording.images()):
            np.testing.assert_array_equal(frame.image, small.image(number))


def test_only_read_truth_reads_ground_truth(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(whole.read_bytes())
    with pytest.raises(RecordingError, match="acquire demo"):
        read_truth(path)
    poses = [
        (topics.TRUTH_POSE, small.START_NS + n, pb.TruthPose(world_time_ns=n).SerializeToString())
        for n in range(100)
    ]
    append_topics(
        path, [*poses, (topics.TRUTH_BODY, small.START_NS, pb.TruthBody(mass_kg=0.05).SerializeToString())]
    )
    truth = read_truth(path)
    assert truth.body.mass_kg == 0.05
    assert [pose.world_time_ns for pose in truth.poses] == list(range(100))
    with open_recording(path) as recording, open_recording(whole) as before:
        assert recording.content_id == before.content_id
        with pytest.raises(RecordingError, match="analyze score"):
            next(recording.messages("/truth/pose"))
    remove_topics(path, tmp_path / "b.mcap", "/truth/")
    with open_recording(tmp_path / "b.mcap") as recording, open_recording(whole) as before:
        assert recording.content_id == before.content_id
        assert [t.name for t in recording.topics()] == [t.name for t in before.topics()]
    assert _everything(tmp_path / "b.mcap") == _everything(whole)


def test_bad_files_are_one_line_each(tmp_path: Path, whole: Path) -> None:
    with pytest.raises(RecordingError, match="no such recording"):
        open_recording(tmp_path / "missing.mcap")
    with pytest.raises(RecordingError, match="is a folder, not a recording: name an MCAP file"):
        open_recording(tmp_path)
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(RecordingCut, match="is empty"):
        open_recording(tmp_path / "empty.mcap")
    (tmp_path / "text.mcap").write_text("hello, I am a text file")
    with pytest.raises(RecordingError, match="is not a recording"):
        open_recording(tmp_path / "text.mcap")
    (tmp_path / "cut.mcap").write_bytes(whole.read_bytes()[:-1000])
    with pytest.raises(RecordingCut, match="acquire recover"):
        open_recording(tmp_path / "cut.mcap")
    with McapWriter(tmp_path / "bare.mcap") as writer:
        writer.add_topic(topics.LOG)
    with pytest.raises(RecordingError, match="no Percuss manifest"):
        open_recording(tmp_path / "bare.mcap")


def test_other_schema_versions(tmp_path: Path) -> None:
    data = json.loads(canonical_json(small.manifest()))
    small.write_recording(
        tmp_path / "major.mcap", manifest_json=json.dumps({**data, "schema_version": "2.0"})
    )
    with pytest.raises(RecordingVersion, match=r"schema version 2\.0"):
        open_recording(tmp_path / "major.mcap")
    newer = {
        **data,
        "schema_version": "1.99",
        "weather": "fine",
        "object": {**data["object"], "smell": "of roses"},
    }
    small.write_recording(tmp_path / "minor.mcap", manifest_json=json.dumps(newer))
    with open_recording(tmp_path / "minor.mcap") as recording:
        assert recording.manifest.object == small.manifest().object
    small.write_recording(tmp_path / "typo.mcap", manifest_json=json.dumps({**data, "weather": "fine"}))
    with pytest.raises(RecordingError, match="unknown key 'weather'"):
        open_recording(tmp_path / "typo.mcap")


def test_mapped_times_need_clock_samples(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap", clocks=False)
    with pytest.raises(RecordingError, match="no sample of that clock"):
        open_recording(tmp_path / "a.mcap")
    arrival = canonical_json(small.manifest(time_source=TimeSource.HOST_ARRIVAL))
    small.write_recording(tmp_path / "b.mcap", clocks=False, manifest_json=arrival)
    with open_recording(tmp_path / "b.mcap") as recording:
        assert len(list(recording.images())) == small.FRAMES


def test_damaged_image_is_reported(tmp_path: Path, whole: Path) -> None:
    data = bytearray(whole.read_bytes())
    at = data.find(small.image(5).tobytes())
    data[at + 100] ^= 1
    (tmp_path / "a.mcap").write_bytes(data)
    with (
        open_recording(tmp_path / "a.mcap") as recording,
        pytest.raises(RecordingError, match=r"damaged.*acquire recover"),
    ):
        list(recording.images())
    with open_partial(tmp_path / "a.mcap") as recording:
        assert recording.damaged_chunks == 1
        assert [frame.sequence for frame in recording.images()] == [n for n in range(small.FRAMES) if n != 5]


def test_cut_recording_is_read_up_to_its_end(tmp_path: Path, whole: Path) -> None:
    data = whole.read_bytes()
    (tmp_path / "a.mcap").write_bytes(data[: data.find(small.image(9).tobytes()) + 50])
    with open_partial(tmp_path / "a.mcap") as recording:
        assert recording.content_id is None
        assert [frame.sequence for frame in recording.images()] == list(range(9))
        np.testing.assert_array_equal(next(recording.images()).image, small.image(0))


def test_any_damage_raises_only_recording_error(tmp_path: Path, whole: Path) -> None:
    """Cut anywhere, and with bytes changed anywhere: no traceback, no hang, and recovered files are good."""
    source, rng = whole.read_bytes(), random.Random(7)
    path = tmp_path / "a.mcap"
    outcomes = {"read": 0, "refused": 0, "recovered": 0}
    for turn in range(80):
        path.write_bytes(_damaged(source, rng, turn))
        for read in (open_recording, open_partial):
            problem = _problem(lambda read=read: _touch(read(path)))
            outcomes["refused" if problem else "read"] += 1
        _problem(lambda: _follow(path))
        outcomes["recovered"] += _recovers(path, tmp_path / f"r{turn}.mcap")
    assert outcomes["recovered"] > 53
    assert min(outcomes.values()) > 20


def _damaged(source: bytes, rng: random.Random, turn: int) -> bytes:
    data = bytearray(source)
    if turn % 3 == 0:
        del data[rng.randrange(len(data)) :]
        return bytes(data)
    # Most bytes are images; two thirds of the changes hit the structure: the head and the summary.
    region = rng.choice([range(len(data)), range(6000), range(len(data) - 6000, len(data))])
    for _ in range(rng.choice([1, 1, 8])):
        data[rng.choice(region)] = rng.randrange(256)
    return bytes(data)


def _problem(read: Callable[[], object]) -> str:
    """The one-line error of `read`, "" if there was none."""
    try:
        read()
    except (RecordingError, RecorderError) as error:
        text = str(error)
    else:
        text = ""
    assert "\n" not in text
    return text


def _touch(opened: Recording) -> None:
    with opened as recording:
        for topic in recording.topics():
            for _ in recording.messages(topic.name):
                pass
        for frame in recording.images():
            assert frame.image.shape == (small.HEIGHT, small.WIDTH)
        assert len(recording.strikes) <= 1


def _follow(path: Path) -> None:
    with FollowedRecording(path) as followed:
        followed.poll()


def _recovers(path: Path, out: Path) -> bool:
    if _problem(lambda: recover(path, out)):
        assert not out.exists()
        return False
    problem = _problem(lambda: _touch(open_recording(out)))
    # A manifest has no checksum of its own once the seal is gone; clock samples may be among what was lost.
    assert not problem or any(word in problem for word in ("manifest", "clock", "attachment", "version"))
    return True


def test_a_growing_recording_is_followed_to_its_end(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with FollowedRecording(path.with_name("a.mcap.part")) as followed:
        assert followed.poll() == []
        writer = McapWriter(path)
        assert followed.poll() == []
        small.write_head(writer)
        assert followed.poll() == []
        assert followed.manifest == small.manifest()
        assert followed.shape_bytes == b"solid"
        images = writer.add_topic(topics.raw_image("main"))
        writer.flush()
        followed.poll()
        small.write_body(writer)
        writer.flush()
        found = followed.poll()
        frames = [followed.image(message) for message in found if message.topic == images.topic.name]
        assert [frame.sequence for frame in frames] == list(range(small.FRAMES))
        np.testing.assert_array_equal(frames[7].image, small.image(7))
        assert sum(message.topic == "/striker/sample" for message in found) == small.SAMPLES
        log = writer.add_topic(topics.LOG)
        writer.write(log, small.frame_time(99), b"\x22\x04last")
        assert not followed.finished
        writer.finish()
        assert [message.topic for message in followed.poll()] == ["/log"]
        assert followed.finished
        assert followed.poll() == []
    # One that comes late finds the finished file under its final name.
    with FollowedRecording(path.with_name("a.mcap.part")) as late:
        assert sum(message.topic == images.topic.name for message in late.poll()) == small.FRAMES
        assert late.finished


def test_unfinished_record_is_not_followed(tmp_path: Path, whole: Path) -> None:
    data, path = whole.read_bytes(), tmp_path / "a.mcap.part"
    seen: list[int] = []
    path.write_bytes(b"")
    with FollowedRecording(path) as followed:
        for end in [*range(0, len(data), 997), len(data)]:
            with path.open("ab") as file:
                file.write(data[file.tell() : end])
            for message in followed.poll():
                if message.topic == "/camera/main/image":
                    np.testing.assert_array_equal(
                        followed.image(message).image, small.image(message.sequence)
                    )
                    seen.append(message.sequence)
        assert followed.finished
    assert seen == list(range(small.FRAMES))
