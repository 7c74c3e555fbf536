"""An object's shape: `analyze parts`."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.verbs.options import one_line


@click.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@one_line
def parts(object_file: Path, as_json: bool) -> None:
    """The closed bodies in an object's mesh, with the numbers by which its labels name them."""
    from analyze.verbs.parts_table import bodies_in, bodies_json, render_bodies

    files, bodies = bodies_in(object_file)
    if as_json:
        click.echo(json.dumps(bodies_json(files, bodies), allow_nan=False))
    else:
        render_bodies(files, bodies)
