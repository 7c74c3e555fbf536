"""Run a batch on a Dask cluster; each task analyses one recording in a worker process of its machine."""

from __future__ import annotations

import atexit
import logging
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any
from uuid import uuid4

from analyze.batch.archive import Source
from analyze.batch.settings import analysis_version
from analyze.batch.worker_messages import DIED, Outcome, Request, write_failure
from analyze.batch.worker_process import Limits, WorkerProcess
from analyze.errors import ArchiveError
from schemas.software import extra_command

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
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise ArchiveError(f"--scheduler needs Dask distributed: {extra_command('cluster')}") from None
    try:
        client = Client(scheduler, timeout=_CONNECT_TIMEOUT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ArchiveError(
            f"{scheduler}: no Dask scheduler answers ({' '.join(str(error).split())}): start it, or check "
            "the address"
        ) from None
    # Dask logs a lost connection as a traceback; the error below reports it in one line.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    plain_limits, version = (limits.seconds, limits.memory_bytes), analysis_version()
    # Under another run's key, Dask would return that run's outcome, from its folder and with its settings.
    run = uuid4().hex[:8]
    futures = {
        client.submit(
            _analyse_on_worker,
            asdict(request),
            plain_limits,
            version,
            key=f"percuss-{run}-{request.source.id}-{number}",
            pure=False,
        ): request
        for number, request in enumerate(requests)
    }

    def receive() -> Iterator[tuple[Source, Outcome]]:
        for future in as_completed(list(futures), loop=client.loop):
            request = futures[future]
            if future.status not in {"error", "finished"}:
                raise ArchiveError(
                    f"{scheduler}: lost: start the scheduler again, then repeat the same command"
                )
            if future.status == "error":
                error = future.exception()
                if isinstance(error, ArchiveError):
                    raise error
                reason = f"{request.source.url}: {' '.join(str(error).split())}"
                with WorkerProcess(Path(request.output), limits) as worker:
                    yield request.source, write_failure(request, DIED, reason, 0.0, worker.scratch)
            else:
                yield request.source, Outcome(**future.result())

    try:
        yield receive()
    finally:
        client.cancel(list(futures), force=True)
        client.close()


def _analyse_on_worker(fields: dict[str, Any], limits: tuple[float, int], version: str) -> dict[str, Any]:
    """Analyse one recording on a Dask worker.

    The worker's process is kept for later requests of this thread, and replaced for a run with another folder
    or other limits.

    Args:
        fields: the request as a dict, from `dataclasses.asdict`.
        limits: time [s] and memory [bytes] per recording.
        version: analysis version (hash of code and libraries) of the machine that runs the batch.

    Returns:
        The outcome (an `Outcome`) as a dict.

    Raises:
        ArchiveError: this worker has another version of Percuss, the results cannot be written, or the object
            file changed during the run.
        OutputError: the row of a recording whose worker process failed cannot be written.
    """
    if version != analysis_version():
        raise ArchiveError(
            f"{socket.gethostname()}: its worker has another version of Percuss: install this one there, and "
            "start it again"
        )
    request = Request.from_fields(fields)
    worker: WorkerProcess | None = getattr(_this_thread, "worker", None)
    if worker is None or _this_thread.serves != (request.output, limits) or not worker.scratch.exists():
        if worker is not None:
            atexit.unregister(worker.close)
            worker.close()
        worker = _this_thread.worker = WorkerProcess(Path(request.output), Limits(*limits))
        _this_thread.serves = (request.output, limits)
        atexit.register(worker.close)
    return asdict(worker.analyse(request))
