"""Tables of `make bench-honesty`: coverage and width by disturbance, and the confusion of the verdict."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from tests.benchmarks.honesty.scores import SIGMAS, Score, SessionScore
from tests.benchmarks.honesty.verdicts import STATUSES

GROUPS = (
    "c (mm)",
    "c open (mm)",
    "phi good (deg)",
    "phi back (deg)",
    "k good (%)",
    "k back (%)",
    "I_edge (%)",
    "I_c (%)",
    "I diag (%)",
    "I prod (%)",
    "I prior (%)",
    "regions (%)",
    "unexplained (%)",
    "limits (%)",
    "wall (mm)",
    "parts (%)",
)
FAR = 2.0
"""half widths from the interval's middle, beyond which a trusted quantity is grossly wrong"""
LISTED = 10

ScoreOf = tuple[str, Score]
"""specimen (body and seed) to which a score belongs, and the score"""


def print_tables(console: Console, sessions: Sequence[SessionScore]) -> None:
    """Print all tables of the sessions."""
    answered = [session for session in sessions if not session.refusal and not session.crash]
    console.print(
        f"{len(sessions)} sessions, {len(answered)} answered; "
        f"{np.mean([session.seconds for session in sessions]):.2f} s each"
    )
    coverage = "share of 95 % intervals that hold (%) ± 1 sd by specimen, rms error over stated sd"
    console.print(_by(answered, lambda each: each.disturbance, f"{coverage}, by disturbance", _coverage))
    console.print(_by(answered, lambda each: each.disturbance, "median half width of the intervals", _width))
    undisturbed = [session for session in answered if session.disturbance == "none"]
    if undisturbed:
        console.print(
            _by(undisturbed, lambda each: each.body, f"{coverage}, undisturbed, by body", _coverage)
        )
    console.print(_by(answered, lambda each: each.body, f"{coverage}, all disturbances, by body", _coverage))
    console.print(_confusion(answered))
    _print_worst(console, answered)
    console.print(_alarms(sessions))
    _print_bad(console, sessions)


def _by(
    sessions: Iterable[SessionScore],
    key: Callable[[SessionScore], str],
    title: str,
    cell: Callable[[list[ScoreOf]], str],
) -> Table:
    """Table with one row per `key` and one column per group of quantities."""
    rows: dict[str, dict[str, list[ScoreOf]]] = defaultdict(lambda: defaultdict(list))
    for session in sessions:
        for score in session.scores:
            rows[key(session)][score.quantity].append((f"{session.body}:{session.seed}", score))
    groups = [group for group in GROUPS if any(group in row for row in rows.values())]
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("", no_wrap=True, min_width=17)
    for group in groups:
        table.add_column(group.replace(" (", "\n("), justify="right", no_wrap=True)
    for name, row in rows.items():
        table.add_row(name, *[cell(row[group]) if group in row else "" for group in groups])
    return table


def _coverage(scored: list[ScoreOf]) -> str:
    """Share that holds [%] with its standard deviation, and rms of error over sd.

    Intervals of one specimen are not independent: its disturbances share its bevels, tags and motions. The
    deviation is that of a mean over clusters (Liang and Zeger, 1986); where all hold or none, or there is one
    specimen, it is half of one specimen's share.
    """
    scores = [score for _, score in scored]
    held = np.array([score.holds for score in scores], dtype=float)
    share = float(held.mean())
    sums: dict[str, float] = defaultdict(float)
    for (specimen, _), off in zip(scored, held - share, strict=True):
        sums[specimen] += float(off)
    number = len(sums)
    spread = math.sqrt(sum(each * each for each in sums.values()) * number / max(number - 1, 1)) / len(scores)
    spread = max(spread, 0.5 / number if share in {0.0, 1.0} or number == 1 else 0.0)
    sds = np.array([max(score.half / SIGMAS, 1e-12) for score in scores])
    errors = np.array([score.value - score.truth for score in scores])
    ratio = min(float(np.sqrt(np.mean((errors / sds) ** 2))), 99)
    return f"{100 * share:.0f}±{100 * spread:.0f} {ratio:.{1 if ratio < 9.95 else 0}f}"


def _width(scored: list[ScoreOf]) -> str:
    return f"{np.median([score.half for _, score in scored]):.2g}"


