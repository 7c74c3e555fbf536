"""Run a batch on a Dask cluster; each task analyses one recording in a worker process of its machine."""

from __future__ import annotations

import atexit
import logging
import shutil
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from analyze.batch.archive import Source
from analyze.batch.settings import analysis_version
from analyze.batch.unwritable import cannot_be_written
from analyze.batch.worker_messages import DIED, Outcome, Request, write_failure
from analyze.batch.worker_process import SCRATCH, Limits, WorkerProcess
from analyze.errors import ArchiveError
from schemas.software import extra_command
from schemas.wording import counted

if TYPE_CHECKING:
    from distributed import Client, Future

_CONNECT_TIMEOUT_S = 20
_this_thread = threading.local()


@contextmanager
def cluster_answers(
    requests: Sequence[Request], scheduler: str, limits: Limits
) -> Iterator[Iterator[tuple[Source, Outcome]]]:
    """Analyse recordings on a Dask cluster for the duration of a `with` block.

    Dask repeats a task whose worker is lost on another worker. At the end, unfinished tasks are cancelled.

    Args:
        requests: recordings to analyse.
        scheduler: address of the Dask scheduler.
        limits: limits of time and memory per recording.

    Yields:
        Iterator of recordings with their outcomes, in the order in which they finish. It raises ArchiveError
        if the scheduler is lost, a worker has another version of Percuss, the results cannot be written, or
        the object file changed. A task that fails for any other reason yields a failure of kind "died".

    Raises:
        ArchiveError: Dask is not installed, or the scheduler does not answer.
    """
    # Under another run's key, Dask would return that run's outcome, from its folder and with its settings.
    run = uuid4().hex[:8]
    plain_limits, version = (limits.seconds, limits.memory_bytes), analysis_version()
    with _connected(scheduler) as client, _marked(Path(requests[0].output), run):
        futures = {
            client.submit(
                _analyse_on_worker,
                asdict(request),
                plain_limits,
                version,
                run,
                key=f"percuss-{run}-{request.source.id}-{number}",
                pure=False,
            ): request
            for number, request in enumerate(requests)
        }

        def receive() -> Iterator[tuple[Source, Outcome]]:
            from distributed import as_completed

            for future in as_completed(list(futures), loop=client.loop):
                request = futures.pop(future)
                outcome = _outcome(future, request, scheduler, limits)
                # Dask would analyse a recording again whose worker is lost after it was received.
                future.release()
                yield request.source, outcome

        try:
            yield receive()
        finally:
            client.cancel(list(futures), force=True)


@contextmanager
def _connected(scheduler: str) -> Iterator[Client]:
    """Connection to the Dask scheduler for the duration of a `with` block.

    Raises:
        ArchiveError: Dask is not installed, there is no certificate, or the scheduler does not answer.
    """
    try:
        from distributed import Client
        from distributed.security import Security
    except ImportError:
        raise ArchiveError(f"--scheduler needs Dask distributed: {extra_command('cluster')}") from None
    try:
        connection = Security().get_connection_args("client")
        if scheduler.startswith("tls://") and connection.get("ssl_context") is None:
            raise ArchiveError(
                f"{scheduler}: lets in only who has a certificate: set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, "
                "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT and DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY"
            )
        client = Client(scheduler, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ArchiveError(
            f"{scheduler}: no Dask scheduler answers ({' '.join(str(error).split())}): start it, or check "
            "the address"
        ) from None
    # Dask logs a lost connection as a traceback; an error reports it in one line.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    try:
        yield client
    finally:
        client.close()


@contextmanager
def _marked(output: Path, run: str) -> Iterator[None]:
    """Folder of a run among the unfinished files, by which its workers notice that they see the results.

    Raises:
        ArchiveError: the folder cannot be made.
    """
    mark = _mark(output, run)
    try:
        mark.mkdir(parents=True)
    except OSError as error:
        raise cannot_be_written(output, error) from None
    try:
        yield
    finally:
        shutil.rmtree(mark, ignore_errors=True)


def _mark(output: Path, run: str) -> Path:
    return output / SCRATCH / f"run-{run}"


def _outcome(future: Future, request: Request, scheduler: str, limits: Limits) -> Outcome:
    """Outcome of a finished task; of a task that failed, a failure of kind "died", whose row is written.

    Args:
        future: finished task.
        request: its request.
        scheduler: address of the Dask scheduler.
        limits: limits of time and memory per recording.

    Raises:
        ArchiveError: the scheduler is lost, the task raised this error, or the failure's row cannot be
            written.
    """
    from distributed import CancelledError
    from distributed.scheduler import KilledWorker

    error: BaseException | None = None
    if future.status in {"error", "finished"}:
        try:
            return Outcome(**future.result())
        except (CancelledError, Exception) as raised:  # of any kind: Dask passes on what the task raised
            error = raised
    # Else it is the connection's error: the task's result could not be fetched.
    if error is None or future.status != "error":
        raise ArchiveError(f"{scheduler}: lost: start the scheduler again, then repeat the same command")
    if isinstance(error, ArchiveError):
        raise error
    text = " ".join(str(error).split())
    if isinstance(error, KilledWorker):
        ended = counted(error.allowed_failures + 1, "worker")
        text = f"{ended} ended during its analysis: add --only-failed to try it again"
    with WorkerProcess(Path(request.output), limits) as worker:
        return write_failure(request, DIED, f"{request.source.url}: {text}", 0.0, worker.scratch)


def _analyse_on_worker(
    fields: dict[str, Any], limits: tuple[float, int], version: str, run: str
) -> dict[str, Any]:
    """Analyse one recording on a Dask worker.

    The worker's process is kept for later requests of this thread, and replaced for a run with another folder
    or other limits.

    Args:
        fields: the request as a dict, from `dataclasses.asdict`.
        limits: time [s] and memory [bytes] per recording.
        version: analysis version (hash of code and libraries) of the machine that runs the batch.
        run: name of the run, of which there is a folder among the unfinished files of the results.

    Returns:
        The outcome (an `Outcome`) as a dict.

    Raises:
        ArchiveError: this worker has another version of Percuss, it does not see the folder of the results
            or cannot write it, or the object file changed during the run.
    """
    if version != analysis_version():
        raise ArchiveError(
            f"{socket.gethostname()}: its worker has another version of Percuss: install this one there, and "
            "start it again"
        )
    request = Request.from_fields(fields)
    if not _mark(Path(request.output), run).exists():
        raise ArchiveError(
            f"{socket.gethostname()}: its worker does not see the results in {request.output}: share this "
            "folder with that machine, then repeat the same command"
        )
    worker: WorkerProcess | None = getattr(_this_thread, "worker", None)
    if worker is None or _this_thread.serves != (request.output, limits) or not worker.scratch.exists():
        if worker is not None:
            atexit.unregister(worker.close)
            worker.close()
        try:
            worker = _this_thread.worker = WorkerProcess(Path(request.output), Limits(*limits))
        except OSError as error:
            raise cannot_be_written(Path(request.output), error) from None
        _this_thread.serves = (request.output, limits)
        atexit.register(worker.close)
    return asdict(worker.analyse(request))
