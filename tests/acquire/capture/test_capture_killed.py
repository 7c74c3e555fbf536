"""kill -9 of the capture process: no thread of it survives, and all that it wrote is recovered."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from acquire.capture.link import CaptureProcess
from acquire.errors import RecorderError
from acquire.recorder.recover.recover import recover
from tests.acquire.capture.synthetic_rig import COMMAND, RATE, manifest_of_a_box, read, rig


def sleep_watching(seconds: float) -> float:
    """Sleep, and return the longest delay of this thread [s].

    A busy computer delays the process under test in the same way.
    """
    end, held_up_s = time.monotonic() + seconds, 0.0
    while (before := time.monotonic()) < end:
        time.sleep(0.01)
        held_up_s = max(held_up_s, time.monotonic() - before - 0.01)
    return held_up_s


def recover_unless_just_begun(part: Path, out: Path) -> None:
    """Recover `part`, unless the kill came before the first whole chunk, with the manifest, was in it.

    What such a file would have held is then the last of what is lost, which the caller bounds.
    """
    try:
        assert recover(part, out).has_manifest
    except RecorderError as error:
        if not any(problem in str(error) for problem in ("nothing can be saved", "empty")):
            raise


@pytest.mark.parametrize("large", [False, True], ids=["copied", "borrowed"])
def test_a_kill_in_a_continuous_recording_costs_less_than_half_a_second(
    tmp_path: Path, environment: pytest.MonkeyPatch, large: bool
) -> None:
    """No code of the process runs after SIGKILL: what it had handed to the system is recovered."""
    capture = CaptureProcess(
        rig(large=large, mode="continuous", rotate_bytes=300_000 if large else 150_000), COMMAND
    )
    capture.start()
    process = capture._process
    assert process is not None
    try:
        manifest = manifest_of_a_box()
        capture.open_recording(tmp_path / "a.mcap", manifest, [])
        begun, held_up_s = time.monotonic(), 0.0
        while (before := time.monotonic()) < begun + 1.4:
            capture.write("/striker/sample", manifest.wall_anchor_ns + time.monotonic_ns(), b"\x18\x01")
            time.sleep(0.002)
            held_up_s = max(held_up_s, time.monotonic() - before - 0.002)
        killed_ns = manifest.wall_anchor_ns + time.monotonic_ns()
        process.kill()
        with pytest.raises(RecorderError, match="acquire recover"):
            capture.status()
    finally:
        capture.stop()
    # Two if the kill came while one file was being finished and the next had begun.
    parts = list(tmp_path.glob("*.part"))
    assert 1 <= len(parts) <= 2
    for number, part in enumerate(parts):
        recover_unless_just_begun(part, tmp_path / f"recovered-{number}.mcap")
        part.unlink()
    files = [
        read(path) for path in sorted(tmp_path.iterdir())
    ]  # a.mcap, a-0002.mcap, ... in any order, recovered-0.mcap
    assert len(files) >= 3
    for topic in ("/striker/sample", "/camera/main/image", "/camera/main/meta"):
        found = sorted(
            (message for file in files for message in file.get(topic, [])),
            key=lambda message: message.log_time,
        )
        assert [message.sequence for message in found] == list(
            range(found[0].sequence, found[0].sequence + len(found))
        )
        assert (killed_ns - found[-1].log_time) * 1e-9 < 0.5 + held_up_s


@pytest.mark.usefixtures("aravis")
@pytest.mark.parametrize("pre_trigger_s", [0.0, 0.25, 1.5])
def test_a_kill_between_windows_costs_less_than_half_a_second(
    tmp_path: Path, environment: pytest.MonkeyPatch, pre_trigger_s: float
) -> None:
    """Meta and previews do not wait for the pre-trigger time of a window, however long it is."""
    capture = CaptureProcess(rig(pre_trigger_s=pre_trigger_s, preview_hz=RATE / 2), COMMAND)
    capture.start()
    process = capture._process
    assert process is not None
    try:
        manifest = manifest_of_a_box()
        capture.open_recording(tmp_path / "a.mcap", manifest, [])
        held_up_s = sleep_watching(1.2)
        killed_ns = manifest.wall_anchor_ns + time.monotonic_ns()
        process.kill()
    finally:
        capture.stop()
    assert recover(tmp_path / "a.mcap.part", tmp_path / "b.mcap").has_manifest
    found = read(tmp_path / "b.mcap")
    sequences = [message.sequence for message in found["/camera/main/meta"]]
    assert sequences == list(range(sequences[0], sequences[-1] + 1))
    for topic in ("/camera/main/image", "/camera/main/meta"):
        assert (killed_ns - found[topic][-1].log_time) * 1e-9 < 0.5 + held_up_s
