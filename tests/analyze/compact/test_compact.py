"""Compacted recordings: the same pixels in half the bytes, and always one whole file."""

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import mcap.writer
import numpy as np
import pytest

from analyze.compact import codings
from analyze.compact.codings import Codings
from analyze.compact.compact import Compacted, CompactOptions, compact
from analyze.compact.copy_file import stored_messages
from analyze.compact.images import Coding
from analyze.compact.moving_region import moving_region, noise_sd, whole_squares
from analyze.compact.near_lossless import MAX_CHANGE_SD, within_noise
from analyze.compact.part_file import locked_part, part_path
from analyze.compact.prove import _is_same
from analyze.compact.strikes import compare_motions, judged_motions
from analyze.errors import CompactError, RecordingError
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.progress import Progress, no_progress
from analyze.reading.indexed_file import open_finished
from analyze.reading.recording import open_recording
from analyze.reading.verify import refuse_changed_content
from schemas.compaction import COMPACTED_NAME, Compaction
from schemas.session_manifest import SEAL_NAME
from tests.filmed_recording import filmed_recording
from tests.quick_archive import body_of, quick_session

KILLS = int(os.environ.get("PERCUSS_KILLS", "4"))
"""kills in a test that kills; 50 for the figure in the benchmarks"""


@pytest.fixture(scope="module")
def raw(tmp_path_factory) -> Path:
    """A session of two strikes with raw images."""
    path = tmp_path_factory.mktemp("raw") / "session.mcap"
    quick_session(path, body_of(1), 1, 2, raw=True)
    return path


@pytest.fixture
def session(raw, tmp_path) -> Path:
    path = tmp_path / raw.name
    path.write_bytes(raw.read_bytes())
    return path


def shrink(path: Path, *, progress: Progress = no_progress, **options: bool) -> list[Compacted]:
    return list(compact(path, CompactOptions(**options), progress))


def pixels(path: Path) -> list[tuple[int, int, bytes]]:
    with open_recording(path) as recording:
        return [(each.time_ns, each.sequence, each.image.tobytes()) for each in recording.images()]


def is_compact(path: Path) -> bool:
    refuse_changed_content(path)
    with closing(open_finished(path)) as file:
        return COMPACTED_NAME in file.metadata


def test_nothing_is_lost(raw, session):
    [done] = shrink(session)
    assert done.bytes_compact == session.stat().st_size < 0.5 * raw.stat().st_size
    assert pixels(session) == pixels(raw)
    assert is_compact(session)
    with closing(open_finished(raw)) as before, closing(open_finished(session)) as after:
        assert before.attachments == after.attachments
        own = {COMPACTED_NAME, SEAL_NAME}
        assert before.metadata == {
            name: entries
            for name, entries in after.metadata.items()
            if name not in own or (name in before.metadata and name != SEAL_NAME)
        } | {SEAL_NAME: before.metadata[SEAL_NAME]}
        others = [
            [(topic, *message[1:4], bytes(message.data)) for topic, message in stored_messages(file.data)
             if not topic.endswith("/image")]
            for file in (before, after)
        ]  # fmt: skip
        assert others[0] == others[1]
        said = Compaction.model_validate_json(after.metadata[COMPACTED_NAME]["json"])
        assert said.exact
        assert said.source_bytes == raw.stat().st_size
        assert said.source_content_id == before.metadata[SEAL_NAME]["content_id"]
    one, other = (read_evidence(read_head(path)).motions for path in (raw, session))
    for before, after in zip(one, other, strict=True):
        assert before.fit.phi == after.fit.phi
        assert before.fit.k == after.fit.k


def test_what_was_done_is_shown(session):
    shrink(session)
    done = subprocess.run(
        [sys.executable, "-m", "analyze", "inspect", session], capture_output=True, text=True, check=True
    )
    assert "compacted by percuss" in done.stdout
    assert "no pixel changed" in done.stdout


def test_a_second_run_changes_nothing(session):
    shrink(session)
    content = session.read_bytes()
    [done] = shrink(session)
    assert done.compaction is None
    assert session.read_bytes() == content


