"""A scrub finds every changed byte, and goes on where it stopped."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

from analyze.catalogue import scrub as scrub_module
from tests.analyze.catalogue.steps import rows_of, run, scrubbed


def test_a_scrub_finds_a_changed_byte_and_names_a_whole_copy(archive, output) -> None:
    first = scrubbed(output)
    assert {Path(row["url"]).name for row in first.problems} == {"broken-wrong_byte-0.mcap"}
    path = archive / "session-0.mcap"
    _flip(path, path.stat().st_size // 3)
    answer = run("scrub", "--out", output)
    assert answer.exit_code == 3
    line = next(line for line in answer.stderr.splitlines() if "session-0.mcap: " in line)
    assert "altered: its bytes changed, their size and time did not" in line
    assert "(a whole one is " in line
    assert "copy.mcap" in line
    # It is found again until it is restored.
    assert rows_of(output)["session-0.mcap"]["scrub"] == "altered"
    shutil.copy2(archive / "lab" / "copy.mcap", path)
    scrubbed(output)
    assert rows_of(output)["session-0.mcap"]["scrub"] == "whole"


def test_a_scrub_finds_damage_outside_of_the_messages(archive, output) -> None:
    scrubbed(output)
    path = archive / "session-2.mcap"
    _flip(path, -20)  # in the footer
    scrubbed(output)
    assert rows_of(output)["session-2.mcap"]["scrub"] == "altered"


def test_a_scrub_goes_on_where_it_stopped(output) -> None:
    moments = iter(range(100))
    first = scrubbed(output, seconds=3.5, clock=lambda: next(moments))
    assert len(first.rows) == 3
    assert first.left == 7

    def interrupt(_text: str, done: int, _total: int) -> None:
        if done:
            raise KeyboardInterrupt

    second = scrubbed(output, older_than_days=1, progress=interrupt)
    assert second.interrupted
    rest = scrubbed(output, older_than_days=1)
    read = [row["url"] for each in (first, second, rest) for row in each.rows]
    assert sorted(read) == sorted(row["url"] for row in rows_of(output).values())
    assert not scrubbed(output, older_than_days=1).rows


def test_a_missing_recording_fails_its_scrub(archive, output) -> None:
    (archive / "session-2.mcap").unlink()
    report = scrubbed(output)
    assert "is no longer there: restore it from a copy" in next(
        row["scrub_reason"] for row in report.problems if "session-2" in row["url"]
    )


def _flip(path: Path, at: int) -> None:
    """Change a bit of one byte; size and time of change stay."""
    about = path.stat()
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))


def test_a_recording_damaged_before_its_first_scrub_is_whole_when_restored(archive, output) -> None:
    path = archive / "session-2.mcap"
    whole = path.read_bytes()
    about = path.stat()
    _flip(path, len(whole) // 3)
    scrubbed(output)
    assert rows_of(output)["session-2.mcap"]["scrub"] == "damaged"
    path.write_bytes(whole)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
    scrubbed(output)
    assert rows_of(output)["session-2.mcap"]["scrub"] == "whole"


def test_a_file_that_is_written_meanwhile_is_not_damaged(archive, output, monkeypatch) -> None:
    before = rows_of(output)
    verify = scrub_module.refuse_changed_content

    def write(path: Path) -> None:
        _flip(path, -20)
        path.touch()
        verify(path)

    monkeypatch.setattr(scrub_module, "refuse_changed_content", write)
    report = scrubbed(output)
    texts = [row["scrub_reason"] for row in report.problems if row["scrub"] == "unread"]
    assert len(texts) == 6
    assert "changed while it was read: scrub it again" in texts[0]
    assert rows_of(output)["session-2.mcap"] == before["session-2.mcap"]


def test_a_disk_that_cannot_read_is_damage_and_no_permission_is_not(archive, output, monkeypatch) -> None:
    def fail(url: str) -> str:
        raise OSError(errno.EIO if "session-1" in url else errno.EACCES, "no", url)

    monkeypatch.setattr(scrub_module, "file_sha256", fail)
    outcomes = {Path(row["url"]).name: row["scrub"] for row in scrubbed(output).rows}
    assert outcomes["session-1.mcap"] == "damaged"
    assert outcomes["session-2.mcap"] == "unread"


def test_recordings_of_any_age_are_left_out_by_days(output) -> None:
    scrubbed(output)
    answer = run("scrub", "--out", output, "--older-than", "1e9")
    assert answer.exit_code == 0
    assert answer.stdout.startswith("0 recordings read")
