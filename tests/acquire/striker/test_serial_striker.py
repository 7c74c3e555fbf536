"""A striker that a microcontroller fires: what it measures, and failures of board, line and host."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from acquire.clock.clock import SystemClock
from acquire.errors import (
    StrikerError,
    StrikerFault,
    StrikerLost,
    StrikerNotFound,
    StrikerRefused,
    StrikerStopped,
)
from acquire.striker import board_link, states
from acquire.striker.base import StrikerState
from acquire.striker.serial_striker import SerialStriker
from acquire.virtual import striker_firmware
from tests.acquire.striker.board_bench import BoardBench
from tests.acquire.striker.conftest import wait_for


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[BoardBench]:
    with BoardBench(tmp_path) as bench:
        yield bench


@pytest.fixture
def striker(bench: BoardBench, heard: Any) -> Iterator[SerialStriker]:
    made = SerialStriker(
        bench.config(), heard.samples.append, heard.events.append, heard.clocks.append, SystemClock()
    )
    made.open()
    yield made
    made.close()


def ready(striker: SerialStriker) -> None:
    striker.home()
    striker.arm()
    striker.cock()


def test_the_contact_is_timed_within_its_stated_error(
    striker: SerialStriker, bench: BoardBench, heard: Any
) -> None:
    ready(striker)
    outcome = striker.strike("s1", 0.6)
    assert outcome.contacts == 1
    assert outcome.contact_time_ns is not None
    assert abs(outcome.contact_time_ns - bench.touches[0]) < 3 * outcome.contact_time_sd_ns
    assert 0.0005e9 <= outcome.contact_time_sd_ns < 0.001e9
    assert outcome.tip_speed_m_s is None  # this board does not measure it
    assert outcome.impulse_n_s is None
    assert heard.kinds() == [
        "HOMED", "ARMED", "COCKED", "RELEASED", "CONTACT", "VERIFIED", "DISARMED",
    ]  # fmt: skip
    released, contact = heard.events[3], heard.events[4]
    assert released.host_time_ns == outcome.released_ns < contact.host_time_ns
    assert released.time_sd_ns < 2e6
    assert heard.clocks
    assert bench.state() == "safe"


@pytest.mark.parametrize("senses", ["contact", "none"])
def test_a_strike_that_meets_nothing(
    striker: SerialStriker, bench: BoardBench, heard: Any, senses: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only a board that senses contacts can report a miss."""
    monkeypatch.setattr("acquire.striker.board_outcome.CONTACT_S", 0.3)
    bench.wall = False
    bench.board.firmware.senses = senses
    striker.close()
    striker.open()
    ready(striker)
    outcome = striker.strike("s1", 0.6)
    assert outcome.contact_time_ns is None
    assert outcome.missed is (senses == "contact")
    assert outcome.tip_speed_m_s == (0.0 if senses == "contact" else None)
    assert ("MISSED" in heard.kinds()) is (senses == "contact")


def test_a_stop_in_the_strike_switches_the_drive_off(striker: SerialStriker, bench: BoardBench) -> None:
    ready(striker)
    raised: list[BaseException] = []

    def strike() -> None:
        try:
            striker.strike("s1", 0.1)  # takes 0.6 s to the wall
        except StrikerError as error:
            raised.append(error)

    thread = threading.Thread(target=strike)
    thread.start()
    assert wait_for(lambda: bench.state() == "fired", 1.0)
    time.sleep(0.1)
    asked_ns = time.monotonic_ns()
    striker.stop()
    assert wait_for(lambda: bench.state() == "safe", 0.1)
    assert time.monotonic_ns() - asked_ns < 50_000_000
    thread.join()
    assert [type(each) for each in raised] == [StrikerStopped]
    assert striker.state is StrikerState.DISARMED
    assert bench.touches == []


def test_an_armed_board_disarms_itself_when_its_host_falls_silent(
    bench: BoardBench, striker: SerialStriker
) -> None:
    striker.home()
    striker.arm()
    assert bench.state() == "armed"
    striker._closing.set()  # as if the process had been killed: nobody sends anything any more
    assert wait_for(lambda: bench.state() == "safe", striker_firmware.SILENCE_NS * 1e-9 + 0.3)


def test_an_idle_host_keeps_the_board_armed_until_the_arming_expires(bench: BoardBench, heard: Any) -> None:
    striker = SerialStriker(
        bench.config(arming_expires_s=0.7),
        heard.samples.append,
        heard.events.append,
        heard.clocks.append,
        SystemClock(),
    )
    striker.open()
    try:
        striker.home()
        striker.arm()
        time.sleep(0.55)
        assert bench.state() == "armed"
        assert wait_for(lambda: striker.state is StrikerState.DISARMED, 0.5)
        assert bench.state() == "safe"
        assert heard.kinds()[-1] == "DISARMED"
    finally:
        striker.close()


