"""`analyze export`: an estimated body written as a simulator's file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import click

from analyze.errors import ExportError
from analyze.export.formats import Format, why_misnamed
from analyze.verbs.options import chosen_cache, files_argument, one_line, path_option, with_estimate_options
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.export.export_source import ExportInput

FOXGLOVE = "foxglove"
"""name of the layout among the formats; it has no body, which the others have"""


@click.command()
@files_argument
@with_estimate_options
@click.option(
    "--format",
    "wanted",
    type=click.Choice([*(each.value for each in Format), FOXGLOVE]),
    required=True,
    help="Format of the file. A scanned shape becomes a mesh file (.obj) beside it; USD contains the mesh. "
    "ros is a message geometry_msgs/InertiaStamped, without the shape; gazebo is a model folder; foxglove is "
    "a layout of panels that shows the recording.",
)
@path_option("-o", "--output", required=True, help="The file to write; with gazebo a folder.")
@click.option(
    "--measured-only",
    is_flag=True,
    help="Refuse values that come from the shape alone, and name the strikes that would measure them.",
)
@one_line
def export(
    files: Sequence[Path],
    wanted: str,
    output: Path,
    measured_only: bool,
    object_file: Path | None,
    exclude: tuple[str, ...],
    no_cache: bool,
) -> None:
    """Write the body for a simulator or ROS: shape, mass, centre of mass and inertia.

    Each file is read back and compared before it is put in place. A layout for Foxglove has no body: it is
    made for one recording, and not read back.

    FILE: recordings of one object, or the output of `analyze estimate --json` together with --object.
    """
    # The code's version is read before the code is loaded.
    cache = chosen_cache(no_cache)
    if wanted == FOXGLOVE:
        from analyze.export.foxglove import write_layout

        refuse_outputs([output], files)
        write_layout(files, output)
        echo(f"FOXGLOVE: {output}; import it in Foxglove's menu of layouts")
        return
    from analyze.export.export_source import is_result, read_export_input
    from analyze.export.gazebo import refuse_other_folder
    from analyze.export.measured_only import refuse_prior
    from analyze.export.read_back import refuse_without_reader
    from analyze.progress import ProgressBar

    kind = Format(wanted)
    if kind is Format.GAZEBO:
        refuse_other_folder(output)
    else:
        refuse_outputs([output], [] if is_result(files) else files, [*files, object_file])
    if (reason := why_misnamed(output, kind)) is not None:
        raise ExportError(reason)
    refuse_without_reader(kind)
    with ProgressBar() as progress:
        source = read_export_input(files, object_file, frozenset(exclude), progress, cache)
    name = ", ".join(map(str, files))
    if measured_only:
        refuse_prior(source.result, source.spec, source.model, name)
    _write(source, kind, output, name)


def _write(source: ExportInput, kind: Format, output: Path, name: str) -> None:
    """Write the body of a result, and print the file's name and what its numbers leave open.

    Args:
        source: result and object.
        kind: format of the file.
        output: file or folder to write.
        name: name of the input, for messages.

    Raises:
        ExportError: the result has no complete or possible body, or the file is read back differently.
        OutputError: the file cannot be written.
    """
    from analyze.export.contact import contact_notes
    from analyze.export.provenance import prior_entries
    from analyze.export.write import write_body
    from analyze.types import tensor_entry_name

    result = source.result
    body = source.body(kind, name)
    written = write_body(body, kind, output)
    marks = "" if output.suffix.lower() == ".json" else "; the file marks them"
    if not result.centre_of_mass.observed:
        echo(
            "note: the strikes do not determine the centre of mass in all directions"
            + ("; the file names the one missing" if marks else ""),
            err=True,
        )
    if prior := prior_entries(result):
        entries = ", ".join(map(tensor_entry_name, prior))
        echo(f"note: from the shape, not from strikes: {entries}{marks}", err=True)
    for note in contact_notes(body, result):
        echo(f"note: {note}", err=True)
    where = "in it" if kind is Format.GAZEBO else "beside it"
    beside = "".join(f", with {path.name} {where}" for path in written[1:])
    echo(f"{kind.value.upper()}: {written[0]}{beside}; read back: the same ten parameters")
