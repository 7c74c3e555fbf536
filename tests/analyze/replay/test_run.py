"""Replay of recordings to a file: whole, cut, damaged, without an answer, or still being written."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest
import rerun as rr
from click.testing import CliRunner

from analyze.cli import main
from analyze.pipeline.read_evidence import read_strike
from analyze.reading.recording import Recording, open_recording
from analyze.reading.recording_file import find_recording
from analyze.replay.pictures import ImageChoice, send_pictures
from analyze.replay.run import replay_recording
from analyze.replay.sender import ReplayOptions
from analyze.replay.target import ToViewer, to_file
from analyze.replay.timelines import Timelines
from analyze.replay.viewer import ReplayError, native_viewer
from schemas import topics
from schemas.document import canonical_json
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from tests.analyze.replay.rrd_contents import RrdContents
from tests.mcap_writer import McapWriter
from tests.places import FIRST_SAMPLE

TOPICS = [
    topics.compressed_image("main"),
    topics.frame_meta("main"),
    topics.STRIKER_EVENT,
    topics.CLOCK_SAMPLE,
    topics.SESSION_STATE,
    topics.SESSION_STRIKE,
    topics.LOG,
]
STRIKES = ["s1.1", "s2.2", "s3.1", "s4.1"]


def _without_contacts(strikes):
    """The getter `strikes` of a recording, with the contacts' times taken out of the records."""

    def cleared(recording):
        found = []
        for record in strikes.__get__(recording):
            copy = type(record).FromString(record.SerializeToString())
            copy.contact_time_ns = 0
            found.append(copy)
        return found

    return cleared


def strike(name: str, part: str) -> str:
    return f"/strike/{name}/{part}"


def replay(path: Path, output: Path, options: ReplayOptions | None = None):
    steps = []
    with to_file(output) as target:
        done = replay_recording(
            find_recording(path), target, options or ReplayOptions(), lambda *step: steps.append(step)
        )
    return done, RrdContents(output), steps


@pytest.fixture(scope="module")
def read():
    """Readings of the sample's strikes by id, filled when they are read first."""
    return {}


@pytest.fixture(scope="module")
def sample(read, tmp_path_factory):
    def remembering(source, struck, markers, record):
        read[record.strike_id] = read_strike(source, struck, markers, record)
        return read[record.strike_id]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("analyze.pipeline.cached.read_strike", remembering)
        return replay(FIRST_SAMPLE, tmp_path_factory.mktemp("replay") / "sample.rrd")


@pytest.fixture
def read_before(sample, read, monkeypatch):
    """Reuse the sample's readings: images are read from the file, not decoded a second time, nor tracked."""

    def known(source, struck, markers, record):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("analyze.reading.recording.decode_image", lambda *_: np.zeros((1, 1), np.uint8))
            assert list(source.images(start_ns=record.window_start_ns, end_ns=record.window_end_ns))
        return read[record.strike_id]

    monkeypatch.setattr("analyze.pipeline.cached.read_strike", known)


def test_every_strike_has_images_curves_phases_and_pose(sample):
    done, shown, _ = sample
    assert not done.problems
    assert 0.02 < done.moment_s < 0.6
    for name in STRIKES:
        assert 40 <= shown.rows(strike(name, "camera/image")) <= 46  # 0.74 s at 60 Hz
        assert (
            5 <= shown.rows(strike(name, "camera/image_before")) <= 12
        )  # which is all that is drawn before the contact
        assert shown.rows(strike(name, "camera/tags")) == 89
        assert shown.rows(strike(name, "camera/ghost")) > 20
        for curve in ("theta", "omega", "alpha"):
            assert shown.rows(strike(name, f"{curve}/measured")) == 89
            assert 20 < shown.rows(strike(name, f"{curve}/fitted")) < 89
        assert shown.rows(strike(name, "phases")) >= 4
        assert shown.rows(strike(name, "theta/contact")) == 1
        assert shown.rows(strike(name, "theta/passage")) == 1
        assert "good" in shown.text(strike(name, "text"))
        assert shown.chunks[strike(name, "camera/pivot")]


