"""Only regular files are read: no pipe is waited for, no device read without end."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from schemas.input_file import MAX_TEXT_BYTES, open_file, open_text, read_bytes, read_text


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _of_the_kernel(path: Path) -> None:
    path.symlink_to("/proc/kmsg")


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (_pipe, "it is a pipe"),
        (_device, "it is a device"),
        (_of_the_kernel, "made by the kernel"),
        (_socket, "No such device"),
        (Path.mkdir, "Is a"),
    ],
)
def test_what_is_no_file_is_refused_at_once(tmp_path, make, reason):
    make(tmp_path / "a")
    for read in (open_file, open_text, read_bytes, read_text):
        with pytest.raises(OSError, match=reason):
            read(tmp_path / "a")


def test_a_file_with_a_hole_of_a_terabyte_is_refused(tmp_path):
    with (tmp_path / "a").open("wb") as file:
        file.truncate(1 << 40)
    for read in (open_text, read_bytes, read_text):
        with pytest.raises(OSError, match="it is larger than"):
            read(tmp_path / "a")


def test_a_zero_byte_in_a_name_is_an_error_of_the_system():
    with pytest.raises(OSError, match="zero byte"):
        open_file(Path("a\0b"))


def test_a_regular_file_is_read_as_open_reads_it(tmp_path):
    path = tmp_path / "a"
    path.write_bytes("a\r\nb\rc\né".encode())
    assert read_text(path) == path.read_text(encoding="utf-8")
    assert read_bytes(path) == path.read_bytes()
    assert len(path.read_bytes()) < MAX_TEXT_BYTES


def test_a_byte_order_mark_is_left_out(tmp_path):
    path = tmp_path / "object.toml"
    path.write_bytes("mass_kg = 1.0\r\n".encode("utf-8-sig"))
    assert read_text(path) == "mass_kg = 1.0\n"
