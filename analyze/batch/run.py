"""A run over an archive: what has to be done, who does it, what came of it."""

from __future__ import annotations

import os
import queue
import shutil
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from analyze.batch.archive import Source
from analyze.batch.ledger import Entry, Ledger, read_ledgers
from analyze.batch.request import FAILURES, ROWS, Outcome, Request
from analyze.batch.settings import BatchSettings, analysis_version
from analyze.batch.worker_process import SCRATCH, Lane, LaneStoppedError, Limits
from analyze.errors import ArchiveError

Told = Callable[[Outcome, int, int], None]
"""called with what became of a recording, how many are done and how many there are to do"""


@dataclass(frozen=True)
class BatchOptions:
    """How a run goes on."""

    jobs: int = field(default_factory=lambda: max(1, len(os.sched_getaffinity(0))))
    limits: Limits = field(default_factory=Limits)
    only_failed: bool = False
    verify: bool = False
    shard: tuple[int, int] = (1, 1)
    """number, of so many"""
    scheduler: str = ""
    """address of a Dask scheduler; "": processes of this machine"""


@dataclass(frozen=True)
class Work:
    """What a run has to do."""

    todo: tuple[Source, ...]
    unchanged: tuple[Entry, ...]
    """analysed before, as they are, with these settings"""
    failed_before: tuple[Entry, ...]
    """of these, those that gave nothing"""


@dataclass(frozen=True)
class Report:
    """What came of a run."""

    outcomes: tuple[Outcome, ...]
    unchanged: int
    failed_before: tuple[Entry, ...]
    """that were not tried again"""
    interrupted: bool = False

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """What gave no result in this run."""
        return tuple(outcome for outcome in self.outcomes if outcome.failure)


def work_of(sources: Sequence[Source], output: Path, settings: BatchSettings, options: BatchOptions) -> Work:
    """What is to be done, without opening a recording.

    Args:
        sources: the archive.
        output: folder of the results; need not exist.
        settings: of the analysis.
        options: of the run.
    """
    number, of = options.shard
    mine = [source for source in sources if int(source.id, 16) % of == number - 1] if of > 1 else list(sources)
    known = read_ledgers(output)
    here = {path.name for folder in (ROWS, FAILURES) for path in (output / folder).glob("*.parquet")}
    todo: list[Source] = []
    unchanged: list[Entry] = []
    for source in mine:
        entry = known.get(source.url)
        same = (
            entry is not None
            and (entry.source_id, entry.settings, entry.analysis_version) == (source.id, settings.digest, analysis_version())
            and f"{entry.key or entry.source_id}.parquet" in here
        )
        if entry is None or not same or options.verify or (options.only_failed and entry.failure):
            todo.append(source)
        else:
            unchanged.append(entry)
            # Files named alike that are no part of its recording have entries of their own.
            for other in source.others(entry.own_files) if entry.own_files else []:
                own = known.get(other.url)
                if own is None or own.source_id != other.id:
                    todo.append(other)
                else:
                    unchanged.append(own)
    if options.only_failed:
        failing = {url for url, entry in known.items() if entry.failure}
        todo = [source for source in todo if source.url in failing]
    return Work(tuple(todo), tuple(unchanged), tuple(entry for entry in unchanged if entry.failure))


def run_batch(work: Work, output: Path, settings: BatchSettings, options: BatchOptions, told: Told | None = None) -> Report:
    """Do it. Ctrl-C ends it in order: what was finished stays, what was not is done by the next run.

    Raises:
        ArchiveError: the results cannot be written, another run writes them, or the scheduler cannot be reached.
    """
    outcomes: list[Outcome] = []
    interrupted = False
    with Ledger(output, "all" if options.shard[1] == 1 else f"{options.shard[0]}-of-{options.shard[1]}", time.time_ns()) as ledger:
        for folder in (ROWS, FAILURES, SCRATCH):
            (output / folder).mkdir(exist_ok=True)
        _forget_scratch(output)
        known = read_ledgers(output)
        _forget_gone(output, known.values())
        pending, total = list(work.todo), len(work.todo)
        try:
            while pending:
                requests = [Request(source, settings, str(output.resolve()), options.verify) for source in pending]
                pending = []
                with _working(requests, output, options) as answers:
                    for source, outcome in answers:
                        _supersede(known, source, outcome, settings, output, ledger)
                        outcomes.append(outcome)
                        others = source.others(outcome.own_files) if outcome.own_files else []
                        pending += others
                        total += len(others)
                        if told is not None:
                            told(outcome, len(outcomes), total)
        except KeyboardInterrupt:
            interrupted = True
    return Report(tuple(outcomes), len(work.unchanged), work.failed_before, interrupted)


