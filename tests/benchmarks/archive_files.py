"""Archives of short recordings, whole and broken, that the benchmark of `analyze batch` reads."""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.console import Console
from rich.progress import track

from tests.broken_files import KINDS, break_file
from tests.quick_archive import body_of, quick_session

OBJECTS = 10
STRIKES = (1, 3, 10, 30, 100)


def make_session(wanted: tuple[Path, int, int]) -> None:
    path, number, strikes = wanted
    if not path.exists():
        quick_session(path, body_of(number % OBJECTS), number, strikes)


def make_archive(folder: Path, sessions: int, broken: int) -> None:
    """Make sessions of ten objects in a folder each, and broken files of all kinds in another folder."""
    wanted = [
        (folder / f"object-{number % OBJECTS}" / f"session-{number:04d}.mcap", number, 3)
        for number in range(sessions)
    ]
    for path, _, _ in wanted:
        path.parent.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        list(
            track(
                pool.map(make_session, wanted), "making sessions", len(wanted), console=Console(stderr=True)
            )
        )
    whole = folder.parent / f"{folder.name}-whole.mcap"
    make_session((whole, sessions, 3))
    (folder / "broken").mkdir(exist_ok=True)
    for number in range(broken):
        kind = list(KINDS)[number % len(KINDS)]
        if not list((folder / "broken").glob(f"broken-{kind}-{number}.*")):
            break_file(whole, folder / "broken", kind, number)
    whole.unlink()
