"""`analyze watch` on a series of files, also if it starts late."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from acquire.recorder.image import RawImageEncoder
from analyze.reading.followed_recording import FollowedRecording
from analyze.reading.followed_series import FollowedSeries, next_part_path
from analyze.reading.indexed_file import RecordedMessage
from analyze.verbs.watch.follow import watch_recording
from schemas import topics
from schemas.document import canonical_json
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from tests import small_recording
from tests.analyze.verbs.test_watch import PLAN
from tests.mcap_writer import McapWriter

FRAME_NS = 8_333_333


@pytest.mark.parametrize(
    ("path", "after"),
    [
        ("a.mcap.part", "a-0002.mcap.part"),
        ("a.mcap", "a-0002.mcap.part"),
        ("a-0002.mcap.part", "a-0003.mcap.part"),
        ("a-0999.mcap", "a-1000.mcap.part"),
        ("cup-12.mcap.part", "cup-12-0002.mcap.part"),
    ],
)
def test_name_of_the_next_file(path: str, after: str) -> None:
    assert next_part_path(Path("d") / path) == Path("d") / after


class Row:
    """Writer of a series of files with an image every 1/120 s, numbered continuously."""

    def __init__(self, path: Path, plan: bytes = small_recording.PLAN) -> None:
        self.path = path
        self.plan = plan
        self.part = self.number = 0

    def begin(self, **changes: object) -> McapWriter:
        """Begin the next file with its head; the previous one stays open."""
        self.part += 1
        writer = McapWriter(
            self.path if self.part == 1 else self.path.with_name(f"{self.path.stem}-{self.part:04d}.mcap")
        )
        head = small_recording.manifest(**({"part": self.part, "hashes": {}} | changes))
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(head)))
        writer.attachment("plan.json", "application/json", self.plan)
        writer.flush()
        return writer

    def images(self, writer: McapWriter, count: int) -> None:
        channel = writer.add_topic(topics.raw_image("main"))
        image = np.full_like(
            small_recording.image(0), 120
        )  # in noise more squares are looked for than in a whole session
        encoder = RawImageEncoder("camera", image.shape[1], image.shape[0])
        for _ in range(count):
            time_ns = small_recording.START_NS + self.number * FRAME_NS
            writer.write(channel, time_ns, encoder.encode(time_ns, image), sequence=self.number)
            self.number += 1
        writer.flush()


def test_series_continues_in_the_next_file_without_losing_a_message(tmp_path: Path) -> None:
    row = Row(tmp_path / "a.mcap")
    first = row.begin()
    series = FollowedSeries(first.part_path)
    seen: list[int] = []

    def look() -> None:
        seen.extend(message.sequence for message in series.poll())

    row.images(first, 3)
    look()
    second = row.begin()
    row.images(first, 2)  # the next file is there before the last has its end
    look()
    row.images(second, 4)
    look()
    assert seen == list(range(5))
    first.finish()
    look()
    assert seen == list(range(9))
    third = row.begin()
    row.images(third, 1)
    second.finish()
    third.finish()  # both ended between two looks
    look()
    assert seen == list(range(10))
    assert series.image(
        RecordedMessage("/camera/main/image", 0, 0, _data(tmp_path / "a-0003.mcap"))
    ).image.shape == (64, 96)
    series.close()


def _data(path: Path) -> bytes:
    with FollowedRecording(path) as file:
        return bytes(file.poll()[0].data)


@pytest.mark.parametrize("changes", [{"recording_id": "another"}, {"part": 3}])
def test_older_file_of_the_same_name_does_not_belong_to_the_series(
    tmp_path: Path, changes: dict[str, object]
) -> None:
    row = Row(tmp_path / "a.mcap")
    first = row.begin()
    row.images(first, 1)
    other = row.begin(**changes)
    row.images(other, 1)
    other.finish()
    first.finish()
    (tmp_path / "a-0003.mcap").write_bytes(b"none")
    series = FollowedSeries(tmp_path / "a.mcap.part")
    assert [message.sequence for message in series.poll()] == [0]
    assert series.path == tmp_path / "a.mcap.part"
    series.close()


def test_late_watcher_evaluates_only_the_newest_images(tmp_path: Path) -> None:
    """Of four seconds recorded before the start, only images of the last second are evaluated."""
    row = Row(tmp_path / "a.mcap", canonical_json(PLAN).encode())
    writer = row.begin()
    row.images(writer, 480)
    out = io.StringIO()
    watch_recording(writer.part_path, io.StringIO(""), out)
    times = [json.loads(line)["time_ns"] for line in out.getvalue().splitlines()]
    newest = small_recording.START_NS + 479 * FRAME_NS
    assert 10 <= len(times) <= 13
    assert newest - times[0] <= 1_000_000_000
    assert newest - times[-1] < 83_000_000
    writer.abort()
