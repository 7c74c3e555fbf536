"""Report of a computer that was too busy for the virtual rig."""

from __future__ import annotations

from pathlib import Path

from acquire.virtual.pace import Pace, read_pace


def test_a_busy_computer_is_named_as_the_cause(tmp_path: Path) -> None:
    assert read_pace(tmp_path) == Pace(0.0, 0.0)
    assert read_pace(tmp_path).note() is None
    (tmp_path / "world.json").write_text('{"latest_ms": 312.0}\n')
    (tmp_path / "camera.json").write_text('{"latest_ms": 4110.7, "frames": 3}\n')
    note = read_pace(tmp_path).note()
    assert note is not None
    assert "the simulated world ran up to 0.3 s late and images came up to 4.1 s late" in note
    assert "close other programs" in note
    assert "images" not in str(Pace(0.3, 0.1).note())
    assert "lost" not in note
    (tmp_path / "camera.json").write_text('{"latest_ms": 12331.9, "unsent": 1480}\n')
    note = read_pace(tmp_path).note()
    assert (
        "; 1480 late images were never sent, because the camera was opened anew, and count as lost;"
        in str(note)
    )
    (tmp_path / "camera.json").write_text("cut sh")
    assert read_pace(tmp_path).camera_s == 0.0
