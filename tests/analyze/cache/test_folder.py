"""Entries of the cache's folder: written whole, checked, bounded in size, removed."""

from __future__ import annotations

import hashlib
import os
import threading
from pathlib import Path

import pytest

from analyze.cache.folder import CacheFolder, EntryError, default_folder


@pytest.fixture
def folder(tmp_path: Path) -> CacheFolder:
    return CacheFolder(tmp_path / "new" / "cache")


def test_an_entry_is_read_as_it_was_written(folder):
    assert folder.read("ab") is None
    assert folder.write("ab", "strike 1", b"content\n\0")
    assert folder.read("ab") == b"content\n\0"
    (entry,) = folder.entries()
    assert (entry.label, entry.size_bytes) == ("strike 1", entry.path.stat().st_size)
    assert folder.path.stat().st_mode & 0o077 == 0


@pytest.mark.parametrize("place", [0, 20, 90, -1])
def test_a_changed_byte_is_noticed(folder, place):
    folder.write("ab", "strike 1", b"content")
    (path,) = folder.path.iterdir()
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(bytes(data))
    with pytest.raises(EntryError, match="is damaged"):
        folder.read("ab")


@pytest.mark.parametrize("data", [b"", b"\n", b"[]\n", b"x" * 10_000, b"[" * 100_000 + b"\n", b"{}\nabc"])
def test_a_foreign_file_is_noticed(folder, data):
    folder.write("ab", "strike 1", b"content")
    (path,) = folder.path.iterdir()
    path.write_bytes(data)
    with pytest.raises(EntryError):
        folder.read("ab")
    assert [entry.label for entry in folder.entries()] == [""]


def test_the_entries_not_used_for_longest_go_first(tmp_path):
    folder = CacheFolder(tmp_path, max_bytes=3500)
    for number, key in enumerate("abc"):
        folder.write(key, key, bytes(1000))
        os.utime(tmp_path / f"{key}.cached", (number, number))
    folder.read("a")
    folder.write("d", "d", bytes(1000))
    assert {entry.label for entry in folder.entries()} == {"a", "c", "d"}
    assert not folder.write("e", "e", bytes(4000))
    assert len(folder.entries()) == 3


def test_a_folder_that_cannot_be_written_keeps_nothing(tmp_path):
    (tmp_path / "file").write_text("")
    folder = CacheFolder(tmp_path / "file" / "cache")
    assert folder.read("ab") is None
    assert not folder.write("ab", "strike 1", b"content")
    assert folder.entries() == []
    assert folder.clear() == 0


def test_clearing_leaves_other_files(folder):
    folder.write("ab", "strike 1", b"content")
    (folder.path / "mine.txt").write_text("mine")
    abandoned = folder.path / ".cd.cached.tmp"
    abandoned.write_text("")
    os.utime(abandoned, (0, 0))
    assert folder.clear() == 1
    assert [path.name for path in folder.path.iterdir()] == ["mine.txt"]


def test_readers_and_writers_at_the_same_time_see_whole_entries(tmp_path):
    contents = {key: hashlib.sha256(key.encode()).digest() * 500 for key in "abcdef"}
    problems: list[str] = []

    def work() -> None:
        folder = CacheFolder(tmp_path, max_bytes=60_000)  # three entries: others are removed all the time
        try:
            for key, content in [*contents.items()] * 3:
                folder.write(key, key, content)
                problems.extend(k for k, c in contents.items() if folder.read(k) not in {None, c})
        except Exception as error:
            problems.append(repr(error))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []
    assert 0 < sum(entry.size_bytes for entry in CacheFolder(tmp_path).entries()) <= 60_000


def test_the_folder_is_the_users(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PERCUSS_CACHE", "")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    assert default_folder() is None
    monkeypatch.delenv("PERCUSS_CACHE")
    assert default_folder() == tmp_path / ".cache" / "percuss"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert default_folder() == tmp_path / ".cache" / "percuss"
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "x"))
    assert default_folder() == tmp_path / "x" / "percuss"
    monkeypatch.setenv("PERCUSS_CACHE", "~/mine")
    assert default_folder() == tmp_path / "mine"
