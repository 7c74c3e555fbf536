"""`analyze compact`: recordings in half the bytes, without loss, or within the camera's noise."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.options import one_line
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.compact.compact import Compacted

_MEGA = 1e6
_SOME_FAILED = 3


@click.command()
@click.argument("places", metavar="PATH...", nargs=-1, required=True)
@click.option(
    "--near-lossless",
    is_flag=True,
    help="Average the images, within their own noise, where they show no structure; phi and k of each strike"
    " are compared, and a change leaves the recording as it is.",
)
@click.option("--crop", is_flag=True, help="Keep only the part of the image in which something moves.")
@click.option(
    "--disk-reserve",
    type=click.IntRange(min=0),
    default=0,
    metavar="BYTES",
    help="Disk space that a copy leaves free; a recording without room for one stays as it is.",
)
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def compact(
    places: tuple[str, ...], near_lossless: bool, crop: bool, disk_reserve: int, as_json: bool
) -> None:
    """Store the images of recordings, or of all in a folder, in half the bytes, without loss.

    Each copy is read back and compared with the recording before it takes its place: whenever the command is
    interrupted, one of the two is whole. What is compact already is left out. All commands read both kinds.
    """
    from analyze.batch.archive import find_sources
    from analyze.compact.compact import CompactOptions
    from analyze.compact.compact import compact as compact_recording
    from analyze.errors import AnalyzeError
    from analyze.progress import ProgressBar

    options = CompactOptions(near_lossless, crop, disk_reserve)
    done: list[Compacted] = []
    problems: list[str] = []
    with ProgressBar() as progress:
        for source in find_sources(places):
            try:
                # What is done before an error stays in the list.
                done.extend(compact_recording(Path(source.url), options, progress))
            except OSError as error:
                problems.append(f"{source.url}: cannot be compacted: {error.strerror}: it stays as it is")
            except AnalyzeError as error:
                problems.append(str(error))
    if as_json:
        echo(json.dumps(_as_json(done, problems), allow_nan=False))
    else:
        _render(done)
    for problem in problems:
        echo(problem, err=True)
    if problems:
        raise SystemExit(_SOME_FAILED if done else 1)


def _as_json(done: list[Compacted], problems: list[str]) -> dict[str, object]:
    files = [
        {
            "path": str(each.path),
            "bytes_original": each.bytes_original,
            "bytes_compact": each.bytes_compact,
            "compaction": None if each.compaction is None else each.compaction.model_dump(mode="json"),
        }
        for each in done
    ]
    return {"files": files, "problems": problems}


def _render(done: list[Compacted]) -> None:
    changed = [each for each in done if each.compaction is not None]
    for each in done:
        if each.compaction is None:
            echo(f"{each.path}: compact already: {each.bytes_compact / _MEGA:.1f} MB")
            continue
        kind = "without loss" if each.compaction.exact else each.compaction.change_text()
        share = 100 * each.bytes_compact / max(each.bytes_original, 1)
        echo(f"{each.path}: {_sizes([each])} ({share:.0f} %), {kind}")
    if len(done) > 1:
        echo(f"{counted(len(changed), 'file')} compacted: {_sizes(changed)}")


def _sizes(files: list[Compacted]) -> str:
    original = sum(each.bytes_original for each in files) / _MEGA
    compact = sum(each.bytes_compact for each in files) / _MEGA
    return f"{original:.1f} to {compact:.1f} MB"
