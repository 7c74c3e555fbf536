"""Prints the inspection of a file on the terminal.

With a dozen strikes it takes 100 columns x 40 lines; a narrower terminal shows fewer columns of the tables.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.table import Table

from analyze.reading.file_series import missing_files_text
from analyze.reading.planned_strikes import PlannedStrikes
from schemas.compaction import Compaction
from schemas.terminal import Terminal, styled
from schemas.wording import counted

WIDE_COLUMNS, NARROW_COLUMNS = 96, 58
"""smallest terminal widths at which tables show all columns, and all but the least important ones"""
LEAST_REASON = 16
"""smallest width of the column with the reasons of strikes' verdicts; narrower terminals do not show it"""


def render_inspection(found: dict[str, Any], console: Terminal | None = None) -> None:
    """Print contents, session and health of an inspected file on the terminal.

    Args:
        found: result of `inspect_recording`.
        console: where to print; None for standard output.
    """
    console = console or Terminal()
    ours = found["kind"] == "percuss"

    write = console.print
    write(
        styled(
            (found["path"], "bold"),
            f"  {_bytes(found['bytes'])}, {_seconds(found['duration_s'])}, ",
            _state(found),
        )
    )
    if ours:
        _write_session(found, write)
    write(_written(found))
    if found["start_ns"] is not None:
        write(
            f"from {_wall(found['start_ns'])} to {_wall(found['end_ns'])} UTC, "
            f"{counted(found['messages'], 'message')}"
        )
    console.print()
    console.print(_topics(found, console.width) if found["topics"] else "no topics")
    console.print()
    for camera in found.get("cameras", []):
        write(_camera(camera))
    for clock in _clocks(found):
        write(clock)
    if not ours:
        _write_attached(found, write)
    if found.get("strikes"):
        console.print()
        console.print(_strikes(found["strikes"], console.width))
        console.print()
    if found.get("tosses"):
        console.print(_tosses(found["tosses"]))
        console.print()
    plan = found.get("plan")
    if plan is not None and (found["growing"] or not plan["missing"]):
        write(PlannedStrikes(tuple(plan["planned"]), tuple(plan["missing"])).text(so_far=found["growing"]))
    _write_health(found["health"], write)


def _write_health(problems: Sequence[str], write: Any) -> None:
    for text in problems:
        write(styled(("!", "bold red"), f" {text}"))
    if not problems:
        write("health: no problems found")


def _state(found: dict[str, Any]) -> str | tuple[str, str]:
    """Text on the state of the file: complete, intact (planned strikes are missing), cut short or growing.

    With a style if the file is cut short or still being written.
    """
    if found["growing"]:
        return "still being written", "bold yellow"
    if not found["complete"]:
        return "cut short", "bold red"
    plan = found.get("plan")
    return "complete" if plan is None or not plan["missing"] else "intact file"


def _write_session(found: dict[str, Any], write: Any) -> None:
    if len(found["files"]) > 1:
        write(
            f"in {counted(len(found['files']), 'file')}: "
            f"{', '.join(Path(file['path']).name for file in found['files'])}"
        )
    if found["missing_files"]:
        write(styled(("missing", "bold red"), f": {missing_files_text(found['missing_files'])}"))
    write(
        f"object {found['object']['name']} ({found['object']['mass_kg'] * 1000:.1f} g), recorded "
        f"{found['created']} by {found['software']}, schema {found['schema_version']}"
    )
    for number, entry in enumerate(found["rebased"], 1):
        changed = ", ".join(entry["changed"]) or "nothing"
        write(
            f"rebased by {entry['software']}: {changed}; the earlier files are attached as rebase-{number}/"
        )
    for entry in found["compacted"]:
        lost = Compaction(**entry).loss_text()
        write(f"compacted by {entry['software']} from {_bytes(entry['source_bytes'])}: {lost}")


def _written(found: dict[str, Any]) -> str:
    """Text that names the program that wrote the file, its encodings and compression."""
    by = f"written by {found['library']}" if found["library"] else "written by an unnamed program"
    parts = [by + (f" (profile {found['profile']})" if found["profile"] else "")]
    encodings = dict.fromkeys(topic["encoding"] for topic in found["topics"] if topic.get("encoding"))
    if encodings:
        parts.append(" and ".join(encodings) + " messages")
    for name, packed in found["compression"].items():
        size = _bytes(packed["stored_bytes"])
        parts.append(
            f"{counted(packed['chunks'], 'chunk')} of {size}, uncompressed"
            if name == "none"
            else f"{counted(packed['chunks'], 'chunk')} compressed with {name}, "
            f"{size} of {_bytes(packed['unpacked_bytes'])}"
        )
    return ", ".join(parts)


