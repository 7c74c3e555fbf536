"""Damaged recordings of all kinds, made from an intact one."""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path

from mcap.writer import Writer

from analyze.reading.indexed_file import open_finished
from analyze.reading.recording import open_recording
from schemas import topics
from schemas.document import canonical_json
from schemas.mcap.records import CHUNK
from schemas.mcap.walk import record_at
from schemas.session_manifest import MANIFEST_NAME, PLAN_ATTACHMENT
from tests.mcap_writer import McapWriter

KINDS = {
    "empty": "empty",
    "text": "foreign",
    "other_mcap": "foreign",
    "cut": "cut",
    "head_only": "cut",
    "wrong_byte": "damaged",
    "no_strikes": "no_strikes",
    "other_plan": "plan",
    "part": "unfinished",
    "newer": "other_version",
}
"""expected name of the failure by kind of damage"""


def break_file(whole: Path, folder: Path, kind: str, number: int = 0) -> Path:
    """Write a damaged recording of the given kind, and return its path.

    Args:
        whole: an intact recording.
        folder: folder for the damaged one.
        kind: kind of damage, a key of KINDS.
        number: number that distinguishes several files of a kind, in name and in damage.

    Raises:
        ValueError: the kind is unknown.
    """
    path = folder / f"broken-{kind}-{number}.mcap"
    data = whole.read_bytes()
    match kind:
        case "empty":
            path.write_bytes(b"")
        case "text":
            path.write_text(f"not a recording {number}\n")
        case "other_mcap":
            with path.open("wb") as file:
                writer = Writer(file)
                writer.start()
                writer.finish()
        case "cut":
            path.write_bytes(data[: len(data) // (2 + number % 3)])
        case "head_only":
            path.write_bytes(data[:20])
        case "wrong_byte":
            at = _inside_a_chunk(whole, number)
            path.write_bytes(data[:at] + bytes([data[at] ^ 0x55]) + data[at + 1 :])
        case "no_strikes" | "other_plan" | "newer":
            _without_strikes(whole, path, kind)
        case "part":
            path = path.with_name(path.name + ".part")
            path.write_bytes(data[: len(data) // 3])
        case _:
            raise ValueError(kind)
    return path


def _inside_a_chunk(whole: Path, number: int) -> int:
    """Offset [bytes] of a byte of an image: the middle of a large chunk near the middle of the file.

    Small chunks hold messages that the catalogue reads, whose damage is found before any scrub.
    """
    with closing(open_finished(whole)) as file:
        lengths = {at: len(record_at(file.data, at, CHUNK)) for at, _ in file.chunks}
    large = [at for at, length in lengths.items() if 2 * length >= max(lengths.values())]
    at = large[(len(large) // 2 + number) % len(large)]
    return at + lengths[at] // 2


def _without_strikes(whole: Path, path: Path, kind: str) -> None:
    with open_recording(whole) as recording:
        manifest, plan = recording.manifest, recording.attachments[PLAN_ATTACHMENT]
        strikes = list(recording.messages("/session/strike"))
    if kind == "other_plan":
        plan = plan.replace(manifest.object_sha256.encode(), b"f" * 64)
    known = manifest.model_copy(update={"hashes": {PLAN_ATTACHMENT: hashlib.sha256(plan).hexdigest()}})
    text = canonical_json(known)
    if kind == "newer":
        text = text.replace('"schema_version":"1.', '"schema_version":"9.')
    with McapWriter(path) as writer:
        writer.metadata(MANIFEST_NAME, {"json": text})
        writer.attachment(PLAN_ATTACHMENT, "application/json", plan)
        clock, record = writer.add_topic(topics.CLOCK_SAMPLE), writer.add_topic(topics.SESSION_STRIKE)
        writer.write(clock, 1_800_000_000_000_000_000, b"")
        for message in strikes if kind == "other_plan" else []:
            writer.write(record, message.log_time_ns, bytes(message.data))
        writer.finish()
