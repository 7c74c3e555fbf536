"""The command `analyze cards`: the placement cards of a plan as drawings, one file per strike and toss."""

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
    help="Folder for the drawings, STRIKE.svg or TOSS.svg each.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the drawings' names by strike or toss as JSON.")
@one_line
def cards(object_file: Path, plan: Path, output: Path, as_json: bool) -> None:
    """Draw how to place OBJECT (TOML) for each strike of PLAN (JSON), and to hold it for each toss.

    Each drawing is an SVG file.
    """
    from analyze.cards.drawn_shape import drawn_shape
    from analyze.cards.page import placement_cards
    from analyze.cards.toss_card import toss_cards
    from analyze.geometry.object_model import load_object_model
    from analyze.reading.object_file import read_object_files
    from schemas.strike_plan import read_strike_plan

    files = read_object_files(object_file)
    model = load_object_model(files.spec, files.shape_bytes, files.shape_name)
    output.mkdir(parents=True, exist_ok=True)
    written: dict[str, str] = {}
    planned = read_strike_plan(plan)
    for card in placement_cards(planned, model, files.spec):
        # Ids of strikes are made by `analyze plan`; a name that is none of its own is numbered.
        name = f"{card.strike.id}.svg" if card.strike.id.isalnum() else f"card-{card.number}.svg"
        (output / name).write_text(str(card.scene), encoding="utf-8")
        written[card.strike.id] = name
    for card in toss_cards(planned, model, drawn_shape(model), files.spec, by_hand=False):
        name = f"{card.toss.id}.svg" if card.toss.id.isalnum() else f"toss-{card.number}.svg"
        (output / name).write_text(str(card.hold), encoding="utf-8")
        written[card.toss.id] = name
    echo(json.dumps(written) if as_json else f"{len(written)} drawings in {output}")