@pytest.mark.timeout(1200)
@pytest.mark.parametrize(
    ("options", "longest_s"),
    [({}, 1.2), pytest.param({"near_lossless": True, "crop": True}, 12.0, marks=pytest.mark.slow)],
    ids=["exact", "lossy"],
)
def test_whenever_it_is_killed_one_of_the_two_is_whole(raw, tmp_path, options, longest_s):
    original = raw.read_bytes()
    chance, outcomes = random.Random(1), []
    path = tmp_path / raw.name
    code = (
        "import sys; from pathlib import Path; from analyze.compact.compact import *;"
        "from analyze.progress import no_progress; print('begun', flush=True);"
        f"list(compact(Path(sys.argv[1]), CompactOptions(**{options}), no_progress))"
    )
    for _ in range(KILLS):
        path.write_bytes(original)
        with subprocess.Popen([sys.executable, "-c", code, path], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(chance.uniform(0.0, longest_s))
            process.send_signal(signal.SIGKILL)
        outcomes.append(is_compact(path))
        assert outcomes[-1] or path.read_bytes() == original
        left = set(tmp_path.iterdir()) - {path}
        assert left <= {part_path(path)}
    path.write_bytes(original)
    shrink(path, **options)
    assert list(tmp_path.iterdir()) == [path]
    assert options or pixels(path) == pixels(raw)


def test_a_damaged_recording_stays_as_it_is(session):
    content = bytearray(session.read_bytes())
    content[len(content) // 2] ^= 1
    session.write_bytes(content)
    with pytest.raises(RecordingError, match="damaged"):
        shrink(session)
    assert session.read_bytes() == content
    assert list(session.parent.iterdir()) == [session]


def test_a_full_disk_leaves_the_recording(session):
    content = session.read_bytes()
    command = [sys.executable, "-m", "analyze", "compact", str(session), "--json"]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20)),
    )
    assert done.returncode == 1
    assert "cannot be compacted: File too large: it stays as it is" in done.stderr
    assert json.loads(done.stdout)["files"] == []
    assert session.read_bytes() == content
    assert list(session.parent.iterdir()) == [session]


def test_what_is_no_recording_stays(tmp_path):
    """Its messages may stand where no recording has any."""
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file, use_chunking=False)
        writer.start()
        schema = writer.register_schema("foxglove.RawImage", "protobuf", b"")
        channel = writer.register_channel("/camera/main/image", "protobuf", schema)
        writer.add_message(channel, 1, b"", 1)
        writer.finish()
    content = path.read_bytes()
    with pytest.raises(RecordingError):
        shrink(path)
    assert path.read_bytes() == content


def test_a_copy_that_was_exchanged_is_not_taken(session):
    content = session.read_bytes()

    def exchange(text: str, _done: int, _total: int) -> None:
        if text.startswith("comparing"):
            part_path(session).unlink(missing_ok=True)
            part_path(session).write_bytes(b"rest")

    with pytest.raises(CompactError, match="was removed meanwhile"):
        shrink(session, progress=exchange)
    assert session.read_bytes() == content


def test_other_names_and_permissions_are_kept(session, tmp_path):
    session.chmod(0o640)
    link = tmp_path / "link.mcap"
    link.symlink_to(session)
    shrink(link)
    assert link.is_symlink()
    assert is_compact(session)
    assert session.stat().st_mode & 0o777 == 0o640


def test_a_second_name_of_the_file_is_refused(session, tmp_path):
    os.link(session, tmp_path / "other.mcap")
    with pytest.raises(CompactError, match="has 2 names"):
        shrink(session)


def test_a_proof_needs_every_message(session):
    with closing(open_finished(session)) as file:
        messages = list(stored_messages(file.data))
        [one, *_] = [each for each in messages if each[0] == "/session/strike"]
        other = one[0], one[1]._replace(data=memoryview(bytes(len(one[1].data))))
        image = next(each for each in messages if each[0].endswith("/image"))
        lossy = Codings({image[0]: [0]}, {image[0]: [Coding(noise_sd=2.0)]})
        assert not _is_same(file, one, other, lossy)
        assert not _is_same(file, image, other, lossy)


def test_two_at_once_are_refused(session):
    with locked_part(session), pytest.raises(CompactError, match="another process is compacting it"):
        shrink(session)


def test_a_recording_that_changes_meanwhile_is_not_replaced(session):
    content = session.read_bytes() + b""

    def edit(text: str, _done: int, _total: int) -> None:
        if text.startswith("comparing"):
            other = session.with_name("other")
            other.write_bytes(content)
            other.replace(session)

    with pytest.raises(CompactError, match="was changed meanwhile"):
        shrink(session, progress=edit)
    assert session.read_bytes() == content
    assert list(session.parent.iterdir()) == [session]


def test_what_the_noise_covers_may_be_lost(tmp_path):
    path = tmp_path / "carton.mcap"
    filmed_recording(path, "carton", 1, 1)
    size = path.stat().st_size
    [done] = shrink(path, near_lossless=True, crop=True)
    assert done.bytes_compact < 0.1 * size
    assert done.compaction is not None
    assert not done.compaction.exact
    [strike] = done.compaction.strikes
    assert abs(np.degrees(strike.phi_rad)) < 1e-4
    assert abs(strike.k_relative) < 1e-5
    assert abs(strike.phi_sd_relative) < 1e-3
    assert abs(strike.k_sd_relative) < 1e-3
    [loss] = read_head(path).losses
    assert loss == (
        "averaged within the noise where they show no structure, kept where something moves"
        " (1 strike compared: phi within 0.0000 deg, k within 0.000 %)"
    )
    assert is_compact(path)


def test_a_lossless_copy_may_be_made_smaller_later(session, raw):
    shrink(session)
    size = session.stat().st_size
    [done] = shrink(session, near_lossless=True)
    assert done.bytes_compact < size
    assert done.compaction is not None
    assert done.compaction.source_bytes == raw.stat().st_size
    [again] = shrink(session)
    assert again.compaction is None


