"""Where a file is to be written: both commands refuse alike what has no place, before any work; no folder is made unasked."""

from __future__ import annotations

import os
from pathlib import Path


def why_unwritable(output: Path, *inputs: Path) -> str | None:
    """One line that says why `output` cannot be written, or that it would replace one of the `inputs`; None where all is well.

    A missing folder is not made: its name may be misspelt, and a recording that nobody finds is lost.
    """
    folder = output.parent
    if output.is_dir():
        return f"{output}: is a folder: name a file in it"
    if not folder.is_dir():
        return f"{output}: cannot be written: there is no folder {folder}: create it first"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"{output}: cannot be written: the folder {folder} is not yours to write in: choose another place"
    for path in inputs:
        if output.exists() and path.exists() and output.samefile(path):
            return f"{output}: is what is read, and would be replaced: choose another name for the output"
    return None
