"""Exit codes and one-line messages of `acquire`, for verbs that need no rig."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.camera.base import CameraInfo
from acquire.cli import _print_session, main
from acquire.session.session_report import SessionReport
from acquire.virtual import devices


@pytest.fixture
def cameras(monkeypatch: pytest.MonkeyPatch) -> list[CameraInfo]:
    """List, empty at first, of the cameras that `acquire discover` is made to find."""
    pytest.importorskip("gi")
    found: list[CameraInfo] = []
    monkeypatch.setattr("acquire.camera.aravis_library.discover", lambda: found)
    monkeypatch.setattr("acquire.camera.v4l2_discovery.list_v4l2_cameras", list)
    return found


def test_discover_fails_with_a_remedy_if_no_camera_answers(cameras: list[CameraInfo]) -> None:
    for arguments, stdout in (["discover"], ""), (["discover", "--json"], "[]\n"):
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 1
        assert result.stdout == stdout
        (line,) = result.stderr.splitlines()
        assert line.startswith("acquire: no camera answers: check power and cable")


def test_discover_lists_what_answers(cameras: list[CameraInfo]) -> None:
    cameras.append(CameraInfo("Allied", "Guppy", "7", "192.168.10.2"))
    result = CliRunner().invoke(main, ["discover"])
    assert (result.exit_code, result.stdout) == (0, "192.168.10.2     Allied Guppy (7)\n")
    (camera,) = json.loads(CliRunner().invoke(main, ["discover", "--json"]).stdout)
    assert (camera["model"], camera["kind"]) == ("Guppy", "gige")


def test_discover_names_the_kind_of_other_cameras(cameras: list[CameraInfo]) -> None:
    cameras.append(CameraInfo("uvcvideo", "Webcam", "usb-1", "/dev/video0", kind="v4l2"))
    result = CliRunner().invoke(main, ["discover"])
    assert result.stdout == '/dev/video0      uvcvideo Webcam (usb-1)  kind = "v4l2"\n'


@pytest.fixture
def hung(tmp_path: Path) -> Iterator[Path]:
    """Rig file whose daemon accepts connections and never answers."""
    path = tmp_path / "d.sock"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen(4)
        rig = tmp_path / "rig.toml"
        rig.write_text(
            f"""[camera]
address = "127.0.0.1"
[camera.calibration]
width = 64
height = 48
K = [[100, 0, 32], [0, 100, 24], [0, 0, 1]]
T_world_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
[daemon]
socket = "{path}"
""",
            encoding="utf-8",
        )
        yield rig


def test_stop_without_an_answer_warns_to_cut_the_power(hung: Path) -> None:
    result = CliRunner().invoke(main, ["stop", "--rig", str(hung)])
    assert result.exit_code == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(
        "acquire: NOT STOPPED: if the arm moves, cut the motor's power: the daemon (process "
    )


def test_demo_removes_folders_of_killed_demos(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    left, mine = tmp_path / f"percuss-demo-{dead.pid}-abc", tmp_path / f"percuss-demo-{os.getpid()}-abc"
    others = [
        tmp_path / "percuss-demo-x-abc",
        tmp_path / "percuss-1000",
        tmp_path / f"percuss-demo-{dead.pid}-link",
    ]
    for folder in (left, mine, *others[:2]):
        (folder / "run").mkdir(parents=True)
    others[2].symlink_to(mine)
    devices.remove_leftovers(tmp_path, "percuss-demo-")
    assert set(tmp_path.iterdir()) == {mine, *others}


def test_a_session_without_a_strike_is_no_success(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "r.mcap"
    with pytest.raises(SystemExit) as caught:
        _print_session(SessionReport(path, (path,), 0, 800, 0, aborted=False, text=""), as_json=False)
    assert caught.value.code == 3
    assert "no strike was made: every placement was refused" in capsys.readouterr().err


def test_a_session_that_gave_strikes_up_is_no_success(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ended with code 0 before, although the camera had died after the first of three strikes."""
    path = tmp_path / "r.mcap"
    report = SessionReport(path, (path,), 1, 800, 0, aborted=False, text="", skipped=("s2", "s3"))
    with pytest.raises(SystemExit) as caught:
        _print_session(report, as_json=True)
    assert caught.value.code == 3
    shown = capsys.readouterr()
    assert json.loads(shown.out)["skipped"] == ["s2", "s3"]
    assert "2 planned strikes given up (s2, s3): every placement was refused" in shown.err
