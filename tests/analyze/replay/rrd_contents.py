"""Contents of a replay's file (.rrd), for tests."""

from __future__ import annotations

from pathlib import Path

from rerun.chunk import RrdReader


class RrdContents:
    """Contents of a .rrd file, by entity."""

    def __init__(self, path: Path) -> None:
        self.chunks: dict[str, list] = {}
        for chunk in RrdReader(path).stream().to_chunks():
            self.chunks.setdefault(chunk.entity_path, []).append(chunk)

    def rows(self, entity: str) -> int:
        return sum(chunk.num_rows for chunk in self.chunks.get(entity, []) if not chunk.is_static)

    def text(self, entity: str) -> str:
        return self._cells(entity, "text")[-1]

    def images(self, entity: str) -> list[bytes]:
        return [bytes(blob) for blob in self._cells(entity, "blob")]

    def seconds(self, entity: str) -> list[float]:
        """Times [s] of an entity's rows since the contact."""
        return [
            time.total_seconds()
            for chunk in self.chunks[entity]
            if not chunk.is_static
            for time in chunk.to_record_batch().column("since_contact").to_pylist()
        ]

    def _cells(self, entity: str, ending: str) -> list:
        batches = [chunk.to_record_batch() for chunk in self.chunks[entity]]
        return [
            row[0]
            for b in batches
            for name in b.schema.names
            if name.endswith(ending)
            for row in b.column(name).to_pylist()
        ]
