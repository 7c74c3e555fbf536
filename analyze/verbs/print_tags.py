"""`analyze print-tags`."""

from __future__ import annotations

from pathlib import Path

import click

from analyze.verbs.options import one_line


@click.command("print-tags")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The PDF to write.")
@click.option("--object", "object_file", type=click.Path(path_type=Path), help="Take family, ids and sizes from this object file.")
@click.option("--ids", help="Which tags: 0-11, or 0,3,7.  [default: 0-11]")
@click.option("--size-mm", type=float, help="Edge of the black square.  [default: 30]")
@click.option("--family", help="Tag family, as 25h9 or 4x4_100.  [default: 36h11; of a board 5x5_100]")
@click.option("--board", type=click.Choice(["charuco"]), help="Instead: a board to calibrate a camera with.")
@click.option("--squares", metavar="CxR", help="Of the board: columns x rows.  [default: 7x9]")
@click.option("--square-mm", type=float, help="Of the board: edge of a square.  [default: 22]")
@click.option("--paper", default="A4", show_default=True, help="A4 or Letter.")
@one_line
def print_tags(
    output: Path,
    object_file: Path | None,
    ids: str | None,
    size_mm: float | None,
    family: str | None,
    board: str | None,
    squares: str | None,
    square_mm: float | None,
    paper: str,
) -> None:
    """Tags, or a ChArUco board, as PDF to scale, with rulers to check the print."""
    from analyze.output_file import refuse_unwritable
    from analyze.tags import printing

    if object_file is not None and any(given is not None for given in (ids, size_mm, family, board)):
        raise click.UsageError("--object says which tags and how large: leave --ids, --size-mm, --family and --board out")
    if board is not None and (ids is not None or size_mm is not None):
        raise click.UsageError("a board has tags of its own: leave --ids and --size-mm out (--squares and --square-mm say how large it is)")
    if board is None and (squares is not None or square_mm is not None):
        raise click.UsageError("--squares and --square-mm are of a board: add --board charuco")
    refuse_unwritable(output, *([] if object_file is None else [object_file]))
    if board is not None:
        plain = printing.BoardOptions()
        asked = printing.BoardOptions(family, squares or plain.squares, plain.square_mm if square_mm is None else square_mm, None, paper)
        click.echo(printing.print_board(asked, output))
    else:
        click.echo(printing.print_tags(printing.PrintOptions(family, ids, size_mm, object_file, paper), output))
