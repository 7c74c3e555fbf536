"""Command-line conventions of `acquire` and `analyze`: errors in one line, and exit codes.

A problem is written to standard error as one line that begins with the command's name; notes on it follow,
one line each. Exit codes: 0 done, 1 a named problem, 2 wrong usage, 3 ended early or with loss, 130
interrupted.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from importlib.metadata import version
from typing import IO, Any, NoReturn, ParamSpec, TypeVar

import click

from schemas.document import DocumentError
from schemas.output_file import OutputError
from schemas.plain_text import visible, write_escaped
from schemas.software import software_commit

P = ParamSpec("P")
R = TypeVar("R")

PROBLEM, LOSS, INTERRUPTED = 1, 3, 130
"""Exit codes: a named problem; ended early or with loss; interrupted by Ctrl-C."""


class NumberRange(click.FloatRange):
    """Type of a click option: a number within limits; it refuses `nan`, which click's own range accepts."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Convert the text of a command-line value to a number and check it against the limits.

        Returns:
            The number.

        Raises:
            click.BadParameter: the value is not a number, is `nan`, or is outside the limits.
        """
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value} is not a number.", param, ctx)
        return number


def version_option(command: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a command that adds `--version`, which prints command, product, version and git commit.

    Args:
        command: "acquire" or "analyze".
    """

    def show(ctx: click.Context, _: click.Parameter, asked: bool) -> None:
        if not asked or ctx.resilient_parsing:
            return
        click.echo(f"{command} (Percuss) {version('percuss')}, commit {software_commit() or 'unknown'}")
        ctx.exit()

    return click.option(
        "--version",
        is_flag=True,
        expose_value=False,
        is_eager=True,
        callback=show,
        help="Show the version and exit.",
    )


class WrongUsage(click.UsageError):
    """Wrong usage as one line: the mistake, and the --help to read. Click's own message has four lines.

    Args:
        command: "acquire" or "analyze", with which the line begins.
        error: click's own error.
    """

    def __init__(self, command: str, error: click.UsageError) -> None:
        mistake = " ".join(error.format_message().split()).removesuffix(".")
        super().__init__(f"{command}: {mistake} (see {_invoked_verb(command, error.ctx)} --help)", error.ctx)

    def show(self, file: IO[Any] | None = None) -> None:
        """Write the one-line message to `file`, or to standard error if `file` is None."""
        click.echo(visible(self.message), file=file, err=file is None)


def _invoked_verb(command: str, ctx: click.Context | None) -> str:
    """Command and verbs as the user typed them, for example "acquire check"; for error messages.

    Click's context names the program after the way it was started (`python -m analyze`); `command` replaces
    that name.
    """
    verbs: list[str] = []
    while ctx is not None and ctx.parent is not None:
        verbs.insert(0, ctx.info_name or "")
        ctx = ctx.parent
    return " ".join([command, *verbs])


class CommandGroup(click.Group):
    """Click group whose help shows the whole first sentence of each command; click cuts it with "..."."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands with their first sentences, wrapped, into the help text."""
        rows = [
            (name, command.get_short_help_str(limit=sys.maxsize))
            for name in self.list_commands(ctx)
            if (command := self.get_command(ctx, name)) is not None and not command.hidden
        ]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


class Commands(CommandGroup):
    """Click group of the verbs of `acquire` or `analyze` that reports wrong usage in one line.

    The group's name is the command's ("acquire" or "analyze").
    """

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        """Parse the command line's arguments and return click's context, which holds their values.

        Raises:
            WrongUsage: the arguments are wrong; the message is one line.
        """
        write_escaped(sys.stdout, sys.stderr)
        with self._one_line_usage():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """Invoke the verb of a parsed command line and return its result.

        Raises:
            WrongUsage: the verb's arguments are wrong; the message is one line.
        """
        with self._one_line_usage():
            return super().invoke(ctx)

    @contextmanager
    def _one_line_usage(self) -> Iterator[None]:
        try:
            yield
        except (click.exceptions.NoArgsIsHelpError, WrongUsage):
            raise
        except click.UsageError as error:
            raise WrongUsage(self.name or "", error) from None


def one_line_errors(command: str, *problems: type[Exception]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a verb that reports expected errors in one line on standard error and exits.

    The exit code is 1 for `problems`, unusable documents, unwritable output files and errors of the operating
    system, and 130 for Ctrl-C. If the reader of the verb's output has closed its pipe, the verb exits with 1
    without a message.

    Args:
        command: "acquire" or "analyze", with which the line begins.
        problems: errors that the package raises on purpose. Their message names the thing and the remedy;
            their notes follow, one line each.

    Returns:
        The decorator; a decorated verb raises SystemExit in place of these errors.
    """

    def end(code: int, line: str = "") -> NoReturn:
        if line:
            sys.stderr.write(f"{command}: {visible(line)}\n")
        sys.exit(code)

    def decorate(verb: Callable[P, R]) -> Callable[P, R]:
        @wraps(verb)
        def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return verb(*args, **kwargs)
            except (*problems, DocumentError, OutputError) as error:
                notes = "".join(f"\nnote: {note}" for note in getattr(error, "__notes__", ()))
                end(PROBLEM, f"{error}{notes}")
            except BrokenPipeError:  # the reader of our output has closed it
                end(PROBLEM)
            except OSError as error:
                where = f"{error.filename}: " if error.filename else ""
                reason = error.strerror or " ".join(str(error).split())
                end(PROBLEM, f"{where}{reason}: check disk and permissions")
            except (KeyboardInterrupt, click.Abort):  # click.Abort: Ctrl-C at a prompt
                end(INTERRUPTED, "interrupted")

        return wrapped

    return decorate
