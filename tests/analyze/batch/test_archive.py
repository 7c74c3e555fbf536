"""Finding recordings in an archive by name: links, glob characters, exclusions."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from analyze.batch.archive import find_sources
from analyze.errors import ArchiveError


@pytest.fixture
def folder(tmp_path) -> Path:
    """Archive below a folder whose own name contains glob characters and matches the exclusions."""
    root = tmp_path / "test [a]" / "archive"
    for name in ("one.mcap", "two-test.mcap", "2025/three.mcap", "2026/tests/fo ur ä.mcap", "2026/notes.txt"):
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"x")
    return root


def names(folder: Path, *exclude: str, place: str = "") -> list[str]:
    return [
        str(Path(source.url).relative_to(folder)) for source in find_sources([f"{folder}{place}"], exclude)
    ]


ALL = ["2025/three.mcap", "2026/tests/fo ur ä.mcap", "one.mcap", "two-test.mcap"]


def test_folder_with_glob_characters_in_its_name_is_found(folder):
    assert names(folder) == ALL


@pytest.mark.parametrize(
    ("pattern", "left"),
    [
        ("*-test.mcap", ["2025/three.mcap", "2026/tests/fo ur ä.mcap", "one.mcap"]),
        ("test*", ["2025/three.mcap", "one.mcap", "two-test.mcap"]),
        ("2025/*", ALL[1:]),
        ("./2025/", ALL[1:]),
        ("2026/tests", [ALL[0], *ALL[2:]]),
    ],
)
def test_excluded_recordings(folder, pattern, left):
    assert names(folder, pattern) == left


def test_globs_find_recordings(folder, monkeypatch):
    monkeypatch.chdir(folder)
    assert [Path(source.url).name for source in find_sources(["20*"])] == ["three.mcap", "fo ur ä.mcap"]
    assert [Path(source.url).name for source in find_sources(["**/t*.mcap"])] == [
        "three.mcap",
        "two-test.mcap",
    ]
    with pytest.raises(ArchiveError, match="contains no recording"):
        find_sources(["nothing*"])
    with pytest.raises(ArchiveError, match="empty"):
        find_sources([""])
    assert [Path(source.url).name for source in find_sources(["2026/notes.txt"])] == ["notes.txt"], (
        "named itself"
    )


def test_links_are_followed_but_not_in_a_circle(folder, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    (disk / "far.mcap").write_bytes(b"xy")
    (folder / "linked").symlink_to(disk)
    (folder / "circle").symlink_to(folder)
    (folder / "gone.mcap").symlink_to(tmp_path / "nowhere.mcap")
    (folder / "single.mcap").symlink_to(disk / "far.mcap")
    os.mkfifo(folder / "pipe.mcap")
    assert names(folder) == sorted([*ALL, "linked/far.mcap", "gone.mcap", "single.mcap"])
    before = {source.url: source.id for source in find_sources([str(folder)])}
    (disk / "far.mcap").write_bytes(b"yx")
    os.utime(disk / "far.mcap", ns=(1, 1))
    after = {source.url: source.id for source in find_sources([str(folder)])}
    changed = {Path(url).name for url in after if after[url] != before[url]}
    assert changed == {"far.mcap", "single.mcap"}, "what a link points to has changed"
    assert find_sources([str(folder / "one.mcap")])[0].id == after[str(folder / "one.mcap")], (
        "however it was found"
    )


def test_folder_without_read_permission_is_named(folder, monkeypatch):
    scandir = os.scandir

    def refuse(place):
        if str(place).endswith("2025"):
            raise PermissionError(13, "Permission denied", place)
        return scandir(place)

    monkeypatch.setattr(os, "scandir", refuse)
    with pytest.raises(ArchiveError, match="2025: may not be read"):
        find_sources([str(folder)])
    assert names(folder, "2025") == ALL[1:]
