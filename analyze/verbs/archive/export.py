"""`analyze archive export`: copy a part of the archive, with answers and checksums."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.verbs.archive.selection import with_selection
from analyze.verbs.options import one_line, results_folder_option
from schemas.plain_text import echo
from schemas.wording import counted

if TYPE_CHECKING:
    from analyze.catalogue.listing import Selection


@click.command()
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path, file_okay=False))
@results_folder_option
@with_selection
@one_line
def export(folder: Path, output: Path, selection: Selection) -> None:
    """Copy the selected recordings with their answers into FOLDER, an archive of its own.

    `sha256sum -c SHA256SUMS` checks it. Run it again to go on after an interruption.
    """
    from analyze.catalogue.export import RESULTS, SUMS, export_recordings
    from analyze.catalogue.index import MISSING
    from analyze.catalogue.listing import list_recordings
    from analyze.catalogue.table import read_catalogue
    from analyze.errors import ArchiveError
    from analyze.progress import ProgressBar

    listed = list_recordings(output, selection).to_pylist()
    urls = {row["url"] for row in listed if row["state"] != MISSING}
    if not urls:
        raise ArchiveError(f"{output}: no recording is selected: `analyze archive list` shows what there is")
    rows = [row for row in read_catalogue(output).to_pylist() if row["url"] in urls]
    with ProgressBar() as progress:
        keys = [row["key"] for row in listed if row["key"]]
        report = export_recordings(rows, keys, output, folder, progress)
    echo(
        f"{folder}: {counted(len(rows), 'recording')} ({report.size_bytes / 1e9:.2f} GB): "
        f"{counted(report.copied, 'file')} copied, {report.present} there already; "
        f"{counted(report.answers, 'answer')} in {folder / RESULTS}; checksums in {folder / SUMS}"
    )