def _subject(score: Score) -> str | None:
    """Subject of the verdict to which a score belongs; None if the verdict does not concern it."""
    if score.quantity.startswith("c"):
        return "centre of mass"
    if score.quantity.startswith(("I diag", "I prod", "I prior")):
        return "tensor"
    if score.quantity.startswith(("regions", "unexplained")):
        return "regions"
    return "parts" if score.quantity.startswith("parts") else None


def _confusion(sessions: Iterable[SessionScore]) -> Table:
    """Table of what the verdict says against what holds."""
    found: dict[tuple[str, str], list[Score]] = defaultdict(list)
    for session in sessions:
        for score in session.scores:
            if (subject := _subject(score)) is not None:
                found[subject, score.status].append(score)
                found["all", score.status].append(score)
    table = Table(title="the verdict: what it says, and what holds", title_justify="left", box=SIMPLE_HEAD)
    for heading in ("", "said", "number", "inside (%)", "within 2 half widths (%)", "beyond 2"):
        table.add_column(heading, justify="left" if heading in {"", "said"} else "right")
    for subject in ("centre of mass", "tensor", "regions", "parts", "all"):
        for status in STATUSES:
            scores = found.get((subject, status), [])
            if scores:
                near = [score.half_widths_off <= FAR for score in scores]
                inside = 100 * np.mean([score.holds for score in scores])
                numbers = (f"{inside:.1f}", f"{100 * np.mean(near):.1f}", str(near.count(False)))
                table.add_row(subject, status, str(len(scores)), *numbers)
    return table


def _print_worst(console: Console, sessions: Iterable[SessionScore]) -> None:
    """List the trusted quantities farthest outside, one per session, with the cell that repeats each."""
    worst: list[tuple[float, SessionScore, Score]] = []
    for session in sessions:
        trusted = [score for score in session.scores if score.status == "trust"]
        if trusted:
            score = max(trusted, key=lambda each: each.half_widths_off)
            if score.half_widths_off > FAR:
                worst.append((score.half_widths_off, session, score))
    console.print(f"sessions with a trusted quantity beyond {FAR:g} half widths: {len(worst)}")
    for off, session, score in sorted(worst, key=lambda each: -each[0])[:LISTED]:
        console.print(
            f"  {session.cell}  {score.name}: {score.value:.3g} ± {score.half:.2g}, true {score.truth:.3g} "
            f"{score.quantity.partition('(')[2].rstrip(')')}: {off:.1f} half widths"
        )


def _alarms(sessions: Sequence[SessionScore]) -> Table:
    """Table of refusals, wrong lines, false doubts and strikes to repeat, by disturbance.

    Also of strikes recorded under another strike's name: how many were recognised by their placement, and how
    many under their own name were taken for misplaced.
    """
    table = Table(title="alarms and misses", title_justify="left", box=SIMPLE_HEAD)
    headings = ("sessions", "refused", "crashed", "strikes", "over another line", "good for a wrong line")
    headings += ("mislabelled", "recognised", "misplaced falsely")
    table.add_column("")
    for heading in (*headings, "sessions with false doubts", "strikes to repeat"):
        table.add_column(heading, justify="right")
    names = list(dict.fromkeys(session.disturbance for session in sessions))
    for name in [*names, "all"]:
        mine = [session for session in sessions if name in {"all", session.disturbance}]
        counts = (
            len(mine),
            sum(bool(session.refusal) for session in mine),
            sum(bool(session.crash) for session in mine),
            sum(session.strikes for session in mine),
            sum(session.wrong_lines for session in mine),
            sum(session.wrong_lines_good for session in mine),
            sum(session.mislabelled for session in mine),
            sum(session.recognised for session in mine),
            sum(session.misplaced for session in mine),
            sum(bool(session.doubts) for session in mine),
            sum(session.repeats for session in mine),
        )
        table.add_row(name, *map(str, counts))
    return table


def _print_bad(console: Console, sessions: Iterable[SessionScore]) -> None:
    """List examples of false doubts, refusals and crashes, each text once."""
    for title, texts in (
        ("false doubts", lambda session: session.doubts),
        ("refusals", lambda session: [session.refusal] if session.refusal else []),
        ("crashes", lambda session: [session.crash] if session.crash else []),
    ):
        found: dict[str, list[str]] = defaultdict(list)
        for session in sessions:
            for text in texts(session):
                found[" ".join(text.split()[:4])].append(f"{session.cell}  {text}")
        for alike in sorted(found.values(), key=len, reverse=True)[:5]:
            console.print(f"{title}, {len(alike)} like: {alike[0]}", highlight=False, markup=False)
