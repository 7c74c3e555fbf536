"""`analyze export`: an estimated body written as a simulator's file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click

from analyze.errors import ExportError
from analyze.export.formats import Format, why_misnamed
from analyze.verbs.options import chosen_cache, files_argument, one_line, path_option, with_estimate_options
from analyze.verbs.outputs import refuse_outputs


@click.command()
@files_argument
@with_estimate_options
@click.option(
    "--format",
    "wanted",
    type=click.Choice([each.value for each in Format]),
    required=True,
    help="Format of the file. A scanned shape becomes a mesh file (.obj) beside it; USD contains the mesh.",
)
@path_option("-o", "--output", required=True, help="The file to write.")
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
    """Write the body for a simulator: shape, mass, centre of mass and inertia.

    Each file is read back and compared before it is put in place.

    FILE: recordings of one object, or the output of `analyze estimate --json` together with --object.
    """
    # The code's version is read before the code is loaded.
    cache = chosen_cache(no_cache)
    from analyze.export.body import ExportBody, inertial_of
    from analyze.export.export_source import is_result, read_export_input
    from analyze.export.measured_only import refuse_prior
    from analyze.export.provenance import prior_entries, provenance
    from analyze.export.read_back import refuse_without_reader
    from analyze.export.write import write_body
    from analyze.progress import ProgressBar
    from analyze.types import tensor_entry_name
    from schemas.software import software_version

    kind = Format(wanted)
    refuse_outputs([output], [] if is_result(files) else files, [*files, object_file])
    if (reason := why_misnamed(output, kind)) is not None:
        raise ExportError(reason)
    refuse_without_reader(kind)
    with ProgressBar() as progress:
        source = read_export_input(files, object_file, frozenset(exclude), progress, cache)
    name = ", ".join(map(str, files))
    if measured_only:
        refuse_prior(source.result, source.spec, source.model, name)
    inertial = inertial_of(source.result, name)
    origin = provenance(source.result, source.spec.name, software_version())
    written = write_body(ExportBody(source.spec.name, source.model, inertial, origin), kind, output)
    if not source.result.centre_of_mass.observed:
        click.echo(
            "note: the strikes do not determine the centre of mass in all directions; the file names the "
            "one missing",
            err=True,
        )
    if prior := prior_entries(source.result):
        entries = ", ".join(map(tensor_entry_name, prior))
        click.echo(f"note: from the shape, not from strikes: {entries}; the file marks them", err=True)
    beside = "".join(f", with {path.name} beside it" for path in written[1:])
    click.echo(f"{kind.value.upper()}: {written[0]}{beside}; read back: the same ten parameters")
