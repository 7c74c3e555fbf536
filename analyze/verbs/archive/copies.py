"""`analyze archive duplicates` and `superseded`: what need not be kept, or not be used."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path

import click

from analyze.verbs.archive.selection import json_option, print_json_lines
from analyze.verbs.options import one_line, results_folder_option
from schemas.plain_text import echo
from schemas.wording import counted

_GIGA = 1e9


@click.command()
@results_folder_option
@json_option
@one_line
def duplicates(output: Path, as_json: bool) -> None:
    """Find copies of recordings, and versions of one session; nothing is removed."""
    from analyze.catalogue.copies import SAME_CONTENT, find_copies
    from analyze.catalogue.scrub import UNSEALED, WHOLE
    from analyze.catalogue.table import read_catalogue

    groups = find_copies(read_catalogue(output).to_pylist())
    if as_json:
        print_json_lines(
            {
                "kind": group.kind,
                "best": group.best["url"],
                "best_scrub": group.best["scrub"],
                "others": [row["url"] for row in group.others],
                "other_bytes": group.other_bytes,
            }
            for group in groups
        )
        return
    for group in groups:
        echo(f"{group.kind}: keep {group.best['url']}")
        for row in group.others:
            echo(f"    {row['url']}{_difference(row, group.best)}")
    for kind in dict.fromkeys(group.kind for group in groups):
        own = [group for group in groups if group.kind == kind]
        others, size = sum(len(group.others) for group in own), sum(group.other_bytes for group in own)
        word = "copy" if kind == SAME_CONTENT else "version"
        echo(f"{counted(others, f'other {word}')} ({kind}), {size / _GIGA:.2f} GB")
    unread = sum(group.best["scrub"] not in {WHOLE, UNSEALED} for group in groups)
    if unread:
        echo(
            f"{counted(unread, 'recording')} to keep not found whole by a scrub: "
            "run `analyze archive scrub` before you remove any"
        )
    if not groups:
        echo("no recording is there twice")


def _difference(row: dict[str, object], best: dict[str, object]) -> str:
    names = ("state", "scrub", "compaction", "rebases", "losses", "strikes", "tosses")
    differing = [name for name in names if (row[name] or 0) != (best[name] or 0)]
    return ": " + ", ".join(f"{name} {row[name] or 'none'}" for name in differing) if differing else ""


@click.command()
@results_folder_option
@json_option
@one_line
def superseded(output: Path, as_json: bool) -> None:
    """Find answers that a newer analysis, recording or version of the session has superseded."""
    from analyze.batch.ledger import read_ledgers
    from analyze.catalogue.superseded import REMEDIES, find_superseded
    from analyze.catalogue.table import read_catalogue

    found = find_superseded(read_catalogue(output).to_pylist(), output)
    if as_json:
        print_json_lines(asdict(each) for each in found)
        return
    for why, remedy in REMEDIES.items():
        own = [each for each in found if each.why == why]
        if own:
            echo(f"{why}: {counted(len(own), 'answer')}: {remedy}")
        for each in own:
            echo(f"    {each.url or each.key}" + (f" -> {each.by}" if each.by else ""))
    if not found:
        some = bool(read_ledgers(output))
        echo("all answers are current" if some else f"no answers: run `analyze batch PATH --out {output}`")
