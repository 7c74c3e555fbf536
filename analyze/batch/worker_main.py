"""Main program of a batch worker: requests on standard input, answers on standard output, a line each.

A separate process can be stopped and limited in memory, whatever a recording makes it do. It ends when its
parent ends. The lines are JSON, not pickles, so that a worker compromised by a file cannot compromise its
parent.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import threading
import time
from dataclasses import asdict
from pathlib import Path

import cv2

from analyze.batch.analysis import analyse
from analyze.batch.worker_messages import Request
from analyze.errors import AnalyzeError

PARENT_CHECK_INTERVAL_S = 0.5


def main() -> None:
    """Analyse the recordings requested on standard input until it is closed.

    Run as `python -m analyze.batch.worker_main SCRATCH MEMORY_LIMIT_BYTES PARENT_PID`, with the folder for
    unfinished files and 0 for no memory limit. Each request is one line of JSON (`Request`), each answer too:
    the fields of an `Outcome`, or {"error": text} if the results cannot be written.
    """
    scratch, limit, parent = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    # Standard output is for answers alone: output of libraries goes to standard error.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    threading.Thread(target=_exit_with, args=(parent,), daemon=True).start()
    cv2.setNumThreads(1)
    if limit:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    for line in sys.stdin:
        try:
            answer = asdict(analyse(Request.from_fields(json.loads(line)), scratch))
        except AnalyzeError as error:
            answer = {"error": str(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _exit_with(parent: int) -> None:
    """End this process with exit code 1 once its parent has ended; checked every 0.5 s.

    Args:
        parent: process id of the parent.
    """
    while os.getppid() == parent:
        time.sleep(PARENT_CHECK_INTERVAL_S)
    os._exit(1)


if __name__ == "__main__":
    main()
