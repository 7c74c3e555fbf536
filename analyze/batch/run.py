"""Run an analysis over an archive: select recordings, start workers, record their outcomes."""

from __future__ import annotations

import os
import shutil
import socket
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from analyze.batch.archive import Source
from analyze.batch.ledger import Entry, Ledger, read_ledgers
from analyze.batch.settings import BatchSettings, analysis_version
from analyze.batch.worker_messages import FAILURES, ROWS, Outcome, Request
from analyze.batch.worker_process import SCRATCH, Limits, WorkerProcess
from analyze.errors import ArchiveError

OutcomeCallback = Callable[[Outcome, int, int], None]
"""called with a recording's outcome, the number of recordings done and the number in all"""
Answer = tuple[Source, Outcome]


@dataclass(frozen=True)
class BatchOptions:
    """Options of one batch run: processes, limits per recording, which recordings, part of the archive."""

    jobs: int = field(default_factory=lambda: max(1, len(os.sched_getaffinity(0))))
    """largest number of worker processes on this machine; by default the CPU cores it may use"""
    limits: Limits = field(default_factory=Limits)
    """limits of time and memory per recording"""
    only_failed: bool = False
    """True to analyse only recordings whose latest analysis failed"""
    verify: bool = False
    """True to open every recording and compare its content with its seal, the hash stored in it"""
    shard: tuple[int, int] = (1, 1)
    """number of this shard (part of the archive), from 1, and number of shards"""
    scheduler: str = ""
    """address of a Dask scheduler; "" for processes of this machine"""


@dataclass(frozen=True)
class Work:
    """Recordings of an archive, divided into those to analyse and those that are unchanged."""

    todo: tuple[Source, ...]
    """recordings to analyse"""
    unchanged: tuple[Entry, ...]
    """latest ledger entries of recordings already analysed with these settings and code, unchanged since"""
    failed_before: tuple[Entry, ...]
    """entries of `unchanged` whose analysis failed"""


@dataclass(frozen=True)
class Report:
    """Outcomes of one batch run."""

    outcomes: tuple[Outcome, ...]
    """outcomes of the recordings analysed, in the order in which they finished"""
    unchanged: int
    """number of recordings that were analysed before and have not changed"""
    failed_before: tuple[Entry, ...]
    """ledger entries of recordings that failed before and were not analysed again"""
    interrupted: bool = False
    """True if Ctrl-C ended the run early"""

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """Outcomes of the recordings that failed in this run."""
        return tuple(outcome for outcome in self.outcomes if outcome.failure)


def plan_work(
    sources: Sequence[Source], output: Path, settings: BatchSettings, options: BatchOptions
) -> Work:
    """Decide which recordings of this run's shard to analyse, without opening any.

    A recording is analysed if its files, the settings or the code have changed since its last analysis, if
    its row of results is missing, or if `options` request it: `verify` all recordings, `only_failed` those
    whose last analysis failed and no others.

    Args:
        sources: recordings of the archive.
        output: folder of the results; need not exist.
        settings: settings of the analysis.
        options: options of the run; a shard is a part of the archive.

    Returns:
        Recordings to analyse; ledger entries (stored outcomes) of recordings that are unchanged since their
        last analysis; and those of these entries that are failures.
    """
    number, shards = options.shard
    known = read_ledgers(output)
    here = {path.name for folder in (ROWS, FAILURES) for path in (output / folder).glob("*.parquet")}
    todo: list[Source] = []
    unchanged: list[Entry] = []
    for source in sources:
        if int(source.id, 16) % shards != number - 1:
            continue
        entry = known.get(source.url)
        same = (
            entry is not None
            and (entry.source_id, entry.settings, entry.analysis_version)
            == (source.id, settings.digest, analysis_version())
            and f"{entry.key or entry.source_id}.parquet" in here
        )
        if entry is None or not same or options.verify or (options.only_failed and entry.failure):
            todo.append(source)
        else:
            unchanged.append(entry)
            # Files with a name of the series that belong to another recording have entries of their own.
            for other in source.others(entry.own_files):
                own = known.get(other.url)
                if own is None or own.source_id != other.id:
                    todo.append(other)
                else:
                    unchanged.append(own)
    if options.only_failed:
        failing = {url for url, entry in known.items() if entry.failure}
        todo = [source for source in todo if source.url in failing]
    return Work(tuple(todo), tuple(unchanged), tuple(entry for entry in unchanged if entry.failure))