def _topics(found: dict[str, Any], width: int) -> Table:
    table = _table()
    # The name is what a reader copies: on a narrow terminal it stays complete and other columns are dropped.
    table.add_column("topic", no_wrap=True)
    if width >= NARROW_COLUMNS:
        table.add_column("type", overflow="fold")
    headings = ["messages", "Hz"]
    if width >= WIDE_COLUMNS:
        headings.append("usual Hz")
    if width >= NARROW_COLUMNS:
        headings.append("gap [s]")
    if width >= WIDE_COLUMNS:
        headings.append("at [s]")
    for heading in headings:
        table.add_column(heading, justify="right", no_wrap=True)
    for topic in found["topics"]:
        kind = topic["schema"].rpartition(".")[2] or "-"
        interval, since = topic["median_interval_s"], topic["longest_gap_start_ns"]
        cells = {
            "messages": str(topic["count"]),
            "Hz": _number(topic["rate_hz"], ".2f"),
            "usual Hz": _number(1 / interval if interval else None, ".2f"),
            "gap [s]": _number(topic["longest_gap_s"], ".3f"),
            "at [s]": _number(None if since is None else (since - found["start_ns"]) * 1e-9, ".1f"),
        }
        table.add_row(
            topic["name"],
            *([kind] if width >= NARROW_COLUMNS else []),
            *(cells[heading] for heading in headings),
        )
    return table


def _strikes(strikes: Sequence[dict[str, Any]], width: int) -> Table:
    table = _table()
    table.add_column("strike", no_wrap=True)
    for heading in ("images", "missing", "m/s") if width >= NARROW_COLUMNS else ("images",):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    # The reason wraps within the rest of the line.
    room = (
        width
        - max(len(strike["strike_id"]) for strike in strikes)
        - max(len(strike["verdict"] or "-") for strike in strikes)
        - 36
    )
    if room >= LEAST_REASON:
        table.add_column("reason")
    for strike in strikes:
        middle = [str(strike["images"]), str(strike["images_missing"]), f"{strike['tip_speed_m_s']:.3f}"]
        table.add_row(
            strike["strike_id"],
            *(middle if width >= NARROW_COLUMNS else middle[:1]),
            strike["verdict"] or "-",
            *([strike["verdict_text"]] if room >= LEAST_REASON else []),
        )
    return table


def _tosses(tosses: Sequence[dict[str, Any]]) -> Table:
    table = _table()
    table.add_column("toss", no_wrap=True)
    for heading in ("images", "missing"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("verdict", "reason"):
        table.add_column(heading)
    for toss in tosses:
        table.add_row(
            toss["toss_id"],
            str(toss["images"]),
            str(toss["images_missing"]),
            toss["verdict"] or "-",
            toss["verdict_text"],
        )
    return table


def _camera(camera: dict[str, Any]) -> str:
    delay = camera["arrival_delay_s"]
    return (
        f"camera {camera['name']}: {counted(camera['frames'], 'frame')} at "
        f"{_number(camera['rate_hz'], '.2f')} Hz (set {camera['nominal_rate_hz']:g}), {camera['lost']} lost, "
        f"{counted(camera['images'], 'image')} kept, "
        f"{_number(None if delay is None else delay * 1e3, '.1f')} ms late"
    )


def _clocks(found: dict[str, Any]) -> list[str]:
    if "clocks" in found:
        return [
            f"clock {clock['clock']}: {counted(clock['samples'], 'sample')}, "
            f"{_number(clock['drift_ppm'], '+.1f')} ppm, round trip {clock['round_trip_s'] * 1e6:.0f} us"
            for clock in found["clocks"]
        ] or ["clocks: no samples"]
    delay = found["publish_delay_s"]
    if delay is None:
        return ["clocks: no message"]
    return [
        f"clocks: logged {delay * 1e3:.3f} ms after publishing"
        if delay
        else "clocks: log and publish times are the same"
    ]


def _write_attached(found: dict[str, Any], write: Any) -> None:
    if found["attachments"]:
        write(
            "attached: "
            + ", ".join(f"{name} ({_bytes(size)})" for name, size in found["attachments"].items())
        )
    if found["metadata"]:
        write(
            "metadata: "
            + ", ".join(f"{name} ({len(entries)})" for name, entries in found["metadata"].items())
        )
    write("not a recording of `acquire`: it contains no session")


def _table() -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")


def _bytes(size: int) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size} B"


def _seconds(duration: float) -> str:
    if duration < 120:
        return f"{duration:.1f} s"
    minutes, seconds = divmod(round(duration), 60)
    return f"{minutes} min {seconds} s" if minutes < 120 else f"{minutes // 60} h {minutes % 60} min"


def _wall(time_ns: int) -> str:
    """Date and time (UTC, to the millisecond) of a Unix time [ns]; "N s" if no calendar date matches it."""
    seconds, rest = divmod(time_ns, 1_000_000_000)
    try:
        return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d}"
    except (OverflowError, ValueError, OSError):
        return f"{seconds} s"


def _number(value: float | None, layout: str) -> str:
    """Value in the format `layout`, such as ".2f"; "-" if it is None."""
    return "-" if value is None else format(value, layout)
