"""Every check of `acquire check` with fakes of computer, disk, servo and video."""

from __future__ import annotations

import io
import re
from dataclasses import replace

import numpy as np
import pytest

from acquire.errors import CameraNotFound, CameraSettingError, RecorderError, StrikerNotFound
from acquire.preflight.check import Outcome, failed_by_error
from acquire.preflight.computer import FolderState, PortState, ReceiveBuffer
from acquire.preflight.picture import CheckPicture
from acquire.preflight.read_video import VideoContent
from acquire.preflight.servo import ServoState, check_held_servo
from acquire.preflight.session import LINES
from schemas.rig import StrikerConfig
from schemas.terminal import Terminal
from schemas.watch_lines import SeenMarker
from tests.acquire.preflight.bench import (
    CONTENT,
    EVENT,
    FILM,
    PIXELS_PER_S,
    Bench,
    FakeComputer,
    FakeDisk,
    FakeNetwork,
    FakeVideoSource,
    route_by,
    square_corners,
)


def test_working_rig_passes_every_check_in_order(bench: Bench) -> None:
    lines = bench.lines()
    assert tuple(lines) == LINES
    assert {line.outcome for line in lines.values()} == {Outcome.PASS}
    assert bench.source.closed == 1
    assert lines["frames"].measured is not None
    assert lines["frames"].measured.value == pytest.approx(120.0)
    assert lines["frames"].as_dict()["outcome"] == "pass"


def test_unreadable_rig_file_fails_first_and_skips_the_rest(bench: Bench) -> None:
    bench.rig_path.write_text("[camera]\naddres = 1", encoding="utf-8")
    lines = bench.lines()
    assert tuple(lines) == LINES
    assert lines["rig file"].outcome is Outcome.FAIL
    assert {line.outcome for name, line in lines.items() if name != "rig file"} == {Outcome.NOT_CHECKED}


def test_every_check_is_listed_without_any_device(bench: Bench) -> None:
    bench.computer.port_state = PortState(exists=False, usable=False, group="", in_use=False)
    bench.servo = StrikerNotFound("/dev/ttyUSB0: no such serial port; check the cable")
    bench.source.refusal = CameraNotFound(
        "no camera answers at 192.168.10.2 (timeout): check power; see discover"
    )
    lines = bench.lines()
    assert tuple(lines) == LINES
    assert bench.failures() == {"serial port", "servo", "camera"}
    assert lines["servo"].found == "/dev/ttyUSB0: no such serial port"
    assert lines["servo"].remedy == "check the cable"
    assert lines["camera"].remedy == "check power; see discover"
    assert bench.source.closed == 2


@pytest.mark.parametrize(
    ("state", "line", "word"),
    [
        (
            PortState(exists=True, usable=False, group="dialout", in_use=False),
            "serial port",
            "usermod -aG dialout",
        ),
        (PortState(exists=True, usable=True, group="dialout", in_use=True), "port lock", "fuser"),
    ],
)
def test_the_serial_port(bench: Bench, state: PortState, line: str, word: str) -> None:
    bench.computer.port_state = state
    assert bench.failures() == {line}
    assert word in bench.lines()[line].remedy


@pytest.mark.parametrize(
    ("changes", "line", "word"),
    [
        ({"buffer": ReceiveBuffer(212_992, 212_992)}, "receive buffer", "rmem_max=16777216"),
        ({"latency": 16}, "USB latency", "latency_timer"),
        (
            {"folder": FolderState(exists=True, owned=True, private=False, can_be_made=True)},
            "daemon socket",
            "chmod 700",
        ),
        (
            {"folder": FolderState(exists=True, owned=False, private=True, can_be_made=True)},
            "daemon socket",
            "folder of yours",
        ),
        (
            {"folder": FolderState(exists=False, owned=False, private=False, can_be_made=False)},
            "daemon socket",
            "folder of yours",
        ),
    ],
)
def test_the_computer(bench: Bench, changes: dict, line: str, word: str) -> None:
    bench.computer = FakeComputer(**changes)
    assert bench.failures() == {line}
    assert word in bench.lines()[line].remedy


def test_loopback_carries_any_packet_and_a_port_without_a_timer_needs_none(bench: Bench) -> None:
    bench.computer, bench.network = FakeComputer(latency=None), FakeNetwork(way=route_by("lo", 1500))
    assert bench.failures() == set()


