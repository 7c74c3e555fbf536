"""Steps of the catalogue's tests: index, scrub, list, and run the command."""

from __future__ import annotations

from pathlib import Path

from click.testing import CliRunner

from analyze.batch.archive import find_sources
from analyze.catalogue.index import update_index
from analyze.catalogue.listing import Selection, list_recordings
from analyze.catalogue.scrub import scrub
from analyze.catalogue.table import open_catalogue, read_catalogue
from analyze.cli import main

NUMBERS = range(4)
"""quick sessions: of objects of three kinds, on the first four days of 2026"""


def index(place, output, **options):
    with open_catalogue(output, create=True) as catalogue:
        return update_index(catalogue, find_sources([str(place)]), [str(place)], **options)


def rows_of(output):
    return {Path(row["url"]).name: row for row in read_catalogue(output).to_pylist()}


def names(output, **conditions):
    found = list_recordings(output, Selection(**conditions))
    return [Path(url).name for url in found.column("url").to_pylist()]


def scrubbed(output, **options):
    with open_catalogue(output) as catalogue:
        return scrub(catalogue, sorted(catalogue.rows), output, **options)


def run(*arguments):
    return CliRunner().invoke(main, ["archive", *map(str, arguments)])
