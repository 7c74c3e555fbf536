"""Early check of the files that a verb (subcommand of `analyze`) is to write, before its computation."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path


def refuse_outputs(
    outputs: Iterable[Path | None],
    recordings: Sequence[Path] = (),
    inputs: Sequence[Path | None] = (),
    *,
    force: bool | None = None,
) -> None:
    """Refuse outputs that cannot be written, or would replace a file that is read or kept.

    Kept are recordings and settings files (`KEPT_SUFFIXES`); all others are replaced.

    Args:
        outputs: files to write; entries that are None are skipped.
        recordings: recordings that are read; all files of each one's series count.
        inputs: other files that are read; entries that are None are skipped.
        force: value of the verb's option --force, which replaces kept files too; None if it has none.

    Raises:
        OutputError: an output cannot be written, is one of the files that are read, or is kept.
    """
    from schemas.output_file import KEPT_SUFFIXES, OutputError, refuse_unwritable, why_taken

    named = [output for output in outputs if output is not None]
    read = [path for path in inputs if path is not None]
    if named and recordings:
        from analyze.reading.file_series import find_series_files

        read += [part for file in recordings for part in find_series_files(file).files]
    for output in named:
        refuse_unwritable(output, *read)
        if output.suffix.lower() in KEPT_SUFFIXES and (reason := why_taken(output, force=force)) is not None:
            raise OutputError(reason)
