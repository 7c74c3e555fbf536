"""`acquire strike` against a fake daemon's API: questions, commands sent, output, rig file written."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from acquire.cli import main
from acquire.config import read_rig
from acquire.daemon.client import DaemonClient
from acquire.daemon.server import ApiServer
from acquire.errors import ConfigError, SessionError, StrikerRefused
from acquire.session import single_strike
from acquire.striker.base import StrikeOutcome

MASS, MASS_SD = 0.2, 0.05
RIG = """name = "bench"   # ours

[camera]
address = "127.0.0.1"
[camera.calibration]
width = 64
height = 48
K = [[100, 0, 32], [0, 100, 24], [0, 0, 1]]
T_world_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]

[striker]
arm_length_m = 0.12
effective_mass_kg = 0.2   # guessed
restitution = 0.4

[daemon]
socket = "{socket}"
"""


@dataclass
class Daemon:
    """Fake daemon: its striker reaches 98 % of the commanded speed and loses a quarter of it at contact."""

    calls: list[tuple[str, dict[str, Any]]] = field(default_factory=list)
    recording: str | None = None
    homed: bool = False
    meets: bool = True
    feels: bool = True
    """False for a striker that senses no contact"""
    misses: int = 0
    fails: type[Exception] | None = None

    def handlers(self) -> dict[str, Any]:
        def heard(name: str, answer: Any) -> Any:
            def handle(_connection: object, params: dict[str, Any]) -> Any:
                self.calls.append((name, params))
                return answer(params) if callable(answer) else answer

            return handle

        simple = {name: heard(name, {}) for name in ("striker.arm", "striker.cock", "striker.stop")}
        return (
            simple
            | {"status": heard("status", self._status), "striker.home": heard("striker.home", self._home)}
            | {"striker.strike": heard("striker.strike", self._strike)}
        )

    def _status(self, _params: object) -> dict[str, Any]:
        state = "homed" if self.homed else "disarmed"
        return {
            "recording": self.recording,
            "rig": "bench",
            "striker": state,
            "striker_trouble": "",
            "stops": 0,
        }

    def _home(self, _params: object) -> dict[str, Any]:
        self.homed = True
        return {}

    def _strike(self, params: dict[str, Any]) -> dict[str, Any]:
        if self.fails is not None:
            raise self.fails("the arm is jammed")
        self.homed = False
        meets, self.misses = self.meets and not self.misses, max(self.misses - 1, 0)
        if not meets:
            speed = 0.0 if self.feels else None
            return asdict(StrikeOutcome(None, 0.0, speed, 0.0, None, 0.0, 0, 10**9))
        speed = 0.98 * params["tip_speed_m_s"]
        impulse = MASS * 0.25 * speed
        sd = impulse * ((MASS_SD / MASS) ** 2 + 0.1**2) ** 0.5
        return asdict(StrikeOutcome(1_200_000_000, 2e5, speed, 0.002, impulse, sd, 1, 10**9))

    @property
    def orders(self) -> list[str]:
        return [name.removeprefix("striker.") for name, _ in self.calls if name.startswith("striker.")]


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[Daemon]:
    found = Daemon()
    folder = tmp_path / "run"
    server = ApiServer(folder / "d.sock", found.handlers())
    (tmp_path / "rig.toml").write_text(RIG.format(socket=folder / "d.sock"), encoding="utf-8")
    yield found
    server.close()


def run(tmp_path: Path, *arguments: str, answers: str = "") -> Any:
    return CliRunner().invoke(
        main, ["strike", "--rig", str(tmp_path / "rig.toml"), *arguments], input=answers
    )


def test_strike_asks_once_and_arms_once(daemon: Daemon, tmp_path: Path) -> None:
    result = run(tmp_path, "--speed", "0.3", answers="y\n")
    assert result.exit_code == 0
    assert daemon.orders == ["home", "arm", "cock", "strike"]
    assert daemon.calls[-1][1] == {"strike_id": "single", "tip_speed_m_s": 0.3}
    assert "tip speed    0.2940 ± 0.0020 m/s (commanded 0.300)" in result.stdout
    assert "200.00 ± 0.20 ms after release" in result.stdout
    assert "impulse      14.70 ± " in result.stdout


def test_answer_no_prevents_the_strike(daemon: Daemon, tmp_path: Path) -> None:
    result = run(tmp_path, "--speed", "0.3", answers="n\n")
    assert result.exit_code == 1
    assert "strike" not in daemon.orders
    assert "arm" not in daemon.orders


def test_strike_is_refused_during_a_session(daemon: Daemon, tmp_path: Path) -> None:
    daemon.recording = "r.mcap"
    result = run(tmp_path, "--speed", "0.3", "--yes")
    assert result.exit_code == 1
    assert "a session is running (r.mcap)" in result.stderr
    assert daemon.orders == []


def test_error_stops_the_arm(daemon: Daemon, tmp_path: Path) -> None:
    daemon.fails = StrikerRefused
    result = run(tmp_path, "--speed", "0.3", "--yes")
    assert result.exit_code == 1
    assert result.stderr.splitlines()[-1] == "acquire: the arm is jammed"
    assert daemon.orders[-1] == "stop"


def test_missed_strike_exits_with_3(daemon: Daemon, tmp_path: Path) -> None:
    daemon.meets = False
    result = run(tmp_path, "--speed", "0.3", "--yes", "--json")
    assert result.exit_code == 3
    assert json.loads(result.stdout)["contact_time_ns"] is None


def test_a_striker_that_feels_nothing_reports_no_miss(daemon: Daemon, tmp_path: Path) -> None:
    daemon.meets = daemon.feels = False
    result = run(tmp_path, "--speed", "0.3", "--yes")
    assert result.exit_code == 0
    assert "not measured by this striker" in result.stdout


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--speed", "0.3", "--plan", "p.json"],
        ["--plan", "p.json"],
        ["--speed", "0.3", "--write"],
        ["--speed", "0.3", "--energy", "1.1"],
    ],
)
def test_contradictory_options_are_refused(daemon: Daemon, tmp_path: Path, arguments: list[str]) -> None:
    assert run(tmp_path, *arguments).exit_code == 2
    assert daemon.calls == []


def test_calibration_estimates_and_writes_the_parameters(daemon: Daemon, tmp_path: Path) -> None:
    """The arm loses a quarter of its speed to 50 g: (1 + e) / (1 + m / 0.05) = 0.25."""
    rig = tmp_path / "rig.toml"
    result = run(
        tmp_path,
        "--calibrate",
        "--yes",
        "--speeds",
        "0.2,0.4",
        "--repeats",
        "3",
        "--body-mass-kg",
        "0.05",
        "--write",
        "--json",
    )
    assert result.exit_code == 0, result.stderr
    found = json.loads(result.stdout)
    assert len(found["swings"]) == 12
    assert daemon.orders.count("arm") == daemon.orders.count("strike") == 12
    assert found["swing_ratio"]["mean"] == pytest.approx(0.98, abs=1e-6)
    learned = found["striker"]
    assert (1 + learned["restitution"]) / (1 + learned["effective_mass_kg"] / 0.05) == pytest.approx(
        0.25, rel=0.1
    )
    written = read_rig(rig).striker
    assert written.effective_mass_kg == pytest.approx(learned["effective_mass_kg"], rel=1e-3)
    assert written.restitution_sd == pytest.approx(learned["restitution_sd"], rel=0.1)
    lines = rig.read_text(encoding="utf-8").splitlines()
    assert lines[0] == 'name = "bench"   # ours'
    assert any(line.startswith("effective_mass_kg = ") and line.endswith("   # guessed") for line in lines)


def test_swings_in_the_air_leave_the_rig_file_unchanged(daemon: Daemon, tmp_path: Path) -> None:
    before = (tmp_path / "rig.toml").read_bytes()
    result = run(tmp_path, "--calibrate", "--speeds", "0.2", "--write", answers="y\n")
    assert result.exit_code == 0, result.stderr
    assert "reached / commanded speed: 0.9800 ± " in result.stdout
    assert "were not determined" in result.stdout
    assert (tmp_path / "rig.toml").read_bytes() == before


def test_answer_no_ends_the_calibration(daemon: Daemon, tmp_path: Path) -> None:
    result = run(
        tmp_path,
        "--calibrate",
        "--speeds",
        "0.2",
        "--repeats",
        "1",
        "--body-mass-kg",
        "0.05",
        answers="y\nn\n",
    )
    assert result.exit_code == 1
    assert daemon.orders.count("strike") == 1


def test_calibration_refuses_the_rig_file_of_another_rig(daemon: Daemon, tmp_path: Path) -> None:
    rig = read_rig(tmp_path / "rig.toml").model_copy(update={"name": "other"})
    with (
        DaemonClient(rig.daemon.socket_path()) as client,
        pytest.raises(ConfigError, match="runs rig 'bench', the file describes 'other'"),
    ):
        single_strike.calibrate(
            client, rig, single_strike.CalibrationOrder((0.2,), 1, ()), lambda _text: True
        )


def test_an_incomplete_swing_is_reported(daemon: Daemon, tmp_path: Path) -> None:
    daemon.meets = False
    rig = read_rig(tmp_path / "rig.toml")
    with (
        DaemonClient(rig.daemon.socket_path()) as client,
        pytest.raises(SessionError, match=r"calibrate-1: the arm did not reach angle 0"),
    ):
        single_strike.calibrate(
            client, rig, single_strike.CalibrationOrder((0.2,), 1, ()), lambda _text: True
        )


def test_incomplete_swing_is_repeated(daemon: Daemon, tmp_path: Path) -> None:
    rig = read_rig(tmp_path / "rig.toml")
    daemon.misses = 2
    with DaemonClient(rig.daemon.socket_path()) as client:
        swings = single_strike.calibrate(
            client, rig, single_strike.CalibrationOrder((0.2,), 2, ()), lambda _text: True
        )
    assert len(swings) == 2
    assert daemon.orders.count("strike") == 4


def test_default_speeds_are_within_the_strikers_limits(daemon: Daemon, tmp_path: Path) -> None:
    rig = read_rig(tmp_path / "rig.toml")
    speeds = single_strike.default_tip_speeds(rig)
    assert len(speeds) == 5
    assert 0.06 < speeds[0] < speeds[-1] < rig.striker.velocity_limit_rad_s * rig.striker.arm_length_m + 1e-9


ENTRIES = {
    "effective_mass_kg": "0.15",
    "effective_mass_sd_kg": "0.02",
    "restitution": "0.5",
    "restitution_sd": "0.04",
}


@pytest.mark.parametrize(
    "section",
    [
        "[striker]",
        "[ striker ]  # the arm\nrestitution=0.4# x\n\n\n[other]\na = 1",
        (
            '[striker]\nport = "/dev/#1"\nrestitution_sd = 0.1\nrestitution = 4e-1 # soft [tip]\n'
            "reach_m = [0.1, 0.2]\n\n[[list]]\nb = 2"
        ),
    ],
)
def test_only_the_striker_entries_change(tmp_path: Path, section: str) -> None:
    path = tmp_path / "r.toml"
    path.write_text(f'name = "x"\n\n{section}\n', encoding="utf-8")
    before = tomllib.loads(path.read_text(encoding="utf-8"))
    single_strike.write_striker(path, ENTRIES)
    after = tomllib.loads(path.read_text(encoding="utf-8"))
    assert {key: after["striker"].pop(key) for key in ENTRIES} == {
        key: float(value) for key, value in ENTRIES.items()
    }
    for key in ENTRIES:
        before["striker"].pop(key, None)
    assert after == before


@pytest.mark.parametrize(
    "text", ["name = 1\n", "striker = { restitution = 0.3 }\n", "[striker]\nreach_m = [\n  0.1,\n[\n"]
)
def test_rig_file_without_plain_striker_section_is_unchanged(tmp_path: Path, text: str) -> None:
    path = tmp_path / "r.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match="enter these values by hand"):
        single_strike.write_striker(path, ENTRIES)
    assert path.read_text(encoding="utf-8") == text
    assert list(tmp_path.iterdir()) == [path]
