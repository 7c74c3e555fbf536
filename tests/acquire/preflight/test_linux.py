"""Checks of `acquire check` that read this computer: disk, processor, serial port, socket folder."""

from __future__ import annotations

import fcntl
import os
import socket
from pathlib import Path

import pytest

from acquire.preflight.computer import Computer, FolderState, ReceiveBuffer
from acquire.preflight.disk import Disk
from acquire.preflight.network import Network
from tests.acquire.preflight.bench import (
    RIG,
    Bench,
)


def test_disk_test_leaves_no_file(tmp_path: Path) -> None:
    ticks = iter([0, 2_000_000_000])
    assert Disk(lambda: next(ticks)).write_speed(tmp_path, 3 << 20) == pytest.approx((3 << 20) / 2.0)
    assert list(tmp_path.iterdir()) == []


def test_linux_computer_reads_the_system(tmp_path: Path) -> None:
    timer = tmp_path / "sys/bus/usb-serial/devices/ttyUSB7/latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n", encoding="ascii")
    limit = tmp_path / "proc/sys/net/core/rmem_max"
    limit.parent.mkdir(parents=True)
    limit.write_text("212992\n", encoding="ascii")
    computer = Computer(tmp_path / "sys", tmp_path / "proc", tmp_path)
    assert computer.latency_timer_ms("/dev/ttyUSB7") == 16
    assert computer.latency_timer_ms("/dev/ttyUSB8") is None
    assert computer.receive_buffer(65_536) == ReceiveBuffer(65_536, 212_992)
    route = Network().route("127.0.0.9")
    assert route is not None
    assert route.loopback
    assert route.mtu_bytes == int(Path("/sys/class/net/lo/mtu").read_text(encoding="ascii"))
    assert not computer.port("/dev/ttyNone").exists


def test_port_in_use_is_detected_by_flock_and_lock_file(tmp_path: Path) -> None:
    computer = Computer(lock=tmp_path)
    master, slave = os.openpty()
    try:
        path = os.ttyname(slave)
        state = computer.port(path)
        assert (state.exists, state.usable, state.in_use) == (True, True, False)
        fcntl.flock(slave, fcntl.LOCK_EX | fcntl.LOCK_NB)
        assert computer.port(path).in_use
        fcntl.flock(slave, fcntl.LOCK_UN)
        lock_file = tmp_path / f"LCK..{Path(path).name}"
        lock_file.write_text("         1\n", encoding="ascii")
        assert computer.port(path).in_use
        lock_file.write_text(" 999999999\n", encoding="ascii")
        assert not computer.port(path).in_use
    finally:
        os.close(master)
        os.close(slave)


def test_state_of_the_socket_folder(tmp_path: Path) -> None:
    computer = Computer()
    tmp_path.chmod(0o700)
    assert computer.socket_folder(tmp_path) == FolderState(
        exists=True, owned=True, private=True, can_be_made=True
    )
    tmp_path.chmod(0o755)
    assert not computer.socket_folder(tmp_path).private
    assert computer.socket_folder(tmp_path / "a" / "b").can_be_made


def test_unusable_socket_path_fails(bench: Bench, tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "daemon.sock").write_text("mine", encoding="utf-8")
    assert bench.failures() == {"daemon socket"}
    (tmp_path / "run" / "daemon.sock").unlink()
    with socket.socket(socket.AF_UNIX) as stale:
        stale.bind(str(tmp_path / "run" / "daemon.sock"))
        assert bench.failures() == set()
    long = RIG.format(folder=tmp_path).replace("daemon.sock", "d" * 100)
    bench.rig_path.write_text(long, encoding="utf-8")
    assert bench.failures() == {"daemon socket"}