def run_batch(
    work: Work,
    output: Path,
    settings: BatchSettings,
    options: BatchOptions,
    callback: OutcomeCallback | None = None,
) -> Report:
    """Analyse the recordings of `work.todo`; write a ledger line and, unless there is one, a row for each.

    A ledger line holds a recording's outcome, a row its results or failure. Ctrl-C ends the run in an orderly
    way: finished results stay, and the next run analyses the rest.

    Args:
        work: recordings to analyse.
        output: folder of the results; created if missing.
        settings: settings of the analysis.
        options: options of the run.
        callback: called with (outcome, recordings done, recordings in all) after each; None for silence.

    Returns:
        Outcome of each recording analysed, the number of unchanged ones, ledger entries of those that failed
        before and were not analysed again, and whether Ctrl-C ended the run.

    Raises:
        ArchiveError: the results cannot be written, another run writes them, the object file changed during
            the run, or the scheduler cannot be reached.
    """
    outcomes: list[Outcome] = []
    interrupted = False
    with Ledger(output, options.shard, time.time_ns()) as ledger:
        for folder in (ROWS, FAILURES, SCRATCH):
            (output / folder).mkdir(exist_ok=True)
        _remove_dead_scratch(output, alone=options.shard == (1, 1))
        known = read_ledgers(output)
        _remove_rows_of_missing_files(output, known.values())
        # The largest first, so that no worker is busy with one when the others have nothing left.
        pending, total = sorted(work.todo, key=lambda source: -source.size), len(work.todo)
        try:
            while pending:
                requests = [
                    Request(source, settings, str(output.resolve()), options.verify) for source in pending
                ]
                pending = []
                with _answers(requests, output, options) as answers:
                    for source, outcome in answers:
                        _supersede(known, source, outcome, settings, output, ledger)
                        outcomes.append(outcome)
                        others = source.others(outcome.own_files)
                        pending += others
                        total += len(others)
                        if callback is not None:
                            callback(outcome, len(outcomes), total)
        except KeyboardInterrupt:
            interrupted = True
    return Report(tuple(outcomes), len(work.unchanged), work.failed_before, interrupted)


def _answers(
    requests: Sequence[Request], output: Path, options: BatchOptions
) -> AbstractContextManager[Iterator[Answer]]:
    """Analyse recordings on a cluster or on this machine for the duration of a `with` block.

    Returns:
        Context manager that gives an iterator of recordings with their outcomes, in the order in which they
        finish.
    """
    if options.scheduler:
        from analyze.batch.cluster import cluster_answers

        return cluster_answers(requests, options.scheduler, options.limits)
    return _local_answers(requests, output, options)


@contextmanager
def _local_answers(
    requests: Sequence[Request], output: Path, options: BatchOptions
) -> Iterator[Iterator[Answer]]:
    workers = [WorkerProcess(output, options.limits) for _ in range(min(options.jobs, len(requests)))]
    idle = deque(workers)

    def analyse(request: Request) -> Answer:
        worker = idle.pop()
        try:
            return request.source, worker.analyse(request)
        finally:
            idle.append(worker)

    pool = ThreadPoolExecutor(len(workers))
    try:
        futures = [pool.submit(analyse, request) for request in requests]
        yield (future.result() for future in as_completed(futures))
    finally:
        for worker in workers:
            worker.stop()
        pool.shutdown(cancel_futures=True)
        for worker in workers:
            worker.close()


def _supersede(
    known: dict[str, Entry],
    source: Source,
    outcome: Outcome,
    settings: BatchSettings,
    output: Path,
    ledger: Ledger,
) -> None:
    """Record a recording's outcome in the ledger, and remove the stored row that it replaces.

    The replaced row is kept if another recording's entry names it too, as copies of one recording do. It is
    also kept if the files are unchanged and their analysis failed now: the cause is then the settings or the
    network, and the earlier result is still right.

    Args:
        known: latest ledger entry by URL; the recording's entry is replaced in place.
        source: the recording.
        outcome: its outcome.
        settings: settings of the analysis.
        output: folder of the results.
        ledger: ledger of this run.
    """
    entry = Entry(
        outcome.url,
        outcome.source_id,
        settings.digest,
        analysis_version(),
        outcome.key,
        outcome.failure,
        outcome.reason,
        outcome.own_files,
    )
    ledger.add([entry])
    before, known[source.url] = known.get(source.url), entry
    if before is None:
        return
    if entry.failure and before.source_id == entry.source_id:
        return
    if before.failure:
        (output / FAILURES / f"{before.source_id}.parquet").unlink(missing_ok=True)
    if before.key and all(other.key != before.key for other in known.values()):
        (output / ROWS / f"{before.key}.parquet").unlink(missing_ok=True)


def _remove_rows_of_missing_files(output: Path, known: Iterable[Entry]) -> None:
    """Remove failure rows of local files that no longer exist, such as a `.part` file that was recovered.

    Rows of successful analyses always stay.

    Args:
        output: folder of the results.
        known: latest ledger entry of each recording.
    """
    for entry in known:
        if entry.failure and "://" not in entry.url and not os.path.lexists(entry.url):
            (output / FAILURES / f"{entry.source_id}.parquet").unlink(missing_ok=True)


def _remove_dead_scratch(output: Path, *, alone: bool) -> None:
    """Remove folders of unfinished files that ended processes left in the results.

    Args:
        output: folder of the results.
        alone: True if no other run can be active there: the folders of all machines go, for a lost machine
            never comes back for its own. False to remove only those of this machine.
    """
    for folder in (output / SCRATCH).iterdir():
        host, _, process = folder.name.rpartition("-")[0].rpartition("-")
        here = host == socket.gethostname() and process.isdigit()
        if alone or (here and not Path(f"/proc/{process}").exists()):
            shutil.rmtree(folder, ignore_errors=True)


def refuse_as_output(output: Path) -> None:
    """Raise ArchiveError if `output` cannot be a folder of results; call it before any work.

    Raises:
        ArchiveError: `output` is a file, or there is no permission to write in it or its nearest existing
            parent folder.
    """
    if output.exists() and not output.is_dir():
        raise ArchiveError(f"{output}: is a file: name a folder for the results with --out")
    parent = next(each for each in (output, *output.absolute().parents) if each.exists())
    if not os.access(parent, os.W_OK):
        raise ArchiveError(
            f"{output}: cannot be written (permission denied): choose another folder with --out"
        )
