"""Contents of any MCAP file as JSON values: topics with rates and gaps, times, compression, health."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from analyze.reading.mcap_contents import McapContents
from schemas.wording import counted

EARLIEST_REAL_TIME_NS = 946_684_800_000_000_000
"""beginning of the year 2000 [ns since 1970]; earlier times are simulated, or from a computer without a
clock"""


def inspect_contents(contents: McapContents, *, growing: bool = False) -> dict[str, Any]:
    """Contents and health of any MCAP file, with or without a session, as JSON values.

    Times are log times [ns]; `start_ns` and `end_ns` are None if the file contains no message. `health` lists
    problems as text.

    Args:
        contents: the file as read.
        growing: True if it is still being written: its open end is no problem.
    """
    topics = [_topic(contents, name) for name in contents.topics()]
    return {
        "path": str(contents.path),
        "kind": "mcap",
        "bytes": contents.size,
        "complete": contents.finished,
        "growing": growing,
        "profile": contents.profile,
        "library": contents.library,
        "messages": contents.messages,
        **time_span(topics),
        "topics": topics,
        "indexed": contents.indexed,
        "compression": {
            name: {
                "chunks": packed.chunks,
                "stored_bytes": packed.stored_bytes,
                "unpacked_bytes": packed.unpacked_bytes,
            }
            for name, packed in sorted(contents.compression.items())
        },
        "publish_delay_s": float(np.median(contents.delays_ns) * 1e-9) if contents.delays_ns else None,
        "attachments": contents.attachments,
        "metadata": contents.metadata,
        "health": _health(contents, topics, growing=growing),
    }


def time_span(topics: list[dict[str, Any]]) -> dict[str, Any]:
    """First and last log time [ns] of all messages and the time between them [s], as JSON values.

    Args:
        topics: topics with `count`, `first_ns` and `last_ns`, as in `time_table`.

    Returns:
        `start_ns` and `end_ns`, None without a message, and `duration_s`, 0 without one.
    """
    begins = [topic["first_ns"] for topic in topics if topic["count"]]
    ends = [topic["last_ns"] for topic in topics if topic["count"]]
    return {
        "start_ns": min(begins, default=None),
        "end_ns": max(ends, default=None),
        "duration_s": (max(ends) - min(begins)) * 1e-9 if begins else 0.0,
    }


def time_table(times: NDArray[np.int64]) -> dict[str, Any]:
    """Count, first and last time, rate and gaps of a topic's messages, as JSON values.

    Args:
        times: (n,) log times [ns], in any order.

    Returns:
        `count`, `first_ns`, `last_ns`, `rate_hz` (intervals over the time from first to last),
        `median_interval_s`, `longest_gap_s` and `longest_gap_start_ns`. A value that the times do not
        determine is None.
    """
    times = np.sort(times)
    gaps = np.diff(times) * 1e-9
    longest = int(gaps.argmax()) if len(gaps) else None
    return {
        "count": len(times),
        "first_ns": int(times[0]) if len(times) else None,
        "last_ns": int(times[-1]) if len(times) else None,
        "rate_hz": float(len(gaps) / gaps.sum()) if len(gaps) and gaps.sum() > 0 else None,
        "median_interval_s": float(np.median(gaps)) if len(gaps) else None,
        "longest_gap_s": None if longest is None else float(gaps[longest]),
        "longest_gap_start_ns": None if longest is None else int(times[longest]),
    }


def _topic(contents: McapContents, name: str) -> dict[str, Any]:
    """JSON values of the topic called `name`: message types, encodings, number of channels, times.

    The times are the entries of `time_table`: count, first and last time, rate and gaps. `out_of_order` is
    the number of messages older than the one before; None with several channels.
    """
    channels = contents.channels_of(name)
    found = [
        contents.schemas[channel.schema_id] for channel in channels if channel.schema_id in contents.schemas
    ]
    times = contents.times(name)
    return {
        "name": name,
        "schema": ", ".join(dict.fromkeys(schema.name for schema in found)),
        "schema_encoding": ", ".join(dict.fromkeys(schema.encoding for schema in found)),
        "encoding": ", ".join(dict.fromkeys(channel.encoding for channel in channels)),
        "channels": len(channels),
        **time_table(times),
        # The times of several channels are listed one channel after the other: only one has an order to
        # check.
        "out_of_order": int((np.diff(times) < 0).sum()) if len(channels) == 1 else None,
    }


def out_of_order_lines(topics: list[dict[str, Any]]) -> list[str]:
    """A line of text per topic whose messages are not in the order of their times; empty if there is none.

    Only topics with a single channel count: several publishers of one topic may interleave, which is no
    fault.

    Args:
        topics: topics as in `inspect_contents`, with `name` and `out_of_order`.
    """
    return [
        f"{topic['name']}: {counted(topic['out_of_order'], 'message', 'is')} older than the one before"
        for topic in topics
        if topic["out_of_order"]
    ]


def _health(contents: McapContents, topics: list[dict[str, Any]], *, growing: bool) -> list[str]:
    """Problems of a recording's file as lines of text, each with a remedy if there is one; may be empty.

    The order of messages is not checked here (`out_of_order_lines`).
    """
    recover = f"`acquire recover {contents.path} -o NEW.mcap`"
    found: list[str] = []
    if not contents.finished and not growing:
        found.append(
            f"cut short or damaged: the last {counted(contents.unread_bytes, 'byte', 'is')} no complete "
            f"record: {recover} saves the rest"
        )
    elif contents.finished and contents.compression and not contents.indexed:
        found.append(f"no index, so that readers must read all of it: {recover} writes one")
    found += [f"damaged: {text}: {recover} saves what can be read" for text in dict.fromkeys(contents.damage)]
    if contents.stated_messages not in {None, contents.messages}:
        found.append(
            f"{counted(contents.messages, 'message', 'was')} found, its statistics state "
            f"{contents.stated_messages}"
        )
    if contents.undescribed_messages:
        found.append(
            f"{counted(contents.undescribed_messages, 'message', 'is')} on channels that the file does "
            "not describe"
        )
    if any(topic["count"] and topic["first_ns"] < EARLIEST_REAL_TIME_NS for topic in topics):
        found.append(
            "times begin before the year 2000: simulated, or from a computer whose clock was not set"
        )
    return found
