"""`acquire check` of a rig whose striker a microcontroller fires."""

from __future__ import annotations

from pathlib import Path

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import StrikerError, StrikerNotFound
from acquire.preflight.board import BoardFacts, check_board, check_held_board, read_board
from acquire.preflight.check import Outcome
from schemas.rig import StrikerConfig
from tests.acquire.preflight.bench import Bench
from tests.acquire.striker.board_bench import BoardBench

SERIAL = 'kind = "serial"\nspeed_range_m_s = [0.1, 0.6]'


def test_the_board_is_checked_in_place_of_a_servo(bench: Bench) -> None:
    toml = bench.rig_path.read_text(encoding="utf-8")
    bench.rig_path.write_text(toml.replace("effective_mass_kg = 0.2", SERIAL), encoding="utf-8")
    lines = bench.lines()
    assert lines["striker board"].outcome is Outcome.PASS
    assert "0.1 to 0.6 m/s" in lines["striker board"].found
    assert "serial port" in lines
    assert not [name for name in lines if name.startswith("servo")]
    bench.board = StrikerNotFound("/dev/ttyACM0: no such serial port; check the cable")
    assert bench.failures() == {"striker board"}
    bench.board = BoardFacts("demo", "contact time", 32.0)
    assert bench.failures() == {"striker board"}


def test_a_board_is_read_without_arming_it(tmp_path: Path) -> None:
    with BoardBench(tmp_path) as bench:
        check = check_board(lambda config: read_board(config, SystemClock()), bench.config())
        assert check.outcome is Outcome.PASS
        assert "virtual-board" in check.found
        assert "measures contact time" in check.found
        assert bench.state() == "safe"
        bench.board.fail()
        with pytest.raises(StrikerError, match="overload"):
            read_board(bench.config(), SystemClock())
        bench.board.firmware.state = "safe"
        with pytest.raises(StrikerError, match="speed_range_m_s"):
            read_board(bench.config(speed_range_m_s=(0.01, 0.5)), SystemClock())
        bench.board.firmware.senses = "none"
        assert "the images give its time" in read_board(bench.config(), SystemClock()).measures


def test_a_board_that_a_daemon_holds() -> None:
    assert check_held_board("homed").outcome is Outcome.PASS
    failed = check_held_board("fault", "the board reports the fault overload")
    assert failed.outcome is Outcome.FAIL
    assert "overload" in failed.found


def test_a_rig_file_of_a_board_must_state_its_speeds() -> None:
    with pytest.raises(ValueError, match="speed_range_m_s"):
        StrikerConfig(kind="serial")
    for wrong in ((0.0, 0.5), (0.6, 0.5), (0.1, 11.0)):
        with pytest.raises(ValueError, match="speed_range_m_s"):
            StrikerConfig(kind="serial", speed_range_m_s=wrong)
    limits = StrikerConfig(kind="serial", speed_range_m_s=(0.1, 0.6)).tip_speeds()
    assert (limits.slowest_m_s, limits.fastest_m_s) == (0.1, 0.6)
