"""Summary of one topic of a recording."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TopicInfo:
    """Message type, number of messages and time span of one topic."""

    name: str
    """name of the topic"""
    schema: str
    """full name of the message type, "" if unknown"""
    count: int
    """number of messages"""
    first_ns: int | None
    """earliest log time [ns]; None without messages"""
    last_ns: int | None
    """latest log time [ns]; None without messages"""
