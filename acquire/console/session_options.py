"""Options of commands that run a session which may stop itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import click

from acquire.session.adaptive import DEFAULT_MAX_STRIKES, Target

F = TypeVar("F", bound=Callable[..., Any])


def target_options(command: F) -> F:
    """Decorate a command with --until and --max-strikes; `target_of` makes a target of them."""
    until = click.option(
        "--until",
        help='Stop when the answer is as certain as this: "com=0.5mm", "inertia=2%", or both with a comma.',
    )
    most = click.option(
        "--max-strikes",
        type=click.IntRange(1),
        help=f"With --until: largest number of strikes.  [default: {DEFAULT_MAX_STRIKES}]",
    )
    return until(most(command))


def target_of(until: str | None, max_strikes: int | None) -> Target | None:
    """Target of a session by its options; None for a session that makes every planned strike.

    Raises:
        click.UsageError: --max-strikes is given without --until.
        SessionError: --until is no target.
    """
    if until is None:
        if max_strikes is not None:
            raise click.UsageError("--max-strikes needs --until: without it every planned strike is made")
        return None
    return Target.parse(until, max_strikes or DEFAULT_MAX_STRIKES)
