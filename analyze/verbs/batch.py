"""`analyze batch`: analyse every recording of an archive, and summarise the results."""

from __future__ import annotations

import signal
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from analyze.verbs.options import one_line, pass_options, path_option, results_folder_option
from analyze.verbs.outputs import refuse_outputs
from schemas.command_line import INTERRUPTED, LOSS, NumberRange
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.batch.run import BatchOptions, Work
    from analyze.batch.settings import BatchSettings

_MAX_BYTES = 1 << 62
_BYTES_PER_UNIT = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30}


class _Bytes(click.ParamType):
    """Type of a click option: a size in bytes, written as 4G, 800M, 64K or a plain number.

    K, M and G are powers of 1024; an appended B or iB is allowed.
    """

    name = "size"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Convert the text of a command-line value to a number of bytes; an int is returned as it is.

        Raises:
            click.BadParameter: the text is not a size from 0 to 2^62 bytes.
        """
        if isinstance(value, int):
            return value
        text = str(value).upper().removesuffix("IB").removesuffix("B")
        unit = text[-1:] if text[-1:] in {"K", "M", "G"} else ""
        size = -1
        with suppress(ValueError, OverflowError):
            size = int(float(text.removesuffix(unit)) * _BYTES_PER_UNIT[unit])
        if not 0 <= size <= _MAX_BYTES:
            self.fail(f"{value!r} is not a size: write 4G or 800M", param, ctx)
        return size


class _Shard(click.ParamType):
    """Type of a click option: one of n parts (shards) of an archive, written as i/n with i from 1 to n."""

    name = "i/n"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, int]:
        """Convert the text "i/n" to the tuple (i, n): number of the shard, from 1, and number of shards.

        A tuple is returned as it is.

        Raises:
            click.BadParameter: the text is not i/n with 1 <= i <= n.
        """
        if isinstance(value, tuple):
            return value
        number, _, count = str(value).partition("/")
        if not (number.isdigit() and count.isdigit() and 1 <= int(number) <= int(count)):
            self.fail(f"{value!r} is not a shard: write 3/10 for the third of ten", param, ctx)
        return int(number), int(count)


@dataclass(frozen=True)
class _BatchArguments:
    """Values of the arguments and options of `analyze batch`."""

    paths: tuple[str, ...]
    """folders, globs and buckets that contain the recordings"""
    output: Path
    """folder of the results"""
    jobs: int | None
    """number of recordings analysed at a time; None for one per core"""
    exclude: tuple[str, ...]
    """globs of recordings to leave out"""
    dry_run: bool
    """True to list the recordings only"""
    only_failed: bool
    """True to analyse only recordings that failed before"""
    verify: bool
    """True to read every recording and check its content against its hash"""
    object_file: Path | None
    """object file to use for all recordings; None for the recordings' own"""
    time_limit: float
    """time limit per recording [s]"""
    memory_limit: int
    """memory limit per worker [bytes]; 0 for none"""
    scheduler: str
    """address of a Dask scheduler; "" for processes of this machine"""
    shard: tuple[int, int]
    """number of the part to analyse, from 1, and number of parts"""
    summary: bool
    """True to summarise the results in the folder, and analyse nothing"""
    save: Path | None
    """file to write the summary to; None to print it"""
    baseline: int | None
    """number of sessions that give the limits of a control chart; None for the default"""