def test_answer_and_session_have_pages(sample):
    _, shown, _ = sample
    assert "## Centre of mass [mm]" in shown.text("/summary")
    assert "4 of 4 strikes used" in shown.text("/summary")
    for entity in ("/result/centre_of_mass", "/result/voxels", "/result/planes/s1.1", "/result/shape"):
        assert shown.chunks[entity], entity
    assert "356 frames, **0 lost**" in shown.text("/session/text")
    assert shown.rows("/session/state") == 31
    assert shown.rows("/log/striker") == 36
    assert shown.rows("/session/lost/frames") == 2
    assert shown.rows("/session/clock/mapping") > 4


def test_first_strike_is_sent_first(sample):
    _, _, steps = sample
    assert [text for text, _, _ in steps] == [*(f"strike {name}" for name in STRIKES), "estimating"]
    assert all(done < total for _, done, total in steps)


@pytest.mark.usefixtures("read_before")
def test_contact_unknown_to_the_recording_is_the_zero_of_its_time_all_the_same(sample, tmp_path, monkeypatch):
    """Imported videos name no contact: their zero was the window's start, and a screenshot showed rest."""
    monkeypatch.setattr(Recording, "strikes", property(_without_contacts(Recording.strikes)))
    without_answer = ReplayOptions(exclude=frozenset(STRIKES[1:]))
    done, shown, _ = replay(FIRST_SAMPLE, tmp_path / "imported.rrd", without_answer)
    known_done, known, _ = sample
    assert done.moment_s == pytest.approx(known_done.moment_s, abs=0.006)
    for name in STRIKES:
        for part in ("camera/image", "camera/tags", "theta/measured"):
            now, before = (each.seconds(strike(name, part)) for each in (shown, known))
            assert len(now) == len(before)
            assert np.abs(np.array(now) - before).max() < 0.006  # a frame at 180 Hz
        assert 5 <= shown.rows(strike(name, "camera/image_before")) <= 12
        assert shown.rows(strike(name, "camera/ghost")) > 20
    assert shown.rows("/log/striker") == known.rows("/log/striker")


def test_images_are_jpeg_at_reduced_rate_by_default(tmp_path):
    found = {}
    with open_recording(FIRST_SAMPLE) as recording:
        record = recording.strikes[0]
        frames = list(
            recording.images(start_ns=record.window_start_ns, end_ns=record.window_start_ns + 200_000_000)
        )
    for choice in (ImageChoice(), ImageChoice(every_frame=True), ImageChoice(lossless=True)):
        stream = rr.RecordingStream("test")
        stream.save(tmp_path / "r.rrd")
        send_pictures(Timelines(stream, 0), "/camera", frames, record.contact_time_ns, choice)
        stream.flush()
        stream.disconnect()
        found[choice] = RrdContents(tmp_path / "r.rrd").images("/camera")
    few, every, exact = found.values()
    assert len(frames) == len(every) == 24
    assert len(few) == len(exact) == 12
    assert few[0] == every[0]
    assert few[0][:2] == b"\xff\xd8"  # JPEG
    np.testing.assert_array_equal(
        cv2.imdecode(np.frombuffer(exact[1], np.uint8), cv2.IMREAD_UNCHANGED), frames[2].image
    )


