"""What a recording states of its own contents: hashes of its attachments, and declarations in its summary."""

from __future__ import annotations

import json
import struct

from schemas.mcap import records as container
from schemas.mcap.records import ContainerError
from schemas.mcap.summary import find_summary
from schemas.mcap.walk import walk


def listed_declarations(data: memoryview) -> dict[tuple[int, int], bytes]:
    """Schema and channel records in a file's summary, by opcode and id; none without a whole summary."""
    try:
        records = find_summary(data).records
    except ContainerError:
        return {}
    return {
        (opcode, *struct.unpack_from("<H", body)): bytes(records[at : at + container.RECORD_HEAD + len(body)])
        for opcode, at, body in walk(records)
        if opcode in {container.SCHEMA, container.CHANNEL} and len(body) >= 2
    }


def stated_hashes(manifest_json: str) -> dict[str, str]:
    """Hash of each attachment that a manifest states; none, if it cannot be read."""
    try:
        stated = json.loads(manifest_json)["hashes"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return {}
    return {str(name): str(digest) for name, digest in stated.items()} if isinstance(stated, dict) else {}
