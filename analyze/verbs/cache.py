"""`analyze cache`: size and entries of the cache of results, and its removal."""

from __future__ import annotations

import json
from datetime import datetime
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import one_line
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.cache.folder import CacheFolder, Entry

_MEGA = 1e6


@click.command()
@click.option("--list", "as_list", is_flag=True, help="List the entries, the one used last first.")
@click.option("--clear", is_flag=True, help="Remove all entries.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def cache(as_list: bool, clear: bool, as_json: bool) -> None:
    """Show, list or clear the strikes and estimates that are kept so that they need not be computed again."""
    from analyze.cache.folder import FOLDER_VARIABLE, CacheFolder, default_folder

    if as_list and clear:
        raise click.UsageError("--list and --clear exclude each other: choose one")
    path = default_folder()
    if path is None:
        text = f"cache: switched off: {FOLDER_VARIABLE} is empty, or there is no home folder"
        echo(json.dumps({"folder": None}) if as_json else text)
        return
    folder = CacheFolder(path)
    if clear:
        removed = folder.clear()
        text = f"cache: {path}: {counted(removed, 'entry')} removed"
        echo(json.dumps({"folder": str(path), "removed": removed}) if as_json else text)
        return
    entries = folder.entries()
    if as_json:
        echo(json.dumps(_as_json(folder, entries)))
        return
    size = sum(entry.size_bytes for entry in entries)
    limit = folder.max_bytes / _MEGA
    echo(f"cache: {path}: {counted(len(entries), 'entry')}, {size / _MEGA:.1f} of {limit:.0f} MB")
    if as_list and entries:
        _render(entries)


def _as_json(folder: CacheFolder, entries: Sequence[Entry]) -> dict[str, object]:
    return {
        "folder": str(folder.path),
        "size_bytes": sum(entry.size_bytes for entry in entries),
        "max_bytes": folder.max_bytes,
        "entries": [
            {
                "file": entry.path.name,
                "content": entry.label,
                "size_bytes": entry.size_bytes,
                "used": _time(entry).isoformat(timespec="seconds"),
            }
            for entry in entries
        ],
    }


def _render(entries: Sequence[Entry]) -> None:
    """Print the entries as a table."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    from schemas.terminal import Terminal

    table = Table("content", "kB", "last used", box=SIMPLE_HEAD)
    for entry in entries:
        label = entry.label or f"damaged: {entry.path.name}"
        table.add_row(label, f"{entry.size_bytes / 1e3:.0f}", _time(entry).strftime("%Y-%m-%d %H:%M"))
    Terminal().print(table)


def _time(entry: Entry) -> datetime:
    return datetime.fromtimestamp(entry.used).astimezone()
