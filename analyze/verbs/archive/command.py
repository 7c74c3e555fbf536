"""`analyze archive`: the group of its subcommands."""

from __future__ import annotations

import click

from analyze.verbs.archive.copies import duplicates, superseded
from analyze.verbs.archive.export import export
from analyze.verbs.archive.index import index
from analyze.verbs.archive.list_ import list_
from analyze.verbs.archive.object_sessions import object_
from analyze.verbs.archive.scrub import scrub
from schemas.command_line import CommandGroup


@click.group(cls=CommandGroup)
def archive() -> None:
    """Know an archive: list, search and scrub its recordings, find copies, export a part."""


for _verb in (index, list_, scrub, duplicates, superseded, export, object_):
    archive.add_command(_verb)