def test_loss_upon_loss_is_refused(tmp_path):
    path = tmp_path / "carton.mcap"
    filmed_recording(path, "carton", 1, 1)
    shrink(path, near_lossless=True)
    content = path.read_bytes()
    with pytest.raises(CompactError, match="was compacted with loss before"):
        shrink(path, crop=True)
    assert path.read_bytes() == content


def test_noise_is_measured_beside_what_moves():
    rng = np.random.default_rng(1)
    images = [np.rint(rng.normal(100, 2.3, (200, 300))).astype(np.uint8) for _ in range(8)]
    for number, image in enumerate(images):
        image[50:80, 20 * number : 20 * number + 30] = 240
    assert noise_sd(images) == pytest.approx(2.3, rel=0.1)


def test_the_region_holds_the_object_while_it_rests_and_moves():
    """An arm moves beside it while it rests."""
    rng = np.random.default_rng(2)
    images, boxes = [], []
    for number in range(96):
        left = 40 + 6 * min(max(number - 40, 0), 24)
        image = np.rint(rng.normal(100, 2.0, (240, 320))).astype(np.uint8)
        image[100:160, left : left + 40] = 180
        image[max(80 - 4 * number, 0) : max(90 - 4 * number, 0), 60:64] = 20
        images.append(image)
        boxes.append((slice(100, 160), slice(left, left + 40)))
    squares = moving_region(iter(images), 2.0)
    assert squares is not None
    region = whole_squares(squares, images[0].shape)
    assert all(region[box].all() for box in boxes)
    assert np.mean(region) < 0.6
    assert moving_region(images[64:], 2.0) is None


def test_structure_is_exact_and_noise_is_averaged():
    rng = np.random.default_rng(3)
    clean = np.full((203, 301), 100.0)
    clean[60:120, 80:140] = 40
    clean[60:120, 200:240] = 108  # pale print, in noise of a third of it
    image = np.rint(rng.normal(clean, 2.5)).astype(np.uint8)
    few, all_of_it = (within_noise(image, 2.5, None, share) for share in (0.9, 1.0))
    for found in (few, all_of_it):
        assert np.max(np.abs(found.astype(int) - image)) <= MAX_CHANGE_SD * 2.5
        assert np.array_equal(found[58:122, 76:84], image[58:122, 76:84])
        assert np.mean(found != image) > 0.6
        assert np.std(found[150:, :60]) < 0.8
    assert np.mean(all_of_it[80:100, 198:202] == image[80:100, 198:202]) > 0.9
    assert np.mean(few[80:100, 198:202] == image[80:100, 198:202]) < 0.5


def test_a_strike_of_a_continuous_recording_is_not_cut():
    """Its region is that of all its images."""
    times = np.arange(0, 30_000_000_000, 10_000_000)
    windows = codings._windows(times, [(4_000_000_000, 13_000_000_000)])
    starts = [int(times[window.start]) for window in windows]
    assert not any(4_000_000_000 < start <= 13_000_000_000 for start in starts)
    assert len(starts) > 3
    assert [number for window in windows for number in window] == list(range(len(times)))


def test_another_coding_is_tried_before_a_loss_is_refused(tmp_path, monkeypatch):
    path = tmp_path / "carton.mcap"
    filmed_recording(path, "carton", 1, 1)
    content = path.read_bytes()
    monkeypatch.setattr("analyze.compact.compact.is_as_aimed", lambda _: False)
    [done] = shrink(path, near_lossless=True, crop=True)
    assert done.compaction is not None
    assert done.compaction.information_share == 1.0
    path.write_bytes(content)
    monkeypatch.setattr("analyze.compact.strikes.MAX_CHANGE_SDS", -1.0)
    with pytest.raises(CompactError, match=r"strike s\d\.1 would change by 0\.0 standard deviations"):
        shrink(path, near_lossless=True, crop=True)
    assert path.read_bytes() == content


def test_other_standard_deviations_are_refused(raw):
    one = judged_motions(raw, no_progress)
    other = {
        name: replace(each, fit=replace(each.fit, covariance=1.3 * each.fit.covariance))
        for name, each in one.items()
    }
    with pytest.raises(CompactError, match=r"standard deviations of strike \S+ would change by \+14 %"):
        compare_motions(one, other, raw)


def test_times_and_extended_attributes_are_kept(session):
    try:
        os.setxattr(session, "user.percuss.note", b"shelf 3")
    except OSError:
        pytest.skip("the file system has no extended attributes")
    os.utime(session, ns=(1_000_000_000, 2_000_000_000))
    shrink(session)
    assert is_compact(session)
    assert os.getxattr(session, "user.percuss.note") == b"shelf 3"
    assert session.stat().st_mtime_ns == 2_000_000_000


def test_the_recorders_reserve_stays_free(session):
    content = session.read_bytes()
    command = [sys.executable, "-m", "analyze", "compact", session, "--disk-reserve", str(1 << 60)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "MB are free on its disk, a copy may need" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert session.read_bytes() == content