def test_the_disk(bench: Bench) -> None:
    bench.disk = FakeDisk(speed=1.2 * PIXELS_PER_S)
    assert bench.failures() == {"disk speed"}
    bench.disk = FakeDisk(free=900 << 20)
    assert bench.failures() == {"disk space"}
    bench.disk = FakeDisk(free=100 << 20)
    assert bench.failures() == {"disk space"}
    assert bench.lines()["disk speed"].outcome is Outcome.NOT_CHECKED
    bench.disk = FakeDisk(fault=FileNotFoundError(2, "No such file or directory"))
    assert bench.failures() == {"disk space"}


def test_finding_names_the_measured_disk(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """The findings name the folder, because `acquire session -o` may record to another disk."""
    folder = bench.rig_path.parent
    text = bench.rig_path.read_text().replace(f'directory = "{folder}"', 'directory = "recordings"')
    bench.rig_path.write_text(text)
    monkeypatch.chdir(folder)
    for line in ("disk space", "disk speed"):
        assert f" in {folder / 'recordings'}" in bench.lines()[line].found


def test_the_servo(bench: Bench) -> None:
    good = ServoState("XM430-W210", 12.0, 30, None, reads_per_s=600.0)
    for state, line in [
        (replace(good, voltage_v=5.0), "servo supply"),
        (replace(good, voltage_v=16.0), "servo supply"),
        (replace(good, voltage_v=11.0), "servo supply"),
        (replace(good, temperature_c=66), "servo temperature"),
        (replace(good, hardware_error="hardware error status 32: overload"), "servo health"),
        (replace(good, dangers=("Drive Mode 4",)), "servo memory"),
        (replace(good, firmware_problem="firmware 37 has no bus watchdog: update it"), "servo"),
        (replace(good, reads_per_s=60.0), "servo rate"),
    ]:
        bench.servo = state
        assert bench.failures() == {line}
    toml = bench.rig_path.read_text(encoding="utf-8")
    bench.rig_path.write_text(toml.replace("effective_mass_kg = 0.2\n", ""), encoding="utf-8")
    bench.servo = good
    assert bench.failures() == {"servo calibration"}
    bench.rig_path.write_text(toml.replace("effective_mass_kg = 0.2", 'kind = "manual"'), encoding="utf-8")
    lines = bench.lines()
    assert "hand" in lines["servo"].found
    assert "serial port" not in lines


def test_the_camera_and_its_video(bench: Bench) -> None:
    def failures(**changes: object) -> set[str]:
        bench.source = FakeVideoSource(replace(FILM, **changes))
        return bench.failures()

    def content(**changes: object) -> VideoContent:
        return replace(CONTENT, **changes)

    assert failures(lost=3) == {"frames"}
    assert failures(frames=111) == {"frames"}
    assert failures(frames=0, seconds=0.0) == {"frames"}
    assert failures(content=content(mapping_sd_ns=400_000)) == {"camera clock"}
    assert failures(content=content(mapping_sd_ns=400_000, clock_samples=0)) == set()
    assert failures(content=content(image=np.full((48, 64), 255, np.uint8))) == {"light"}
    assert failures(content=content(image=np.full((48, 64), 12, np.uint8))) == {"light"}
    assert failures(event=None) == {"marker"}
    assert failures(event=EVENT.model_copy(update={"markers": []})) == {"marker"}
    assert failures(
        event=EVENT.model_copy(update={"markers": [SeenMarker(id=3, corners_px=square_corners(25.0))]})
    ) == {"marker"}
    assert failures(event=EVENT.model_copy(update={"at_rest": False})) == {"object at rest"}
    bench.source = FakeVideoSource(
        refusal=CameraSettingError("camera 1.2.3.4: gain = 99 dB was refused (range): correct the rig file")
    )
    assert bench.failures() == {"camera settings"}
    bench.source = FakeVideoSource(RecorderError("the disk is full: free some space"))
    assert bench.failures() == {"frames"}


def test_level_reports_the_reading_or_the_prior(bench: Bench) -> None:
    assert "table tilt assumed 0 +- 0.2 deg" in bench.lines()["level"].found
    bench.rig_path.write_text(
        "gravity_tilt_sd_rad = 0.0005\n" + bench.rig_path.read_text(encoding="utf-8"), encoding="utf-8"
    )
    assert "table tilt 0 +- 0.029 deg (1 sigma), from the rig file" in bench.lines()["level"].found
    read = "\n[level]\ntowards_x_rad = 0.003\ntowards_x_sd_rad = 0.0002\n"
    bench.rig_path.write_text(bench.rig_path.read_text(encoding="utf-8") + read, encoding="utf-8")
    assert "table tilt 0.172 +- 0.011 deg, rising towards +x" in bench.lines()["level"].found


STATUS = {"rig": "bench", "pid": 7, "recording": None, "striker": "disarmed", "fps": 119.9, "lost": 0}


def test_running_daemon_is_reported_and_used(bench: Bench) -> None:
    bench.computer.port_state = PortState(exists=True, usable=True, group="dialout", in_use=True)
    bench.servo = StrikerNotFound("the servo was asked behind the daemon's back")
    bench.status = STATUS
    lines = bench.lines()
    assert tuple(lines) == LINES
    assert bench.failures() == set()
    assert "pid 7" in lines["daemon"].found
    assert lines["marker"].outcome is Outcome.PASS
    assert lines["servo supply"].outcome is Outcome.NOT_CHECKED
    servo = {"read_ns": 1, "model": 1030, "voltage_v": 9.1, "temperature_c": 65, "hardware_error": None}
    bench.status = {**STATUS, "striker": "fault", "servo": servo}
    assert bench.failures() == {"servo", "servo supply", "servo temperature"}
    assert bench.lines()["servo health"].outcome is Outcome.PASS
    bench.status = {
        **STATUS,
        "servo": {**servo, "voltage_v": 12.0, "temperature_c": 31, "hardware_error": "overload"},
    }
    assert bench.failures() == {"servo health"}
    bench.status = {**STATUS, "rig": "another"}
    assert "daemon" in bench.failures()


def test_open_session_is_not_disturbed(bench: Bench) -> None:
    bench.source.refusal = CameraNotFound("the camera was taken from the session: never do that")
    bench.status = {**STATUS, "recording": "/data/a.mcap"}
    lines = bench.lines()
    assert tuple(lines) == LINES
    assert bench.failures() == set()
    assert lines["marker"].outcome is Outcome.NOT_CHECKED
    bench.status = {**STATUS, "recording": "/data/a.mcap", "fps": 60.0}
    assert bench.failures() == {"frames"}


def test_check_failed_by_an_error_shows_its_remedy() -> None:
    line = failed_by_error("x", RecorderError("/data: is full: free some space"))
    assert (line.found, line.remedy) == ("/data: is full", "free some space")
    assert failed_by_error("x", RecorderError("boom")).found == "boom"
    assert "FAIL" in line.text()


@pytest.mark.parametrize("width", [80, 120])
def test_output_fits_the_terminal_and_ends_with_a_summary(bench: Bench, width: int) -> None:
    bench.source.video = replace(FILM, lost=3, event=None)
    output = io.StringIO()
    picture = CheckPicture(Terminal(file=output, width=width, force_terminal=False))
    for line in bench.lines().values():
        picture.show(line)
    picture.verdict(9.0)
    rows = output.getvalue().splitlines()
    assert max(map(len, rows)) <= width
    assert [row for row in rows if re.fullmatch("[a-z]+", row)] == [
        "rig",
        "computer",
        "servo",
        "camera",
        "scene",
    ]
    assert sum(row.lstrip().startswith("\u2717") for row in rows) == 2
    assert rows[-1] == f"not ready: frames, marker  ({len(LINES) - 3} passed, 2 failed, 1 not checked; 9 s)"
    good = CheckPicture(Terminal(file=output, width=width))
    good.verdict(1.0)
    assert "ready  (0 passed; 1 s)" in output.getvalue()


def test_striker_in_fault_fails_with_the_reason():
    healthy = {"model": 1030, "voltage_v": 12.0, "temperature_c": 30.0, "hardware_error": None}
    for health in (healthy, None):
        first = check_held_servo(StrikerConfig(), "fault", health, "its port was lost")[0]
        assert first.outcome is Outcome.FAIL
        assert "its port was lost" in first.found
        assert first.remedy
    assert check_held_servo(StrikerConfig(), "homed", healthy)[0].outcome is Outcome.PASS