def test_a_striker_that_nobody_draws_back_is_reported(
    striker: SerialStriker, bench: BoardBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(states.GUARD_S, StrikerState.COCKING, 0.2)
    bench.held.set()
    assert wait_for(lambda: bench.angle > -0.2, 0.2)
    striker.home()
    striker.arm()
    with pytest.raises(StrikerFault, match="not drawn back"):
        striker.cock()
    assert striker.state is StrikerState.FAULT
    assert wait_for(lambda: bench.state() == "safe", 0.2)
    bench.held.clear()
    time.sleep(0.3)
    ready(striker)
    assert striker.strike("again", 0.5).contacts == 1


def test_a_board_that_is_reset_while_armed_is_a_fault(striker: SerialStriker, bench: BoardBench) -> None:
    striker.home()
    striker.arm()
    with bench.serving:
        bench.board.firmware.reset(time.monotonic_ns())
    assert wait_for(lambda: striker.state is StrikerState.FAULT, 0.5)
    ready(striker)
    assert striker.state is StrikerState.SETTLED


def test_a_board_that_is_unplugged_and_plugged_in_again(
    striker: SerialStriker, bench: BoardBench, heard: Any
) -> None:
    ready(striker)
    with bench.serving:
        bench.board.close()
    assert wait_for(lambda: striker.state is StrikerState.FAULT, 1.0)
    with pytest.raises(StrikerNotFound, match="no such serial port"):
        striker.home()
    with bench.serving:
        bench.board.plug_in()
    ready(striker)
    assert striker.strike("s2", 0.5).contacts == 1
    assert heard.kinds().count("FAULT") == 2


def test_a_board_that_falls_silent_is_lost(
    striker: SerialStriker, bench: BoardBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    striker.home()
    monkeypatch.setattr(board_link, "REPLY_NS", 20_000_000)
    with bench.serving:  # no reply is on its way
        bench.silent.set()
    with pytest.raises(StrikerLost, match="no reply"):
        striker.arm()
    assert striker.state is StrikerState.FAULT


def test_an_order_to_fire_that_is_lost_is_not_repeated(
    striker: SerialStriker, bench: BoardBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready(striker)
    sent: list[tuple[object, ...]] = []
    exchange = striker._link._exchange

    def lossy(wait_ns: int, *words: object) -> Any:
        sent.append(words)
        return None if words[0] == "fire" else exchange(wait_ns, *words)

    monkeypatch.setattr(striker._link, "_exchange", lossy)
    with pytest.raises(StrikerLost, match="order to fire was lost"):
        striker.strike("s1", 0.5)
    assert [words[0] for words in sent].count("fire") == 1
    assert wait_for(lambda: bench.state() == "safe", 0.2)
    assert bench.touches == []


def test_an_order_to_fire_whose_reply_is_lost_is_carried_out_once(
    striker: SerialStriker, bench: BoardBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    ready(striker)
    sent: list[tuple[object, ...]] = []
    exchange = striker._link._exchange

    def lossy(wait_ns: int, *words: object) -> Any:
        sent.append(words)
        reply = exchange(wait_ns, *words)
        return None if words[0] == "fire" else reply

    monkeypatch.setattr(striker._link, "_exchange", lossy)
    assert striker.strike("s1", 0.5).contacts == 1
    assert [words[0] for words in sent].count("fire") == 1
    assert len(bench.touches) == 1


def test_a_stop_while_the_striker_is_drawn_back_ends_the_wait(
    striker: SerialStriker, bench: BoardBench
) -> None:
    bench.held.set()
    assert wait_for(lambda: bench.angle > -0.2, 0.2)
    striker.home()
    striker.arm()
    stopper = threading.Timer(0.15, striker.stop)
    stopper.start()
    with pytest.raises(StrikerStopped):
        striker.cock()
    stopper.join()
    assert bench.state() == "safe"
    assert striker.state is StrikerState.DISARMED


def test_a_fault_of_the_board_is_named(striker: SerialStriker, bench: BoardBench) -> None:
    striker.home()
    striker.arm()
    with bench.serving:
        bench.board.fail()
    with pytest.raises(StrikerFault, match="overload"):
        striker.cock()
    striker.home()
    assert striker.state is StrikerState.HOMED


def test_speeds_that_the_board_does_not_fire_are_refused_with_both_ranges(
    bench: BoardBench, heard: Any
) -> None:
    striker = SerialStriker(
        bench.config(speed_range_m_s=(0.05, 1.5)),
        heard.samples.append,
        heard.events.append,
        heard.clocks.append,
        SystemClock(),
    )
    with pytest.raises(StrikerFault, match=r"0\.08 to 0\.9 m/s.*\[0\.05, 1\.5\]"):
        striker.open()
    striker.close()


def test_a_speed_outside_the_rig_files_range_is_refused(striker: SerialStriker) -> None:
    ready(striker)
    with pytest.raises(StrikerRefused, match="speed_range_m_s"):
        striker.strike("s1", 0.95)
    assert striker.state is StrikerState.SETTLED


def test_a_port_without_a_board_is_named(bench: BoardBench, heard: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(board_link, "START_NS", 100_000_000)
    monkeypatch.setattr(board_link, "HELLO_NS", 30_000_000)
    bench.silent.set()
    striker = SerialStriker(
        bench.config(), heard.samples.append, heard.events.append, heard.clocks.append, SystemClock()
    )
    with pytest.raises(StrikerNotFound, match="no striker board answers at 1000000 bit/s"):
        striker.open()
    striker.close()
