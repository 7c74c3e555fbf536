"""Whole archives: `analyze batch` and `analyze query`."""

from __future__ import annotations

import signal
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.options import one_line
from schemas.command_line import NumberRange

if TYPE_CHECKING:
    from analyze.batch.run import BatchOptions

_OUTPUT = Path("results")
_MOST = 1 << 62
_UNITS = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30}


class _Bytes(click.ParamType):
    """4G, 800M, or bytes."""

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """To bytes."""
        if isinstance(value, int):
            return value
        text = str(value).upper().removesuffix("IB").removesuffix("B")
        unit = text[-1:] if text[-1:] in {"K", "M", "G"} else ""
        size = -1
        with suppress(ValueError, OverflowError):
            size = int(float(text.removesuffix(unit)) * _UNITS[unit])
        if not 0 <= size <= _MOST:
            self.fail(f"{value!r} is no size: write 4G or 800M", param, ctx)
        return size


class _Shard(click.ParamType):
    """Number / of so many."""

    name = "i/n"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[int, int]:
        """To two numbers, the first from 1 on."""
        if isinstance(value, tuple):
            return value
        number, _, of = str(value).partition("/")
        if not (number.isdigit() and of.isdigit() and 1 <= int(number) <= int(of)):
            self.fail(f"{value!r} is no shard: write 3/10 for the third of ten", param, ctx)
        return int(number), int(of)


@click.command()
@click.argument("paths", metavar="PATH...", nargs=-1)
@click.option("--out", "output", type=click.Path(path_type=Path), default=_OUTPUT, show_default=True, help="Folder of the results.")
@click.option("--jobs", "-j", type=click.IntRange(1), help="Recordings at a time; default: one per core.")
@click.option("--exclude", multiple=True, metavar="GLOB", help="Leave out what matches, by place, folder or name; may be repeated.")
@click.option("--dry-run", is_flag=True, help="Say what would be done.")
@click.option("--only-failed", is_flag=True, help="Try those again that gave nothing, and nothing else.")
@click.option("--verify", is_flag=True, help="Read every recording and compare its content with its seal.")
@click.option("--object", "object_file", type=click.Path(path_type=Path), help="Use this object file instead of the recordings'.")
@click.option("--time-limit", type=NumberRange(0, min_open=True), default=900.0, show_default=True, metavar="S", help="Per recording.")
@click.option("--memory-limit", type=_Bytes(), default="4G", show_default=True, help="Per worker; 0: none.")
@click.option("--scheduler", default="", metavar="ADDRESS", help="Work on this Dask cluster; the results' folder must be the workers' too.")
@click.option("--shard", type=_Shard(), default="1/1", help="The i-th part of n, for array jobs.")
@click.option("--summary", is_flag=True, help="Only say what the results say together.")
@click.option("--save", type=click.Path(path_type=Path), help="With --summary: write it (.html, .csv or .parquet).")
@one_line
def batch(
    paths: Sequence[str],
    output: Path,
    jobs: int | None,
    exclude: tuple[str, ...],
    dry_run: bool,
    only_failed: bool,
    verify: bool,
    object_file: Path | None,
    time_limit: float,
    memory_limit: int,
    scheduler: str,
    shard: tuple[int, int],
    summary: bool,
    save: Path | None,
) -> None:
    """Analyse every recording in folders, globs and buckets, and again only what changed."""
    if summary:
        _summarise(output, save)
        return
    if save is not None:
        raise click.UsageError("--save goes with --summary")
    if not paths:
        raise click.UsageError("say where the recordings are: a folder, a glob, or s3://bucket/folder")
    from analyze.batch.archive import find_sources
    from analyze.batch.run import BatchOptions, refuse_as_output, work_of
    from analyze.batch.settings import BatchSettings
    from analyze.batch.worker_process import Limits

    refuse_as_output(output)
    settings = BatchSettings() if object_file is None else BatchSettings.of_object(object_file)
    options = BatchOptions(
        limits=Limits(time_limit, memory_limit), only_failed=only_failed, verify=verify, shard=shard, scheduler=scheduler,
        **({} if jobs is None else {"jobs": jobs}),
    )  # fmt: skip
    work = work_of(find_sources(paths, exclude), output, settings, options)
    if dry_run:
        for source in work.todo:
            click.echo(source.url)
        click.echo(f"{len(work.todo)} to analyse, {len(work.unchanged)} unchanged", err=True)
        return
    _run(work, output, settings, options)


def _run(work: Any, output: Path, settings: Any, options: BatchOptions) -> None:
    from analyze.batch.run import run_batch
    from analyze.batch.table_of_run import BatchProgress, render_report

    # A cluster ends what has no time left so; its host may never come back to remove what is half done.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with BatchProgress(len(work.todo)) as progress:
        report = run_batch(work, output, settings, options, progress)
    render_report(report, output)
    if report.interrupted:
        raise click.exceptions.Exit(130)
    if report.failures:
        raise click.exceptions.Exit(3)


def _summarise(output: Path, save: Path | None) -> None:
    from analyze.batch.query import rows_of
    from analyze.batch.summary import summarise
    from analyze.batch.summary_files import render_summary, save_summary

    found = summarise(rows_of(output))
    if save is None:
        render_summary(found)
        return
    for path in save_summary(found, save):
        click.echo(f"summary: {path}")


@click.command()
@click.argument("sql", metavar="SQL")
@click.option("--out", "output", type=click.Path(path_type=Path), default=_OUTPUT, show_default=True, help="Folder of the results.")
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, a line per row.")
@click.option("--save", type=click.Path(path_type=Path), help="Write the answer (.parquet or .csv).")
@one_line
def query(sql: str, output: Path, as_csv: bool, as_json: bool, save: Path | None) -> None:
    """Ask the results of `analyze batch` in SQL: tables recordings, strikes, moments, regions, warnings."""
    from analyze.batch.answer import print_answer, save_answer
    from analyze.batch.query import ask

    if as_csv and as_json:
        raise click.UsageError("either --csv or --json")
    answer = ask(output, sql)
    if save is not None:
        save_answer(answer, save)
        click.echo(f"answer: {save}")
        return
    print_answer(answer, "csv" if as_csv else "json" if as_json else "table")
