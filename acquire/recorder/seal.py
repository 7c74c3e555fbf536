"""Seal of a recording file: the result of finishing it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Seal:
    """Result of finishing a recording file: path, content id (hash), number of messages and size."""

    path: Path
    content_id: str
    """hash of all messages outside /truth/"""
    messages: int
    """number of messages"""
    size: int
    """size of the file [bytes]"""
