"""The estimate of one object over its sessions: sentences, terminal, page, JSON and tables."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pyarrow as pa
from rich.box import SIMPLE_HEAD
from rich.table import Table

from analyze.batch.object_sessions import ObjectOverSessions, ObjectSession, QuantityOverSessions
from analyze.batch.object_verdict import verdict_sentences
from analyze.batch.query_output import plain_console, save_answer
from analyze.errors import ArchiveError
from analyze.least_squares.intervals import SIGMAS_95
from analyze.report.page import figure_element, page_environment
from analyze.report.session_forest import ForestRow, session_forest_figure
from analyze.result.digits import decimals, number
from schemas.output_file import write_text
from schemas.wording import counted

SUFFIXES = (".html", ".json", ".csv")


def mean_text(each: QuantityOverSessions) -> str:
    """Text of a quantity's mean with its 95 % interval, as "71.05 ± 0.13"."""
    digits = decimals(each.half)
    return f"{number(each.estimate.mean, digits)} ± {number(each.half, digits)}"


def parts_text(each: QuantityOverSessions) -> str:
    """Text on the two parts of the mean's interval: by the scatter, and by what all sessions share."""
    digits = decimals(each.half)
    scatter, shared = number(each.estimate.mean_half, digits), number(each.shared_half, digits)
    bound = "" if each.shared_known else "at most "
    return f"scatter ±\u00a0{scatter}, shared {bound}±\u00a0{shared}"


def between_text(each: QuantityOverSessions) -> str:
    """Text of the sd between sessions with its 95 % interval, as "0.14 (0.09 to 0.21)"; "–" if unknown."""
    found = each.estimate
    if found.sessions == 1:
        return "–"
    low, high = found.between_interval[0], each.between_high
    digits = decimals(high)
    return f"{number(found.between_sd, digits)} ({number(low, digits)} to {number(high, digits)})"


def prediction_text(each: QuantityOverSessions) -> str:
    """Text of the 95 % interval of what a new session would report, as "70.7 to 71.4"; "–" if unknown."""
    found = each.estimate
    if found.sessions == 1:
        return "–"
    digits = decimals(found.prediction_half)
    low, high = found.mean - found.prediction_half, found.mean + found.prediction_half
    return f"{number(low, digits)} to {number(high, digits)}"


def p_text(value: float) -> str:
    """Text of a p-value: two significant digits, "< 0.0001" for smaller ones, "–" for NaN."""
    if math.isnan(value):
        return "–"
    return "< 0.0001" if value < 1e-4 else f"{value:.2g}"


def render_object(found: ObjectOverSessions) -> None:
    """Print the estimate of one object over its sessions as tables on the terminal."""
    console = plain_console()
    title = f"{found.object} ({found.object_sha256[:8]}), {counted(len(found.sessions), 'session')}"
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, show_edge=False, padding=(0, 1, 0, 0))
    for heading in ("quantity", "mean, 95 %", "sd between sessions", "new session", "p"):
        table.add_column(heading, justify="left" if heading == "quantity" else "right")
    for each in found.quantities:
        some = f" ({each.estimate.sessions})" if each.estimate.sessions < len(found.sessions) else ""
        new = each.estimate.prediction_half
        table.add_row(
            f"{each.name} [{each.unit}]{some}",
            mean_text(each),
            between_text(each),
            "–" if math.isnan(new) else f"± {number(new, decimals(new))}",
            p_text(each.stated_p_value),
        )
    console.print(table)
    if found.joint is not None:
        chi_square, freedom, p_value = found.joint
        console.print(
            f"Centre of mass, three components together: chi² {chi_square:.1f} of {freedom} dof, "
            f"p {p_text(p_value)}{_joint_note(found)}"
        )
    for word, sentence in verdict_sentences(found):
        console.print(f"{word}: {sentence}")


def save_object(found: ObjectOverSessions, path: Path) -> list[Path]:
    """Write the estimate of one object over its sessions as HTML, JSON or CSV, by the path's suffix.

    As CSV, `path` holds the quantities; the sessions' values are written beside it as `<stem>-sessions.csv`.

    Returns:
        Paths of the files written, `path` first.

    Raises:
        ArchiveError: the suffix is unknown.
        OutputError: a file cannot be written.
    """
    if path.suffix not in SUFFIXES:
        raise ArchiveError(f"{path}: unknown file type {path.suffix!r}: use {', '.join(SUFFIXES)}")
    if path.suffix == ".html":
        write_text(path, _page(found))
        return [path]
    if path.suffix == ".json":
        write_text(path, json.dumps(object_document(found), indent=1) + "\n")
        return [path]
    sessions = path.with_name(f"{path.stem}-sessions.csv")
    document = object_document(found)
    flat = [{k: v for k, v in each.items() if k != "sessions"} for each in document["quantities"]]
    save_answer(pa.Table.from_pylist(flat), path)
    rows = [
        {"quantity": each["name"], "unit": each["unit"], **row}
        for each in document["quantities"]
        for row in each["sessions"]
    ]
    save_answer(pa.Table.from_pylist(rows), sessions)
    return [path, sessions]


