"""Options and decorators that several verbs (subcommands of `analyze`) share."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from analyze.errors import AnalyzeError
from schemas.command_line import one_line_errors

Options = TypeVar("Options")

one_line = one_line_errors("analyze", AnalyzeError)
files_argument = click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
results_folder_option = click.option(
    "--out",
    "output",
    type=click.Path(path_type=Path),
    default=Path("results"),
    show_default=True,
    help="Folder of the results.",
)
_estimate_options = [
    click.option(
        "--object",
        "object_file",
        type=click.Path(path_type=Path),
        help="Use this object file instead of the one in the recording.",
    ),
    click.option(
        "--exclude",
        multiple=True,
        metavar="STRIKE",
        help="Leave out a strike, by its id in the report; may be repeated.",
    ),
]


def with_estimate_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add --object and --exclude to a verb's click command, and return its function."""
    for option in reversed(_estimate_options):
        function = option(function)
    return function


def pass_options(kind: type[Options]) -> Callable[[Callable[[Options], None]], Callable[..., None]]:
    """Decorator of a verb with many options: passes all of them to its function as one value.

    Args:
        kind: a frozen dataclass with a field per parameter of the command line, of the same name.

    Returns:
        The decorator; it turns a function of one `kind` into a function of keyword arguments, as click calls
        it.
    """

    def decorate(verb: Callable[[Options], None]) -> Callable[..., None]:
        @wraps(verb)
        def call(**options: Any) -> None:
            verb(kind(**options))

        return call

    return decorate
