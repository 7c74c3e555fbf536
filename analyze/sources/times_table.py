"""Reads a table (CSV) of the frames' times that a camera's program writes beside images or a video."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path

from analyze.errors import ImportRefused
from analyze.sources.frame_timing import usual_interval
from analyze.sources.times_columns import (
    COLUMNS_TEXT,
    UNITS_S,
    TimeColumn,
    column_of_frames,
    plausible_units,
    time_columns,
)
from schemas.input_file import open_text
from schemas.wording import counted

TIMECODES = re.compile(r"#\s*time(code|stamp)\s+format\s+v2\b", re.IGNORECASE)
"""first line of a timecode file (Matroska's tools, libcamera): one time [ms] per line, without a header"""
SAME_RATE = 1.5
"""ratio of two frame rates below which a table's unit is taken to agree with the video's own rate"""
SEPARATORS = ",;\t"
MAX_NUMBER = Decimal(10) ** 21
"""number in a table from which on it can be no time or frame: nanoseconds since 1970 are below it"""
MAX_SPAN_NS = 10**18
"""longest time between two frames of one table [ns]: thirty years, so that a 64-bit integer holds all"""


@dataclass(frozen=True)
class TimedRow:
    """A row of a table of times: the frame's time with the names and numbers that the row gives it."""

    line: int
    """number of the line in the file, from 1"""
    time_s: Decimal
    """time [s] since the zero that the table uses; a float has too few digits for seconds since 1970"""
    name: str | None
    """name of the image file, relative to its folder; None if the table has no such column"""
    frame: int | None
    """number of the frame; None if the table has no such column"""


@dataclass(frozen=True)
class TimesTable:
    """Times of frames from a file, in the order of its rows, with the error of their rounding."""

    path: Path
    """the file"""
    rows: list[TimedRow]
    """its rows, in their order"""
    column: TimeColumn
    """the column of the times"""
    unit: str
    """unit of the times in the file: s, ms, us or ns"""
    sd_ns: int
    """standard deviation [ns] of the times' rounding: the last decimal / sqrt(12), at least 1"""
    others: tuple[str, ...]
    """names of further columns with times, which are not used"""

    @property
    def remark(self) -> str | None:
        """What was assumed in reading the table, for the user; None if the table states all.

        A unit that the column's name lacks, and the choice among several columns of times.
        """
        parts = [] if self.column.unit else [f"its column {self.column.name} is read in {self.unit}"]
        if self.others:
            parts.append(f"of its columns of times {self.column.name} is used, not {', '.join(self.others)}")
        return f"{self.path.name}: {'; '.join(parts)}" if parts else None


def is_times_table(path: Path) -> bool:
    """True if a file is a table of times: a column of times in its header, or a timecode file."""
    try:
        with open_text(path, "utf-8-sig", newline="") as file:
            head = file.readline(4096)
    except (OSError, UnicodeDecodeError):
        return False
    return bool(TIMECODES.match(head)) or bool(time_columns(_cells(head)))


def read_times_table(path: Path, what: str, rate_hz: float | None = None) -> TimesTable:
    """Read a table of frame times.

    The unit is that of the column's name (`time_s`, `timestamp_ns`, `Time [ms]`). A column without a unit
    (`time`, `t`) is read in the only unit in which frames come at a camera's rate, or, where several are
    possible, in the one that agrees with the video's own rate.

    Args:
        path: CSV with a header, separated by commas, semicolons or tabs, or a timecode file.
        what: kind of the frames in messages, "image" or "frame".
        rate_hz: frame rate that the video itself states [Hz]; None if unknown.

    Returns:
        The table, its rows in the order of the file.

    Raises:
        ImportRefused: the file cannot be read, has no column of times or fewer than two rows, a time or frame
            number is not a number, the unit is ambiguous, or the median interval is no camera's.
    """
    lines = list(_read_lines(path))
    if lines and TIMECODES.match(lines[0][1][0] if lines[0][1] else ""):
        columns, header = [TimeColumn("time_ms", 0, "ms", by_host=False)], ["time_ms"]
    else:
        header = [cell.strip() for cell in lines[0][1]] if lines else []
        columns = time_columns(header)
    if not columns:
        shown = ",".join(header) or "none"
        raise ImportRefused(f"{path}: has the columns {shown}: it needs {COLUMNS_TEXT}")
    column, names = columns[0], [name.lower() for name in header]
    at_name = names.index("name") if "name" in names else None
    at_frame = column_of_frames(header)
    values: list[tuple[Decimal, str]] = []
    rows: list[TimedRow] = []
    for line, cells in lines[1:]:
        text = _cell(cells, column.place)
        value = _number(text)
        if value is None:
            raise ImportRefused(f"{path}: line {line}: {column.name} {text!r} is not a number: correct it")
        frame = None if at_frame is None else _frame(path, line, header[at_frame], _cell(cells, at_frame))
        values.append((value, text))
        rows.append(TimedRow(line, value, None if at_name is None else _cell(cells, at_name), frame))
    if len(rows) < 2:
        raise ImportRefused(
            f"{path}: names {counted(len(rows), what)}: a strike needs more: name all {what}s with their "
            "times"
        )
    unit = _unit(path, column, sorted(value for value, _ in values), rate_hz)
    scale = Decimal(UNITS_S[unit])
    timed = [TimedRow(row.line, row.time_s * scale, row.name, row.frame) for row in rows]
    others = tuple(other.name for other in columns[1:])
    return TimesTable(path, timed, column, unit, _rounding_sd_ns([text for _, text in values], unit), others)


def checked_times_ns(path: Path, rows: Sequence[TimedRow], what: str) -> list[int]:
    """Times [ns] of frames since the first, which must increase.

    Args:
        path: the table, for messages.
        rows: its rows in the order of the frames, two or more.
        what: kind of the frames in messages, "image" or "frame".

    Raises:
        ImportRefused: a time is not later than the one before it, or later than the first by years.
    """
    start = rows[0].time_s
    times = [round((row.time_s - start) * 10**9) for row in rows]
    for time_ns, row in zip(times, rows, strict=True):
        if abs(time_ns) > MAX_SPAN_NS:
            raise ImportRefused(
                f"{path}: line {row.line}: its time is {1e-9 * time_ns:.3g} s from that of line "
                f"{rows[0].line}: correct it, or the unit in the column's name"
            )
    for (earlier, later), (first, row) in zip(pairwise(times), pairwise(rows), strict=True):
        if later == earlier:
            raise ImportRefused(
                f"{path}: two {what}s have the same time, lines {first.line} and {row.line}: correct it"
            )
        if later < earlier:
            raise ImportRefused(
                f"{path}: line {row.line}: its time is {1e-9 * (earlier - later):.6g} s before that of line "
                f"{first.line}: put the rows in the order of the {what}s"
            )
    return times


def refuse_repeated(path: Path, names: Sequence[str]) -> None:
    """Check that no image or frame has two rows.

    Raises:
        ImportRefused: one is named more than once.
    """
    often, count = Counter(names).most_common(1)[0]
    if count > 1:
        raise ImportRefused(f"{path}: names {often} {count} times: each has one time: correct it")


# --- the file


def _read_lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines of a table that are not blank, each with its number and its cells.

    Raises:
        ImportRefused: the file cannot be read as text in UTF-8.
    """
    try:
        with open_text(path, "utf-8-sig", newline="") as file:
            separator = _separator(file.readline(4096))
            file.seek(0)
            rows = csv.reader(file, delimiter=separator)
            for cells in rows:
                if any(cell.strip() for cell in cells):
                    # A decimal comma; it can stand only where the comma does not separate columns.
                    yield (
                        rows.line_num,
                        cells if separator == "," else [cell.replace(",", ".") for cell in cells],
                    )
    except FileNotFoundError:
        raise ImportRefused(f"{path}: no such table of times: check the path") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ImportRefused(f"{path}: cannot be read as CSV ({reason}): it needs {COLUMNS_TEXT}") from None


def _separator(head: str) -> str:
    """Separator of a table's columns: of comma, semicolon and tab the one most frequent in its first line."""
    return max(SEPARATORS, key=head.count)


def _cells(head: str) -> list[str]:
    return [cell.strip() for cell in head.rstrip("\r\n").split(_separator(head))]


def _cell(cells: list[str], index: int) -> str:
    return cells[index].strip() if index < len(cells) else ""


def _number(text: str) -> Decimal | None:
    """Parse a decimal number; None if the text is no number, or none below `MAX_NUMBER`."""
    try:
        value = Decimal(text)
    except InvalidOperation:
        return None
    return value if value.is_finite() and abs(value) < MAX_NUMBER else None


def _frame(path: Path, line: int, column: str, text: str) -> int:
    value = _number(text)
    if value is None or value != int(value):
        raise ImportRefused(f"{path}: line {line}: {column} {text!r} is not a frame number: correct it")
    return int(value)


# --- unit


def _unit(path: Path, column: TimeColumn, ordered: Sequence[Decimal], rate_hz: float | None) -> str:
    """Unit of a column of times: as its name states, else as the frames' interval allows.

    Args:
        path: the table, for messages.
        column: the column.
        ordered: its values, increasing, in its unit.
        rate_hz: frame rate that the video itself states [Hz]; None if unknown.

    Raises:
        ImportRefused: the median interval is no camera's in the stated unit or in any, or in several.
    """
    gaps = [later - earlier for earlier, later in pairwise(ordered) if later > earlier]
    usual = float(sorted(gaps)[len(gaps) // 2]) if gaps else 0.0
    fitting = plausible_units(usual)
    if column.unit is not None:
        if usual and column.unit not in fitting:
            interval = f"{usual * float(UNITS_S[column.unit]):.3g} s"
            remedy = (
                f"if they are in {fitting[0]}, rename the column to {column.base}_{fitting[0]}"
                if fitting
                else "give the times of the frames, not their numbers"
            )
            raise ImportRefused(
                f"{path}: its images come every {interval} by the column {column.name}: {remedy}"
            )
        return column.unit
    if rate_hz is not None and len(fitting) > 1:
        agreeing = [
            unit for unit in fitting if 1 / SAME_RATE < usual * float(UNITS_S[unit]) * rate_hz < SAME_RATE
        ]
        fitting = agreeing if len(agreeing) == 1 else fitting
    numbers = set(gaps) == {Decimal(1)}
    if (len(fitting) == 1 and not numbers) or not usual:
        return fitting[0] if fitting else "s"
    name = column.base
    rises = f"{path}: its column {column.name} rises by {usual:.6g} from image to image"
    if not fitting or numbers:
        why = "as frame numbers do" if numbers else "which is no camera's interval in any unit"
        raise ImportRefused(
            f"{rises}, {why}: give the times in a column {name}_s, {name}_ms, {name}_us or {name}_ns"
        )
    raise ImportRefused(
        f"{rises}, which may be in {' or '.join(fitting)}: rename it to "
        f"{' or '.join(f'{name}_{unit}' for unit in fitting)}"
    )


def _rounding_sd_ns(texts: Sequence[str], unit: str) -> int:
    """Standard deviation [ns] of the rounding of a table's times: unit of the last decimal / sqrt(12).

    The time with the most decimals counts; times in exponent notation are ignored. The result is at least
    1 ns.
    """
    digits = max((len(text.partition(".")[2]) for text in texts if "e" not in text.lower()), default=None)
    if digits is None:
        return 1
    return max(1, round(float(UNITS_S[unit]) * 10.0 ** (9 - digits) / 12**0.5))


def usual_rate_hz(times_ns: Sequence[int]) -> float:
    """Frame rate [Hz] of frame times (n,) [ns], from the usual interval without gaps."""
    return 1e9 / usual_interval(times_ns)
