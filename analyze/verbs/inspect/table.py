"""What `analyze inspect` prints for people: one screen of 100 x 40 for a recording of a dozen strikes, and less on a narrow one."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from analyze.reading.file_series import missing_text
from analyze.reading.planned_strikes import PlannedStrikes

WIDE, NARROW = 96, 58
"""columns of a terminal from which a table shows all that it has, and all but what is nice to know"""


def render_inspection(found: dict[str, Any], console: Console | None = None) -> None:
    """Print what `inspect_recording` found."""
    console = console or Console()
    ours = found["kind"] == "percuss"

    def say(text: str) -> None:
        console.print(text, highlight=False)

    say(f"[bold]{escape(found['path'])}[/]  {_bytes(found['bytes'])}, {_seconds(found['duration_s'])}, {_state(found)}")
    if ours:
        _say_session(found, say)
    say(_written(found))
    if found["start_ns"] is not None:
        say(f"from {_wall(found['start_ns'])} to {_wall(found['end_ns'])} UTC, {found['messages']} messages")
    console.print()
    console.print(_topics(found, console.width) if found["topics"] else "no topics")
    console.print()
    for camera in found.get("cameras", []):
        say(_camera(camera))
    for clock in _clocks(found):
        say(clock)
    if not ours:
        _say_attached(found, say)
    if found.get("strikes"):
        console.print()
        console.print(_strikes(found["strikes"], console.width))
        console.print()
    plan = found.get("plan")
    if plan is not None and not plan["missing"]:
        say(PlannedStrikes(tuple(plan["planned"]), ()).text())
    for text in found["health"]:
        say(f"[bold red]![/] {escape(text)}")
    if not found["health"]:
        say("health: nothing wrong was found")


def _state(found: dict[str, Any]) -> str:
    if not found["complete"]:
        return "[bold red]cut short[/]"
    plan = found.get("plan")
    return "complete" if plan is None or not plan["missing"] else "the file is whole"


def _say_session(found: dict[str, Any], say: Any) -> None:
    if len(found["files"]) > 1:
        say(f"in {len(found['files'])} files: {', '.join(escape(Path(file['path']).name) for file in found['files'])}")
    if found["missing_files"]:
        say(f"[bold red]not here[/]: {missing_text(found['missing_files'])}")
    say(
        f"object {escape(found['object']['name'])} ({found['object']['mass_kg'] * 1000:.1f} g), recorded {escape(found['created'])} "
        f"by {escape(found['software'])}, schema {escape(found['schema_version'])}"
    )


def _written(found: dict[str, Any]) -> str:
    """Who wrote it, and how messages stand in it."""
    by = f"written by {escape(found['library'])}" if found["library"] else "written by nobody named"
    parts = [by + (f" (profile {escape(found['profile'])})" if found["profile"] else "")]
    encodings = dict.fromkeys(topic["encoding"] for topic in found["topics"] if topic.get("encoding"))
    if encodings:
        parts.append(escape(" and ".join(encodings)) + " messages")
    for name, packed in found["compression"].items():
        size = _bytes(packed["stored_bytes"])
        parts.append(
            f"{packed['chunks']} chunks of {size}, not packed"
            if name == "none"
            else f"{packed['chunks']} chunks packed with {escape(name)}, {size} of {_bytes(packed['unpacked_bytes'])}"
        )
    return ", ".join(parts)


def _topics(found: dict[str, Any], width: int) -> Table:
    table = _table()
    # The name is what a reader copies: it stays whole where the terminal is narrow, the rest gives way.
    table.add_column("topic", no_wrap=True)
    if width >= NARROW:
        table.add_column("type", overflow="fold")
    headings = ["messages", "Hz"]
    if width >= WIDE:
        headings.append("usual Hz")
    if width >= NARROW:
        headings.append("gap [s]")
    if width >= WIDE:
        headings.append("at [s]")
    for heading in headings:
        table.add_column(escape(heading), justify="right", no_wrap=True)
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
        table.add_row(escape(topic["name"]), *([escape(kind)] if width >= NARROW else []), *(cells[heading] for heading in headings))
    return table


def _strikes(strikes: Sequence[dict[str, Any]], width: int) -> Table:
    table = _table()
    table.add_column("strike", no_wrap=True)
    for heading in ("images", "missing", "m/s") if width >= NARROW else ("images",):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    # What stands before the reason is whole; the reason has the rest of the line.
    room = width - max(len(strike["strike_id"]) for strike in strikes) - max(len(strike["verdict"] or "-") for strike in strikes) - 36
    if room >= len("reason"):
        table.add_column("reason")
    for strike in strikes:
        middle = [str(strike["images"]), str(strike["images_missing"]), f"{strike['tip_speed_m_s']:.3f}"]
        reason = strike["verdict_text"] if len(strike["verdict_text"]) <= room else strike["verdict_text"][: room - 1] + "…"
        table.add_row(
            escape(strike["strike_id"]),
            *(middle if width >= NARROW else middle[:1]),
            escape(strike["verdict"] or "-"),
            *([escape(reason)] if room >= len("reason") else []),
        )
    return table


def _camera(camera: dict[str, Any]) -> str:
    delay = camera["arrival_delay_s"]
    return (
        f"camera {escape(camera['name'])}: {camera['frames']} frames at {_number(camera['rate_hz'], '.2f')} Hz "
        f"(set {camera['nominal_rate_hz']:g}), {camera['lost']} lost, {camera['images']} images kept, "
        f"{_number(None if delay is None else delay * 1e3, '.1f')} ms late"
    )


def _clocks(found: dict[str, Any]) -> list[str]:
    if "clocks" in found:
        return [
            f"clock {escape(clock['clock'])}: {clock['samples']} samples, {_number(clock['drift_ppm'], '+.1f')} ppm, "
            f"round trip {clock['round_trip_s'] * 1e6:.0f} us"
            for clock in found["clocks"]
        ] or ["clocks: no samples"]
    delay = found["publish_delay_s"]
    if delay is None:
        return ["clocks: no message"]
    return [f"clocks: logged {delay * 1e3:.3f} ms after publishing" if delay else "clocks: log and publish times are the same"]


def _say_attached(found: dict[str, Any], say: Any) -> None:
    if found["attachments"]:
        say("attached: " + ", ".join(f"{escape(name)} ({_bytes(size)})" for name, size in found["attachments"].items()))
    if found["metadata"]:
        say("metadata: " + ", ".join(f"{escape(name)} ({len(entries)})" for name, entries in found["metadata"].items()))
    say("no recording of `acquire`: there is no session in it")


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
    seconds, rest = divmod(time_ns, 1_000_000_000)
    try:
        return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d}"
    except (OverflowError, ValueError, OSError):
        return f"{seconds} s"


def _number(value: float | None, layout: str) -> str:
    return "-" if value is None else format(value, layout)
