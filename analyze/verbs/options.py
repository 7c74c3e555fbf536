"""Options and decorators that several verbs (subcommands of `analyze`) share."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from analyze.errors import AnalyzeError
from schemas.command_line import one_line_errors
from schemas.plain_text import echo

if TYPE_CHECKING:
    from analyze.cache.results import ResultCache

Options = TypeVar("Options")
Command = Callable[..., Any]

path_option = partial(click.option, type=click.Path(path_type=Path))
"""`click.option` whose value is a path"""
one_line = one_line_errors("analyze", AnalyzeError)
"""decorator of a verb that reports an `AnalyzeError` as one line on standard error, with its exit code"""
files_argument = click.argument(
    "files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path)
)
force_option = click.option("--force", is_flag=True, help="Replace the output if it exists.")
results_folder_option = path_option(
    "--out", "output", default=Path("results"), show_default=True, help="Folder of the results."
)


def with_options(*options: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Decorator that adds options to a click command; its help lists them in the given order.

    Args:
        options: decorators, as `click.option` returns them.
    """

    def decorate(command: Command) -> Command:
        return reduce(lambda decorated, option: option(decorated), reversed(options), command)

    return decorate


with_strike_options = with_options(
    path_option("--object", "object_file", help="Use this object file instead of the one in the recording."),
    click.option(
        "--exclude",
        multiple=True,
        metavar="STRIKE",
        help="Leave out a strike or toss, by its id in the report; may be repeated.",
    ),
)
"""decorator that adds --object and --exclude to a verb's click command"""
with_estimate_options = with_options(
    with_strike_options,
    click.option(
        "--no-cache", is_flag=True, help="Compute all anew; neither use nor keep results of other commands."
    ),
)
"""decorator that adds --object, --exclude and --no-cache to a verb's click command"""


def chosen_cache(no_cache: bool) -> ResultCache | None:
    """Cache of the user's folder, which reports damaged entries on standard error.

    None with `no_cache`, the value of --no-cache, or if the user switched the cache off.
    """
    if no_cache:
        return None
    from analyze.cache.results import user_cache

    return user_cache(lambda text: echo(f"analyze: {text}", err=True))


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
