"""The `content_id` of a recording: a hash of its messages, except those on topics under /truth/.

Messages are hashed per topic, in file order. The hash does not depend on chunking, compression, or the
interleaving of topics.
"""

from __future__ import annotations

import hashlib
import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import Final

from schemas.mcap.records import Buffer, ContainerError, pack_string
from schemas.mcap.walk import walk_messages
from schemas.topics import TRUTH_PREFIX

LARGE_MESSAGE_BYTES: Final = 4096
"""Size [bytes] from which on messages enter the hash by size and CRC-32."""

HashedMessage = tuple[int, int, Buffer, int | None]
"""Log time [ns], size, data, CRC-32 of the data.

The data of a large message may be empty if the CRC is given.
"""

_TIME_AND_SIZE: Final = struct.Struct("<QQ")
_TIME_SIZE_CRC: Final = struct.Struct("<QQI")


class ContentHash:
    """BLAKE2b-256 over all messages outside /truth/: one hash per topic, then one over the topics by name.

    A message enters its topic's hash with log time, size and data; from LARGE_MESSAGE_BYTES on with the
    CRC-32 of its data in place of the data (schemas/README.md, "A file").
    """

    def __init__(self) -> None:
        self._topics: dict[str, hashlib.blake2b] = {}

    def add(self, topic: str, log_time_ns: int, size: int, data: Buffer, crc: int | None = None) -> None:
        """Add one message to the hash; a message on a topic under /truth/ is ignored.

        Args:
            topic: name of the message's topic.
            log_time_ns: log time [ns].
            size: bytes of the data.
            data: serialised message; may be empty if `size` is at least LARGE_MESSAGE_BYTES and `crc` is
                given.
            crc: CRC-32 of the data; None to compute it. Messages below LARGE_MESSAGE_BYTES do not need it.
        """
        self.add_all(topic, [(log_time_ns, size, data, crc)])

    def add_all(self, topic: str, messages: Iterable[HashedMessage]) -> None:
        """Add several messages of one topic to the hash; those of a topic under /truth/ are ignored.

        Args:
            topic: name of the topic.
            messages: log time [ns], number of bytes, data, and CRC-32 of the data (None to compute it) of
                each message, in file order.
        """
        if topic.startswith(TRUTH_PREFIX):
            return
        digest = self._topics.get(topic)
        if digest is None:
            digest = self._topics[topic] = hashlib.blake2b(digest_size=32)
        parts: list[Buffer] = []
        for log_time_ns, size, data, crc in messages:
            if size < LARGE_MESSAGE_BYTES:
                parts += (_TIME_AND_SIZE.pack(log_time_ns, size), data)
            else:
                parts.append(_TIME_SIZE_CRC.pack(log_time_ns, size, zlib.crc32(data) if crc is None else crc))
        digest.update(b"".join(parts))

    def add_chunk(self, records: memoryview, topics: Mapping[int, str]) -> int:
        """Add every message of a chunk to the hash.

        Args:
            records: uncompressed message records of the chunk.
            topics: name of the topic by channel id.

        Returns:
            Number of all messages in the chunk, those of topics under /truth/ included.

        Raises:
            ContainerError: a message is damaged, or its channel is not in `topics`.
        """
        count = 0
        for _, message in walk_messages(records):
            topic = topics.get(message.channel_id)
            if topic is None:
                raise ContainerError(f"a message is on channel {message.channel_id}, which is not described")
            self.add(topic, message.log_time_ns, len(message.data), message.data)
            count += 1
        return count

    def hexdigest(self) -> str:
        """Hash of all messages added so far, as 64 hexadecimal digits."""
        digest = hashlib.blake2b(digest_size=32)
        for topic in sorted(self._topics):
            digest.update(pack_string(topic) + self._topics[topic].digest())
        return digest.hexdigest()
