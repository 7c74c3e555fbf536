"""Markdown tables of every command's options, read from the commands themselves."""

from __future__ import annotations

from collections.abc import Iterator

import click
from drawing import escaped


def commands() -> Iterator[tuple[str, click.Command]]:
    """Yield each command, without groups and hidden ones, after its full name, as `analyze plan`."""
    from acquire.cli import main as acquire
    from analyze.cli import main as analyze

    waiting: list[tuple[str, click.Command]] = [("acquire", acquire), ("analyze", analyze)]
    while waiting:
        name, command = waiting.pop(0)
        if isinstance(command, click.Group):
            context = click.Context(command)
            found = [
                (f"{name} {verb}", command.get_command(context, verb))
                for verb in command.list_commands(context)
            ]
            waiting = [(verb, one) for verb, one in found if one is not None and not one.hidden] + waiting
        else:
            yield name, command


def _options(command: click.Command, context: click.Context) -> Iterator[str]:
    """Yield a Markdown table row (name, help text) for each option of a command but --help."""
    options = (one for one in command.get_params(context) if isinstance(one, click.Option))
    for parameter in options:
        record = parameter.get_help_record(context)
        if record is not None and "--help" not in parameter.opts:
            # Click puts the default and the range in double spaces behind the text.
            yield f"| `{record[0].replace('|', chr(92) + '|')}` | {escaped(' '.join(record[1].split()))} |"


def option_tables() -> str:
    """Markdown text with a section for each command: usage line, help text, table of options."""
    sections = []
    for name, command in commands():
        context = click.Context(command, info_name=name)
        usage = " ".join(command.collect_usage_pieces(context))
        rows = list(_options(command, context))
        table = "\n| | |\n|---|---|\n" + "\n".join(rows) + "\n" if rows else ""
        text = escaped(" ".join((command.help or "").split("\f")[0].split()))
        sections.append(f"## {name}\n\n```text\n{name} {usage}\n```\n\n{text}\n{table}")
    return "\n".join(sections)
