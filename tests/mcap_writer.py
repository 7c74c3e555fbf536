"""Writer of one recording for tests: a `with` block, and messages of any topic one at a time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from acquire.recorder import writer
from acquire.recorder.channel import Channel
from acquire.recorder.messages import ImageMessage, SmallMessage
from schemas.mcap.records import Buffer


class McapWriter(writer.McapWriter):
    """Writer that finishes its recording at the end of a `with` block, and aborts it after an exception."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self.abort()
        elif not self._closed:
            self.finish()

    def write(
        self, channel: Channel, log_time_ns: int, data: Buffer | Sequence[Buffer], sequence: int = 0
    ) -> None:
        """Write one message, given whole or in parts."""
        parts = [data] if isinstance(data, bytes | bytearray | memoryview) else data
        if channel.topic.image:
            self.write_images(channel, [ImageMessage(log_time_ns, parts, sequence)])
        else:
            self.write_small(channel, [SmallMessage(log_time_ns, b"".join(parts), sequence)])
