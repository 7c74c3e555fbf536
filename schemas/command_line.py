"""What both commands promise to scripts: a problem is one line on standard error that begins with the command's name, and an exit code.

0 done, 1 a named problem, 2 wrong usage, 3 ended early or with loss, 130 interrupted.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import IO, Any, NoReturn, ParamSpec, TypeVar

import click

from schemas.document import DocumentError

P = ParamSpec("P")
R = TypeVar("R")

PROBLEM, LOSS, INTERRUPTED = 1, 3, 130
"""exit codes"""


class NumberRange(click.FloatRange):
    """A range of numbers; click's own takes `nan`, which is neither below nor above anything."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"{value} is no number.", param, ctx)
        return number


class WrongUsage(click.UsageError):
    """Wrong usage, told in one line: what is wrong, and the help that says how it is right. Click's own tells it in four."""

    def __init__(self, command: str, error: click.UsageError) -> None:
        what = " ".join(error.format_message().split()).removesuffix(".")
        super().__init__(f"{command}: {what} (see {_asked(command, error.ctx)} --help)", error.ctx)

    def show(self, file: IO[Any] | None = None) -> None:
        """Write the line."""
        click.echo(self.message, file=file, err=file is None)


def _asked(command: str, ctx: click.Context | None) -> str:
    """The verb that was called, however the program was started (`python -m analyze`)."""
    verbs: list[str] = []
    while ctx is not None and ctx.parent is not None:
        verbs.insert(0, ctx.info_name or "")
        ctx = ctx.parent
    return " ".join([command, *verbs])


class Commands(click.Group):
    """The verbs of a command that is called as the group is named."""

    def make_context(self, *args: Any, **kwargs: Any) -> click.Context:
        """As click does; wrong usage becomes one line."""
        with self._in_one_line():
            return super().make_context(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """As click does; wrong usage becomes one line."""
        with self._in_one_line():
            return super().invoke(ctx)

    @contextmanager
    def _in_one_line(self) -> Iterator[None]:
        try:
            yield
        except (click.exceptions.NoArgsIsHelpError, WrongUsage):
            raise
        except click.UsageError as error:
            raise WrongUsage(self.name or "", error) from None


def one_line_errors(command: str, *problems: type[Exception]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a verb: `problems`, documents that cannot be used and what the operating system refuses become one line.

    Args:
        command: acquire or analyze; the line begins with it.
        problems: what the package raises on purpose, each with a message that names the thing and the remedy; its notes follow, a line
            each.
    """

    def end(code: int, line: str = "") -> NoReturn:
        if line:
            sys.stderr.write(f"{command}: {line}\n")
        sys.exit(code)

    def decorate(verb: Callable[P, R]) -> Callable[P, R]:
        @wraps(verb)
        def wrapped(*args: P.args, **kwargs: P.kwargs) -> R:
            try:
                return verb(*args, **kwargs)
            except (*problems, DocumentError) as error:
                notes = "".join(f"\nnote: {note}" for note in getattr(error, "__notes__", ()))
                end(PROBLEM, f"{error}{notes}")
            except BrokenPipeError:  # whoever read our output has left
                end(PROBLEM)
            except OSError as error:
                where = f"{error.filename}: " if error.filename else ""
                end(PROBLEM, f"{where}{error.strerror or error}: check disk and permissions")
            except (KeyboardInterrupt, click.Abort):  # click's: at a question
                end(INTERRUPTED, "interrupted")

        return wrapped

    return decorate
