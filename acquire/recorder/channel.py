"""Handle of a topic in a recording file, given by its writer and handed back with each message."""

from __future__ import annotations

from dataclasses import dataclass

from schemas.topics import Topic


@dataclass(frozen=True)
class Channel:
    """Handle of a topic in a recording file: its number in the file (MCAP channel id) and the topic."""

    id: int
    topic: Topic