@click.command()
@click.argument("paths", metavar="PATH...", nargs=-1)
@results_folder_option
@click.option(
    "--jobs", "-j", type=click.IntRange(1), help="Recordings analysed at a time; default: one per core."
)
@click.option(
    "--exclude",
    multiple=True,
    metavar="GLOB",
    help="Leave out recordings whose path, folder or name matches GLOB; may be repeated.",
)
@click.option("--dry-run", is_flag=True, help="List the recordings that would be analysed, and stop.")
@click.option("--only-failed", is_flag=True, help="Analyse only recordings that failed before.")
@click.option("--verify", is_flag=True, help="Read every recording and check its content against its hash.")
@path_option("--object", "object_file", help="Use this object file instead of the recordings' own.")
@click.option(
    "--time-limit",
    type=NumberRange(0, min_open=True),
    default=900.0,
    show_default=True,
    metavar="S",
    help="Seconds per recording.",
)
@click.option(
    "--memory-limit", type=_Bytes(), default="4G", show_default=True, help="Memory per worker; 0: no limit."
)
@click.option(
    "--scheduler",
    default="",
    metavar="ADDRESS",
    help="Use the Dask cluster at ADDRESS; its workers must see the same results folder.",
)
@click.option(
    "--shard", type=_Shard(), default="1/1", help="Analyse only the i-th of n parts, for array jobs."
)
@click.option("--summary", is_flag=True, help="Analyse nothing; summarise the results in the folder.")
@path_option("--save", help="With --summary: the file to write it to (.html, .csv or .parquet).")
@click.option(
    "--baseline",
    type=click.IntRange(8),
    help="With --summary: sessions, from the first, that give a control chart's limits.  [default: 20]",
)
@one_line
@pass_options(_BatchArguments)
def batch(arguments: _BatchArguments) -> None:
    """Estimate from every recording in folders, globs and buckets; later runs repeat only what changed."""
    if arguments.summary:
        _summarise(arguments.output, arguments.save, arguments.baseline)
        return
    if arguments.save is not None:
        raise click.UsageError("--save needs --summary: add it")
    if arguments.baseline is not None:
        raise click.UsageError("--baseline needs --summary: add it")
    if not arguments.paths:
        raise click.UsageError("no recordings are named: give a folder, a glob, or s3://bucket/folder")
    from analyze.batch.archive import find_sources
    from analyze.batch.run import BatchOptions, plan_work, refuse_as_output
    from analyze.batch.settings import BatchSettings
    from analyze.batch.worker_process import Limits

    refuse_as_output(arguments.output)
    object_file = arguments.object_file
    settings = BatchSettings() if object_file is None else BatchSettings.with_object(object_file)
    options = BatchOptions(
        limits=Limits(arguments.time_limit, arguments.memory_limit),
        only_failed=arguments.only_failed,
        verify=arguments.verify,
        shard=arguments.shard,
        scheduler=arguments.scheduler,
        **({} if arguments.jobs is None else {"jobs": arguments.jobs}),
    )
    work = plan_work(find_sources(arguments.paths, arguments.exclude), arguments.output, settings, options)
    if arguments.dry_run:
        for source in work.todo:
            echo(source.url)
        echo(f"{len(work.todo)} to analyse, {len(work.unchanged)} unchanged", err=True)
        return
    _run(work, arguments.output, settings, options)


def _run(work: Work, output: Path, settings: BatchSettings, options: BatchOptions) -> None:
    """Analyse the recordings that `work` lists into the folder `output`, and print the run's report.

    Raises:
        click.exceptions.Exit: the run was interrupted (exit code INTERRUPTED), or a recording failed (exit
            code LOSS).
    """
    from analyze.batch.query import gather_results
    from analyze.batch.run import run_batch
    from analyze.batch.run_report import BatchProgress, render_report

    # Job schedulers end a job that runs out of time with SIGTERM, and its host may never come back to remove
    # unfinished files: end as on Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with BatchProgress(len(work.todo)) as progress:
        report = run_batch(work, output, settings, options, progress)
        if not report.interrupted:
            gather_results(output)
    render_report(report, output)
    if report.interrupted:
        raise click.exceptions.Exit(INTERRUPTED)
    if report.failures:
        raise click.exceptions.Exit(LOSS)


def _summarise(output: Path, save: Path | None, baseline: int | None) -> None:
    """Print a summary of the results in the folder `output`, or write it to the file `save` if given."""
    from analyze.batch.control_charts import BASELINE
    from analyze.batch.query import read_recording_rows
    from analyze.batch.result_rows import BULKY_COLUMNS
    from analyze.batch.summary import summarise
    from analyze.batch.summary_output import render_summary, save_summary

    refuse_outputs([save])
    summary = summarise(read_recording_rows(output, BULKY_COLUMNS), baseline or BASELINE)
    if save is None:
        render_summary(summary)
        return
    for path in save_summary(summary, save):
        echo(f"summary: {path}")
