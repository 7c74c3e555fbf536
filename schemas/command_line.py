"""What both commands promise to scripts: a problem is one line on standard error that begins with the command's name, and an exit code.

0 done, 1 a named problem, 2 wrong usage (click's), 3 ended early or with loss, 130 interrupted.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from functools import wraps
from typing import Any, NoReturn, ParamSpec, TypeVar

import click

from schemas.documents import DocumentError

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


def one_line_errors(command: str, *problems: type[Exception]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorator of a verb: `problems`, documents that cannot be used and what the operating system refuses become one line.

    Args:
        command: acquire or analyze; the line begins with it.
        problems: what the package raises on purpose, each with a message that names the thing and the remedy.
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
                end(PROBLEM, str(error))
            except BrokenPipeError:  # whoever read our output has left
                end(PROBLEM)
            except OSError as error:
                where = f"{error.filename}: " if error.filename else ""
                end(PROBLEM, f"{where}{error.strerror or error}: check disk and permissions")
            except KeyboardInterrupt:
                end(INTERRUPTED, "interrupted")

        return wrapped

    return decorate
