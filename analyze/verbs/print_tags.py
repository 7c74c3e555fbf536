"""`analyze print-tags`: tags, or a board to calibrate a camera with, as a PDF to scale."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from analyze.verbs.options import one_line, pass_options, path_option
from analyze.verbs.outputs import refuse_outputs
from schemas.plain_text import echo


@dataclass(frozen=True)
class _PrintTagsOptions:
    """Values of the options of `analyze print-tags`."""

    output: Path
    """PDF to write"""
    object_file: Path | None
    """object file that sets family, ids and sizes of the tags; None if there is none"""
    ids: str | None
    """tags to print, as text such as 0-11 or 0,3,7; None for the default"""
    size_mm: float | None
    """edge of a tag's black square [mm]; None for the default"""
    family: str | None
    """tag family; None for the default"""
    board: str | None
    """"charuco" to print a calibration board, None to print tags"""
    squares: str | None
    """squares of the board, columns x rows, as text such as "7x9"; None for the default"""
    square_mm: float | None
    """edge of a square of the board [mm]; None for the default"""
    paper: str
    """A4 or Letter; for the mat A4, A3 or A4x3"""
    mat: bool
    """True to print the mat, instead of tags"""


@click.command("print-tags")
@path_option("-o", "--output", required=True, help="The PDF to write.")
@path_option("--object", "object_file", help="Take family, ids and sizes of the tags from this object file.")
@click.option("--ids", help="Tags to print: 0-11, or 0,3,7.  [default: 0-11]")
@click.option("--size-mm", type=float, help="Edge of a tag's black square in mm.  [default: 30]")
@click.option("--family", help="Tag family, such as 25h9 or 4x4_100.  [default: 36h11; for a board 5x5_100]")
@click.option(
    "--board",
    type=click.Choice(["charuco"]),
    help="Print a board to calibrate a camera with, instead of tags.",
)
@click.option("--squares", metavar="CxR", help="With --board: columns x rows.  [default: 7x9]")
@click.option("--square-mm", type=float, help="With --board: edge of a square in mm.  [default: 22]")
@click.option(
    "--paper",
    default="A4",
    show_default=True,
    help="A4 or Letter; with --mat A4, A3, or A4x3: three sheets A4 side by side.",
)
@click.option(
    "--mat",
    is_flag=True,
    help="Print the mat on which the object stands, with tags that show the camera's pose, instead of tags.",
)
@one_line
@pass_options(_PrintTagsOptions)
def print_tags(options: _PrintTagsOptions) -> None:
    """Print tags, a ChArUco board or the mat, as a PDF to scale, with rulers to check the print."""
    from analyze.tags import printing

    _refuse_contradictions(options)
    refuse_outputs([options.output], inputs=[options.object_file])
    if options.mat:
        echo(printing.print_mat(options.paper, options.output))
    elif options.board is not None:
        default = printing.BoardOptions()
        board = printing.BoardOptions(
            options.family,
            options.squares or default.squares,
            default.square_mm if options.square_mm is None else options.square_mm,
            None,
            options.paper,
        )
        echo(printing.print_board(board, options.output))
    else:
        tags = printing.PrintOptions(
            options.family, options.ids, options.size_mm, options.object_file, options.paper
        )
        echo(printing.print_tags(tags, options.output))


def _refuse_contradictions(options: _PrintTagsOptions) -> None:
    """Refuse options of tags, of an object file, of a board and of the mat that do not go together.

    `--mat` excludes all others except `--paper`. `--object` excludes `--ids`, `--size-mm`, `--family` and
    `--board`; `--board` excludes `--ids` and `--size-mm`; `--squares` and `--square-mm` need `--board`.

    Raises:
        click.UsageError: one of these rules is broken.
    """
    of_tags = (options.ids, options.size_mm)
    of_mat = (options.object_file, options.family, options.board, options.squares, options.square_mm)
    if options.mat and any(given is not None for given in (*of_tags, *of_mat)):
        raise click.UsageError("the mat has tags of its own: of all options give only --paper with --mat")
    if options.object_file is not None and any(
        given is not None for given in (*of_tags, options.family, options.board)
    ):
        raise click.UsageError(
            "--object sets which tags to print and their size: leave --ids, --size-mm, --family and --board "
            "out"
        )
    if options.board is not None and any(given is not None for given in of_tags):
        raise click.UsageError(
            "a board has tags of its own: leave --ids and --size-mm out (--squares and --square-mm set its "
            "size)"
        )
    if options.board is None and (options.squares is not None or options.square_mm is not None):
        raise click.UsageError("--squares and --square-mm need --board charuco: add it")