# --- damaged recordings


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The sample with its messages in a recorder's order: each strike record after the strike's images."""
    path = tmp_path_factory.mktemp("recorded") / "session.mcap"
    with open_recording(FIRST_SAMPLE) as recording, McapWriter(path) as writer:
        writer.metadata(MANIFEST_NAME, manifest_entries(canonical_json(recording.manifest)))
        for name, data in recording.attachments.items():
            writer.attachment(name, "application/octet-stream", data)
        known = {topic.name: topic for topic in TOPICS}
        channels = {name: writer.add_topic(topic) for name, topic in known.items()}
        messages = [message for name in known for message in recording.messages(name)]
        for message in sorted(messages, key=lambda each: each.log_time_ns):
            writer.write(
                channels[message.topic], message.log_time_ns, bytes(message.data), sequence=message.sequence
            )
            if message.topic == topics.SESSION_STRIKE.name:
                writer.flush()
    return path.read_bytes()


@pytest.mark.usefixtures("read_before")
def test_cut_recording_is_replayed_up_to_the_cut_with_a_message(recorded, tmp_path):
    path, output = tmp_path / "cut.mcap", tmp_path / "cut.rrd"
    path.write_bytes(recorded[: int(len(recorded) * 0.7)])
    done = CliRunner().invoke(main, ["replay", str(path), "--save", str(output)])
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"analyze: {path}: ends early: it was cut short")
    assert "acquire recover" in line
    assert "replayed as far as it can be read: 2 strikes" in line
    assert done.stdout == f"replay: {output}\n"
    shown = RrdContents(output)
    assert shown.rows(strike("s2.2", "theta/fitted")) > 20
    assert strike("s4.1", "camera/image") not in shown.chunks
    assert "No answer" in shown.text("/summary")


def test_recording_cut_before_its_first_strike_record_shows_its_images(tmp_path):
    data = FIRST_SAMPLE.read_bytes()
    path, output = tmp_path / "cut.mcap", tmp_path / "cut.rrd"
    path.write_bytes(data[: int(len(data) * 0.5)])
    done = CliRunner().invoke(main, ["replay", str(path), "--save", str(output)])
    assert done.exit_code == 1
    assert "replayed as far as it can be read: 0 strikes" in done.stderr
    assert RrdContents(output).rows("/session/camera") > 5


@pytest.mark.usefixtures("read_before")
def test_damaged_chunk_loses_only_its_images_and_is_reported(tmp_path):
    data = bytearray(FIRST_SAMPLE.read_bytes())
    with open_recording(FIRST_SAMPLE) as recording:
        record = recording.strikes[1]
        frames = list(recording.messages("/camera/main/image", record.window_start_ns, record.window_end_ns))
        middle = frames[60]
        at = data.find(bytes(middle.data[200:400]))
    data[at + 50] ^= 0xFF
    path, output = tmp_path / "damaged.mcap", tmp_path / "damaged.rrd"
    path.write_bytes(data)
    done = CliRunner().invoke(main, ["replay", str(path), "--save", str(output)])
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert "damaged" in line
    assert "replayed as far as it can be read: 4 strikes" in line
    shown = RrdContents(output)
    assert 0 < shown.rows(strike("s2.2", "camera/image")) < 45
    for name in ("s1.1", "s3.1", "s4.1"):
        assert shown.rows(strike(name, "camera/image")) >= 40
        assert shown.rows(strike(name, "theta/fitted")) > 20
    assert "damaged" in shown.text("/summary")


@pytest.mark.usefixtures("read_before")
def test_too_few_strikes_for_an_answer_are_replayed(tmp_path):
    output = tmp_path / "few.rrd"
    done = CliRunner().invoke(
        main, ["replay", str(FIRST_SAMPLE), "--exclude", "s1.1", "--exclude", "s2.2", "--save", str(output)]
    )
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert "2 good strikes of 4, 3 are needed" in line
    shown = RrdContents(output)
    assert shown.rows(strike("s1.1", "theta/fitted")) > 20
    assert "No answer" in shown.text("/summary")
    assert "3 are needed" in shown.text("/summary")


def test_unreadable_object_file_leaves_the_images(tmp_path):
    broken = tmp_path / "object.toml"
    broken.write_text("name = 3", encoding="utf-8")
    output = tmp_path / "r.rrd"
    done = CliRunner().invoke(
        main, ["replay", str(FIRST_SAMPLE), "--object", str(broken), "--save", str(output)]
    )
    assert done.exit_code == 1
    assert "object.toml" in done.stderr
    shown = RrdContents(output)
    assert shown.rows(strike("s4.1", "camera/image")) >= 40
    assert "cannot be measured" in shown.text(strike("s4.1", "text"))


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--exclude", "s9.1"], "no strike 's9.1' to exclude: its strikes are s1.1, s2.2, s3.1, s4.1"),
        (["--page", "s9.1"], "has no page 's9.1': choose one of answer, s1.1, s2.2, s3.1, s4.1, session"),
        (["--save", "/nowhere/r.rrd"], "create it first"),
    ],
)
def test_wrong_options_give_a_one_line_error(more, message, tmp_path):
    output = [] if "--save" in more else ["--save", str(tmp_path / "r.rrd")]
    done = CliRunner().invoke(main, ["replay", str(FIRST_SAMPLE), *more, *output])
    assert done.exit_code == 1
    (line,) = done.stderr.splitlines()
    assert message in line
    assert not list(tmp_path.iterdir())


def test_exclusive_destinations_are_wrong_usage():
    for more in (["--web", "--save", "r.rrd"], ["--no-browser"]):
        assert CliRunner().invoke(main, ["replay", str(FIRST_SAMPLE), *more]).exit_code == 2


# --- running sessions


@pytest.mark.usefixtures("read_before")
def test_running_session_is_followed_strike_by_strike(recorded, tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.replay.run._POLL_S", 0.02)
    monkeypatch.setattr("analyze.replay.run._NEXT_FILE_S", 0.2)
    data = recorded
    part, whole = tmp_path / "live.mcap.part", tmp_path / "live.mcap"
    part.write_bytes(data[:10_000])
    seen = []

    def write():
        with part.open("ab") as stream:
            for at in range(10_000, len(data), 500_000):
                stream.write(data[at : at + 500_000])
                stream.flush()
                time.sleep(0.02)
        part.rename(whole)

    writer = threading.Thread(target=write)
    writer.start()
    try:
        output = tmp_path / "live.rrd"
        with to_file(output) as target:
            done = replay_recording(
                find_recording(whole), target, ReplayOptions(), lambda text, *_: seen.append(text)
            )
    finally:
        writer.join()
    assert not done.problems
    progress_texts = [text for text in seen if text.startswith("strike")]
    assert progress_texts == [f"strike {name}" for name in STRIKES]
    assert seen[-1] == "estimating"
    shown = RrdContents(output)
    for name in STRIKES:
        assert shown.rows(strike(name, "camera/image")) >= 40
        assert shown.rows(strike(name, "theta/fitted")) > 20
    assert "4 of 4 strikes used" in shown.text("/summary")


def test_interrupted_session_is_reported_once_its_file_stops_growing(tmp_path, monkeypatch):
    monkeypatch.setattr("analyze.replay.run._POLL_S", 0.02)
    monkeypatch.setattr("analyze.reading.recording_file.STILL_S", 0.3)
    data = FIRST_SAMPLE.read_bytes()
    part = tmp_path / "dead.mcap.part"
    part.write_bytes(data[: len(data) // 2])
    done, shown, _ = replay(tmp_path / "dead.mcap", tmp_path / "dead.rrd")
    (line,) = done.problems
    assert "dead.mcap.part: ends early: it has not grown for" in line
    assert shown.rows("/session/camera") or shown.chunks["/summary"]


def test_missing_screen_gives_a_one_line_error_with_the_remedy(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    with native_viewer(1) as viewer:
        viewer.process.wait(20)
        with pytest.raises(ReplayError, match=r"^no screen found .*--web") as caught:
            ToViewer(viewer).check()
    assert "\n" not in str(caught.value)
