"""A scrub finds every changed byte, and goes on where it stopped."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

from tests.analyze.catalogue.steps import rows_of, run, scrubbed


def test_a_scrub_finds_a_changed_byte_and_names_a_whole_copy(archive, output) -> None:
    first = scrubbed(output)
    assert {Path(row["url"]).name for row in first.problems} == {"broken-wrong_byte-0.mcap"}
    path = archive / "session-0.mcap"
    about = path.stat()
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
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
    """A damaged attachment is not part of the content hash."""
    scrubbed(output)
    path = archive / "session-2.mcap"
    about = path.stat()
    data = bytearray(path.read_bytes())
    data[-20] ^= 1  # in the footer
    path.write_bytes(data)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))
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
