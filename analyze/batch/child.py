"""A worker's own process: takes a request per line on standard input, answers each with a line; ends when its parent does.

A process of its own can be stopped, and be bounded in memory, whatever a file does to it. Lines of JSON, not pickles: a worker that a
file has taken over cannot take over its parent.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import threading
import time
from pathlib import Path

import cv2

from analyze.batch.analysis import Request, analyse
from analyze.errors import AnalyzeError

_LOOKS_S = 0.5


def main() -> None:
    """Serve: `python -m analyze.batch.child SCRATCH MEMORY_LIMIT_BYTES PARENT_PID`."""
    scratch, limit, parent = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    # What libraries print must not be taken for an answer.
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()
    cv2.setNumThreads(1)
    if limit:
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
    for line in sys.stdin:
        try:
            answer = analyse(Request.of(json.loads(line)), scratch).json()
        except AnalyzeError as error:
            answer = {"error": str(error)}
        answers.write(json.dumps(answer) + "\n")
        answers.flush()


def _end_with(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_LOOKS_S)
    os._exit(1)


if __name__ == "__main__":
    main()
