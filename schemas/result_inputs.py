"""Inputs of a result: recordings, object, plan, options and program, by their ids and hashes."""

from __future__ import annotations

from typing import ClassVar

from pydantic import Field

from schemas.document import Document, SparseDocument


class JoinedRecording(Document):
    """One of several recordings that a result merges: number, ids, time of creation, hash of its plan."""

    number: int = Field(ge=1, description="number by start time; strike ids are `<number>:<strike>`")
    recording_id: str
    """id of the recording, from its manifest"""
    content_id: str
    """hash of the recording's messages"""
    created: str
    """time of creation, ISO 8601"""
    plan_sha256: str
    """SHA-256 of the strike plan's text"""


class ResultInputs(SparseDocument):
    """Identity of the inputs of a result: recordings, object, plan, configuration and program.

    A recording's `content_id` is the hash of its messages. For several recordings it is the SHA-256 of their
    content ids, sorted, one per line. `plan_sha256` is their common plan's, or the SHA-256 of the different
    plans' hashes, sorted, one per line.
    """

    left_out: ClassVar[tuple[str, ...]] = ("recordings",)

    recording_id: str
    """id of the recording; several ids are joined by " + " in the text"""
    content_id: str
    """hash of the recording's messages"""
    object_sha256: str
    """SHA-256 of the object's specification and shape file, which identifies it"""
    plan_sha256: str
    """SHA-256 of the strike plan's text"""
    configuration_sha256: str
    """SHA-256 of the estimation's options"""
    software: str
    """program and version that computed the result"""
    recordings: list[JoinedRecording] | None = Field(
        default=None, description="merged recordings; not written where there is one"
    )
