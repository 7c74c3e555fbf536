"""The same work on a Dask cluster: every task has a worker process of its own, as on one machine (lane.py)."""

from __future__ import annotations

import atexit
import logging
import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any
from uuid import uuid4

from analyze.batch.archive import Source
from analyze.batch.request import DIED, Outcome, Request, failed
from analyze.batch.settings import analysis_version
from analyze.batch.worker_process import Lane, Limits
from analyze.errors import ArchiveError

if TYPE_CHECKING:
    from analyze.batch.run import BatchOptions

_CONNECTS_S = 20
_mine = threading.local()


@contextmanager
def on_cluster(requests: Sequence[Request], options: BatchOptions) -> Iterator[Iterator[tuple[Source, Outcome]]]:
    """Answers as they come; a task whose worker is lost is given to another one, by Dask.

    Raises:
        ArchiveError: Dask is not installed, or the scheduler does not answer.
    """
    try:
        from distributed import Client, as_completed
    except ImportError:
        raise ArchiveError("--scheduler needs Dask distributed: install percuss[cluster]") from None
    try:
        client = Client(options.scheduler, timeout=_CONNECTS_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise ArchiveError(
            f"{options.scheduler}: no Dask scheduler answers ({' '.join(str(error).split())}): start it, or check the address"
        ) from None
    # Its own words on a lost connection are a traceback; ours follow.
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
    limits, version = (options.limits.seconds, options.limits.memory_bytes), analysis_version()
    # Under a key of another run Dask would answer with what that run made, in its folder and with its settings.
    run = uuid4().hex[:8]
    futures = {
        client.submit(_in_lane, request.json(), limits, version, key=f"percuss-{run}-{request.source.id}-{number}", pure=False): request
        for number, request in enumerate(requests)
    }

    def come() -> Iterator[tuple[Source, Outcome]]:
        for future in as_completed(list(futures), loop=client.loop):
            request = futures[future]
            if future.status not in {"error", "finished"}:
                raise ArchiveError(f"{options.scheduler}: lost: start the scheduler again; the same command goes on")
            if future.status == "error":
                error = future.exception()
                if isinstance(error, ArchiveError):
                    raise error
                reason = f"{request.source.url}: {' '.join(str(error).split())}"
                with Lane(Path(request.output), options.limits) as lane:
                    yield request.source, failed(request, DIED, reason, 0.0, lane.scratch)
            else:
                yield request.source, Outcome(**future.result())

    try:
        yield come()
    finally:
        client.cancel(list(futures), force=True)
        client.close()


def _in_lane(told: dict[str, Any], limits: tuple[float, int], version: str) -> dict[str, Any]:
    """What a Dask worker does: plain values in and out. It stays for the next run, which may write elsewhere, within other limits."""
    if version != analysis_version():
        raise ArchiveError(f"{socket.gethostname()}: its worker has another version of Percuss: install this one there, and start it again")
    request = Request.of(told)
    lane: Lane | None = getattr(_mine, "lane", None)
    if lane is None or _mine.wanted != (request.output, limits) or not lane.scratch.exists():
        if lane is not None:
            atexit.unregister(lane.close)
            lane.close()
        lane = _mine.lane = Lane(Path(request.output), Limits(*limits))
        _mine.wanted = (request.output, limits)
        atexit.register(lane.close)
    return lane.analyse(request).json()
