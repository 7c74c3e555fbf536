"""Early check of the files that a verb (subcommand of `analyze`) is to write, before its computation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path


def refuse_outputs(
    outputs: Iterable[Path | None], recordings: Sequence[Path] = (), inputs: Sequence[Path | None] = ()
) -> None:
    """Refuse outputs that cannot be written or would replace a file that is read.

    Args:
        outputs: files to write; entries that are None are skipped.
        recordings: recordings that are read; all files of each one's series count.
        inputs: other files that are read; entries that are None are skipped.

    Raises:
        OutputError: an output cannot be written, or is one of the files that are read.
    """
    from schemas.output_file import refuse_unwritable

    named = [output for output in outputs if output is not None]
    read = [path for path in inputs if path is not None]
    if named and recordings:
        from analyze.reading.file_series import find_series_files

        read += [part for file in recordings for part in find_series_files(file).files]
    for output in named:
        refuse_unwritable(output, *read)
