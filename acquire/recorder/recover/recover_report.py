"""Report of a recovery: what was saved, and what is lost, changed or unverified."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from schemas.wording import counted


@dataclass
class RecoverReport:
    """Result of a recovery: numbers of saved messages and attachments, and the extent of the losses."""

    source: Path
    """the cut or damaged recording"""
    path: Path
    """the new recording"""
    messages: int = 0
    """number of messages saved"""
    topics: dict[str, int] = field(default_factory=dict)
    """number of messages saved, by topic name"""
    attachments: int = 0
    """number of attachments saved"""
    damaged_records: int = 0
    """records left out because their checksum or their form was wrong"""
    skipped_bytes: int = 0
    """bytes that belong to no whole record"""
    ended_properly: bool = False
    """True if the source holds its data to their end; otherwise it is unknown how much is missing"""
    lasts_s: float = 0.0
    """time from the first saved message to the last, by their log times [s]"""
    has_manifest: bool = False
    """True if the manifest (object, hash of the plan, camera and clock of the session) was saved"""
    content_id: str = ""
    """hash of the saved messages"""
    missing: list[str] = field(default_factory=list)
    """what the source's summary lists or counts and the source lacks; each a line"""
    differences: list[str] = field(default_factory=list)
    """what was saved and is not what was recorded, by the source's own seal and hashes; each a line"""
    unverified: list[str] = field(default_factory=list)
    """what was saved, though no hash or checksum of the source covers it; each a line"""

    @property
    def anything_lost(self) -> bool:
        """True if anything is missing, changed or unverified, or if the file was cut short."""
        return self.anything_damaged or not self.ended_properly or bool(self.unverified)

    @property
    def anything_damaged(self) -> bool:
        """True if the file holds damaged bytes, records or contents; its early end does not count."""
        return self.damaged_records > 0 or self.skipped_bytes > 0 or bool(self.missing + self.differences)

    def as_dict(self) -> dict[str, Any]:
        """Report as a JSON object: all its fields, `anything_damaged` and `anything_lost`; paths as text."""
        texts = {"source": str(self.source), "path": str(self.path)}
        losses = {"anything_damaged": self.anything_damaged, "anything_lost": self.anything_lost}
        return asdict(self) | texts | losses

    def text(self) -> str:
        """Report in a few lines for the terminal."""
        topics = f"{counted(len(self.topics), 'topic')}, {counted(self.attachments, 'attachment')}"
        lines = [f"{self.path}: {counted(self.messages, 'message')} on {topics}"]
        if not self.has_manifest:
            lines.append("no manifest: viewers can open the file, `analyze` cannot use it")
        return "\n".join(lines + self.losses())

    def losses(self) -> list[str]:
        """Lines on what is lost, changed or unverified; none if nothing is."""
        lines = [f"not what was recorded: {each}" for each in self.differences]
        lines += [f"cannot be verified: {each}" for each in self.unverified]
        lines += [f"lost: {each}" for each in self.missing]
        if self.damaged_records or self.skipped_bytes:
            lines.append(
                f"lost: {counted(self.damaged_records, 'damaged record')}, "
                f"{counted(self.skipped_bytes, 'byte')} of incomplete records"
            )
        if not self.ended_properly:
            lines.append(
                f"lost: everything later: the file ends {self.lasts_s:.3f} s after its first message"
            )
        return lines
