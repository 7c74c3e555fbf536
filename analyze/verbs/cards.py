"""The command `analyze cards`: the placement cards of a plan as drawings, one file per strike."""

from __future__ import annotations

import json
from pathlib import Path

import click

from analyze.verbs.options import one_line
from schemas.plain_text import echo


@click.command()
@click.argument("object_file", metavar="OBJECT", type=click.Path(path_type=Path))
@click.argument("plan", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    required=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the drawings, STRIKE.svg each.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the drawings' names by strike as JSON.")
@one_line
def cards(object_file: Path, plan: Path, output: Path, as_json: bool) -> None:
    """Draw how to place OBJECT (TOML) for each strike of PLAN (JSON), one SVG file per strike."""
    from analyze.cards.page import placement_cards
    from analyze.geometry.object_model import load_object_model
    from analyze.reading.object_file import read_object_files
    from schemas.strike_plan import read_strike_plan

    files = read_object_files(object_file)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    output.mkdir(parents=True, exist_ok=True)
    written: dict[str, str] = {}
    for card in placement_cards(read_strike_plan(plan), model, files.spec):
        # Ids of strikes are made by `analyze plan`; a name that is none of its own is numbered.
        name = f"{card.strike.id}.svg" if card.strike.id.isalnum() else f"card-{card.number}.svg"
        (output / name).write_text(str(card.scene), encoding="utf-8")
        written[card.strike.id] = name
    echo(json.dumps(written) if as_json else f"{len(written)} drawings in {output}")
