"""Whole files of every kind, and copies of their folders in which commands run."""

from __future__ import annotations

import shutil
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path

from tests.attack.kept_targets import make_all_targets
from tests.attack.targets import Target


@cache
def whole_targets(folder: Path) -> list[Target]:
    """Write the whole files, in a process of its own: OpenCV's threads would not survive a fork."""
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        return pool.submit(make_all_targets, folder / "whole").result()


def copy_folder(target: Target, folder: Path) -> Path:
    """Copy a target's folder to `folder`/case by hard links, in place of an older copy; returns the copy."""
    case = folder / "case"
    shutil.rmtree(case, ignore_errors=True)
    shutil.copytree(target.folder, case, copy_function=_link)
    return case


def _link(source: str, copy: str) -> None:
    Path(copy).hardlink_to(source)