def object_document(found: ObjectOverSessions) -> dict[str, Any]:
    """Estimate of one object over its sessions as JSON values; numbers that are not known are None."""
    document = {
        "object": found.object,
        "object_sha256": found.object_sha256,
        "sessions": [asdict(each) for each in found.sessions],
        "quantities": [_quantity_document(found, each) for each in found.quantities],
        "com_homogeneity": None
        if found.joint is None
        else dict(zip(("chi_square", "freedom", "p_value"), found.joint, strict=True))
        | {"without_shared": found.joint_own},
        "verdict": [f"{word}: {text}" for word, text in verdict_sentences(found)],
        "other_object_files": [{"object_sha256": sha256, "rows": many} for sha256, many in found.others],
    }
    return json.loads(json.dumps(_known(document)))


def _joint_note(found: ObjectOverSessions) -> str:
    return f", against {'the noise of their strikes' if found.joint_own else 'all that they state'}"


def _quantity_document(found: ObjectOverSessions, each: QuantityOverSessions) -> dict[str, Any]:
    estimate = each.estimate
    return {
        "name": each.name,
        "unit": each.unit,
        "n": estimate.sessions,
        "mean": estimate.mean,
        "half_width95": each.half,
        "half_width95_scatter": estimate.mean_half,
        "shared_sd": each.shared_sd,
        "shared_sd_known": each.shared_known,
        "between_sd": estimate.between_sd,
        "between_sd_low": estimate.between_interval[0],
        "between_sd_high": each.between_high,
        "between_sd_reml": estimate.between_sd_reml,
        "prediction_half_width95": estimate.prediction_half,
        "chi_square": estimate.chi_square,
        "p_value": estimate.p_value,
        "stated_p_value": each.stated_p_value,
        "scatter": estimate.scatter,
        "stated_sd": estimate.stated_sd,
        "sessions": [
            {
                "url": found.sessions[index].url,
                "created": found.sessions[index].created,
                "value": each.value[i],
                "sd": each.sd[i],
                "shift_without": estimate.left_out[i].shift if estimate.left_out else None,
                "p_value": estimate.left_out[i].p_value if estimate.left_out else None,
            }
            for i, index in enumerate(each.sessions)
        ],
    }


def _known(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _known(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_known(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _page(found: ObjectOverSessions) -> str:
    forests = [
        figure_element(
            session_forest_figure(
                f"{each.name} [{each.unit}]",
                [
                    ForestRow(found.sessions[index].day, each.value[i], each.sd[i], i in each.estimate.odd)
                    for i, index in enumerate(each.sessions)
                ],
                (each.estimate.mean, each.half),
                each.estimate.prediction_half,
            )
        )
        for each in found.quantities
    ]
    return (
        page_environment()
        .get_template("object.html")
        .render(
            found=found,
            forests=forests,
            verdict=verdict_sentences(found),
            mean_text=mean_text,
            parts_text=parts_text,
            between_text=between_text,
            prediction_text=prediction_text,
            p_text=p_text,
            joint_note=_joint_note(found),
            span=_span(found),
            rows=list(_session_rows(found)),
        )
    )


def _span(found: ObjectOverSessions) -> str:
    """First and last date of the sessions, as ", 2025-09-01 to 2026-09-21"; "" without any."""
    days = [session.created[:10] for session in found.sessions if session.created]
    return f", {days[0]} to {days[-1]}" if days else ""


def _session_rows(found: ObjectOverSessions) -> Iterator[tuple[ObjectSession, list[str], bool]]:
    """Yield session, text of each quantity's value, and whether it stands out, by start time."""
    for index, session in enumerate(found.sessions):
        cells: list[str] = []
        odd = False
        for each in found.quantities:
            if index not in each.sessions:
                cells.append("–")
                continue
            i = each.sessions.index(index)
            digits = decimals(SIGMAS_95 * each.sd[i])
            cells.append(f"{number(each.value[i], digits)} ± {number(SIGMAS_95 * each.sd[i], digits)}")
            odd = odd or i in each.estimate.odd
        yield session, cells, odd