@contextmanager
def _working(requests: Sequence[Request], output: Path, options: BatchOptions) -> Iterator[Iterator[tuple[Source, Outcome]]]:
    if options.scheduler:
        from analyze.batch.cluster import on_cluster

        with on_cluster(requests, options) as answers:
            yield answers
        return
    lanes = [Lane(output, options.limits) for _ in range(min(options.jobs, len(requests)))]
    done: queue.Queue[tuple[Source, Outcome] | BaseException] = queue.Queue()
    waiting = iter(requests)
    lock = threading.Lock()

    def serve(lane: Lane) -> None:
        try:
            while True:
                with lock:
                    request = next(waiting, None)
                if request is None:
                    return
                done.put((request.source, lane.analyse(request)))
        except LaneStoppedError:
            pass
        except BaseException as error:  # told to the run, which raises it
            done.put(error)

    threads = [threading.Thread(target=serve, args=(lane,)) for lane in lanes]

    def come() -> Iterator[tuple[Source, Outcome]]:
        for _ in requests:
            found = done.get()
            if isinstance(found, BaseException):
                raise found
            yield found

    try:
        for thread in threads:
            thread.start()
        yield come()
    finally:
        for lane in lanes:
            lane.stop()
        for thread in threads:
            if thread.ident is not None:  # it was started
                thread.join()
        for lane in lanes:
            lane.close()


def _supersede(known: dict[str, Entry], source: Source, outcome: Outcome, settings: BatchSettings, output: Path, ledger: Ledger) -> None:
    """Write what is known now, and remove the row that it replaces, if no other recording needs it.

    A failure on a recording that is what it was says something of the settings, or of the network: results that were there stay.
    """
    entry = Entry(
        outcome.url, outcome.source_id, settings.digest, analysis_version(), outcome.key, outcome.failure, outcome.reason, outcome.own_files
    )
    ledger.add([entry])
    before, known[source.url] = known.get(source.url), entry
    if before is None:
        return
    if before.failure and (not entry.failure or before.source_id != entry.source_id):
        (output / FAILURES / f"{before.source_id}.parquet").unlink(missing_ok=True)
    replaced = not entry.failure or before.source_id != entry.source_id
    if before.key and before.key != entry.key and replaced and all(other.key != before.key for other in known.values()):
        (output / ROWS / f"{before.key}.parquet").unlink(missing_ok=True)


def _forget_gone(output: Path, known: Iterable[Entry]) -> None:
    """Remove the rows of files that gave nothing and are no more, as a `.part` that was recovered. Results stay, wherever recordings go."""
    for entry in known:
        if entry.failure and "://" not in entry.url and not os.path.lexists(entry.url):
            (output / FAILURES / f"{entry.source_id}.parquet").unlink(missing_ok=True)


def _forget_scratch(output: Path) -> None:
    """Remove what runs of this machine left that were killed."""
    for folder in (output / SCRATCH).iterdir():
        host, _, rest = folder.name.rpartition("-")[0].rpartition("-")
        if host == socket.gethostname() and rest.isdigit() and not Path(f"/proc/{rest}").exists():
            shutil.rmtree(folder, ignore_errors=True)


def refuse_as_output(output: Path) -> None:
    """Say early that results cannot be written to `output`.

    Raises:
        ArchiveError: it is a file, or its place cannot be written.
    """
    if output.exists() and not output.is_dir():
        raise ArchiveError(f"{output}: is a file: name a folder for the results with --out")
    parent = next(each for each in (output, *output.absolute().parents) if each.exists())
    if not os.access(parent, os.W_OK):
        raise ArchiveError(f"{output}: cannot be written (permission denied): choose another folder with --out")
