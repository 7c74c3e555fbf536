"""Sparse local copies of recordings in a bucket: all but the images outside the strikes' windows.

A strike's window is the span of time that is recorded around it. Bytes that are not fetched are a hole in a
file of full length, which takes no disk space and needs no special reader. No reader touches a hole: the MCAP
file's summary lists the place of every chunk (block of messages), and images are read in the strikes' windows
only.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import fsspec
from fsspec.core import url_to_fs

from analyze.batch.archive import Source
from analyze.errors import RecordingCut, RecordingError, RecordingForeign
from analyze.reading.recording import open_recording
from schemas.mcap import records as container
from schemas.mcap.chunks import ChunkEntry
from schemas.mcap.records import ContainerError
from schemas.mcap.summary import FOOTER_AND_MAGIC, EndsEarly, summary_start
from schemas.mcap.walk import walk
from schemas.topics import VIDEO_CHUNK_BYTES

FIRST_REQUEST_BYTES = 1 << 16
"""bytes fetched first, from the end of the file: enough for the summary of some hundred frames"""
MAX_GAP_BYTES = 1 << 18
"""largest gap [bytes] between two ranges fetched together: a request takes as long as fetching that many"""
MAX_REQUEST_BYTES = 1 << 25
"""largest request [bytes], which is held in memory"""


@dataclass(frozen=True)
class RemoteFile:
    """One remote file of a recording and its local copy, which is filled piece by piece."""

    system: fsspec.AbstractFileSystem
    path: str
    """path of the remote file in `system`"""
    size: int
    """size of the remote file [bytes]"""
    copy: Path
    """path of the local copy"""

    @property
    def url(self) -> str:
        """URL of the remote file with its protocol, for messages."""
        return self.path if "://" in self.path else str(self.system.unstrip_protocol(self.path))

    def fetch_all(self) -> None:
        """Fetch the whole remote file into the local copy, which is created if missing.

        Raises:
            RecordingCut: the file became shorter meanwhile.
            OSError: the file cannot be fetched.
        """
        self.copy.touch()
        self.fetch([(0, self.size)])

    def fetch(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Fetch byte ranges [start, stop) into the local copy, which must exist; near ranges are merged.

        Raises:
            RecordingCut: the remote file became shorter meanwhile.
            OSError: the remote file cannot be fetched.
        """
        with self.copy.open("r+b") as file:
            for start, stop in _merged(ranges):
                data = self._bytes(start, stop)
                assert isinstance(data, bytes)  # noqa: S101 - cat_file of one path returns bytes
                if len(data) != stop - start:
                    raise RecordingCut(f"{self.url}: ends early: it changed while it was read: try again")
                file.seek(start)
                file.write(data)

    def _bytes(self, start: int, stop: int) -> object:
        try:
            return self.system.cat_file(self.path, start=start, end=stop)
        except MemoryError:
            raise
        except FileNotFoundError:
            raise OSError(f"{self.url}: no longer exists: it was removed or renamed meanwhile") from None
        except Exception as error:  # every protocol's library has its own
            text = " ".join(str(error).split())
            raise OSError(f"{self.url}: cannot be fetched: {text}: try again with --only-failed") from None


@contextmanager
def sparse_copies(
    source: Source, folder: Path, *, whole: bool = False, images: bool = True
) -> Iterator[Path]:
    """Copy a recording from a bucket for the duration of a `with` block.

    Args:
        source: recording in the bucket.
        folder: folder for the copies, which are removed at the end.
        whole: True to fetch every byte, which verifying the content hash needs; False to leave out images
            outside the strikes' windows.
        images: False to leave out all images, unless `whole`.

    Yields:
        Local path of the recording's first file.

    Raises:
        OSError: the recording cannot be fetched.
        RecordingError: the recording is damaged, cut short, or in another format.
    """
    copies: list[Path] = []
    try:
        remotes: list[tuple[RemoteFile, list[ChunkEntry]]] = []
        for each in source.files:
            system, path = url_to_fs(each.url)
            copy = folder / each.url.rsplit("/", 1)[-1]
            copies.append(copy)
            remote = RemoteFile(system, path, each.size, copy)
            if whole:
                remote.fetch_all()
                continue
            remotes.append((remote, fetch_without_images(remote, each.url)))
        if images and not whole:
            _fetch_windows(copies[0], remotes)
        yield copies[0]
    finally:
        for copy in copies:
            copy.unlink(missing_ok=True)


def _fetch_windows(first: Path, remotes: Sequence[tuple[RemoteFile, list[ChunkEntry]]]) -> None:
    """Fetch the image chunks that overlap a strike's window into the local copies.

    A chunk before these is fetched too if it has the full size of a video chunk, and so on back to the first
    smaller one: a video with no recent key picture continues from chunk to chunk, and is decoded from there.

    Args:
        first: copy of the recording's first file, without its images.
        remotes: each file with its image chunks in the order of the file.

    Raises:
        RecordingError: the recording cannot be read.
        OSError: the images cannot be fetched.
    """
    with open_recording(first) as recording:
        windows = [(strike.window_start_ns, strike.window_end_ns) for strike in recording.strikes]
    for remote, chunks in remotes:
        wanted: list[ChunkEntry] = []
        needed = False
        for chunk in reversed(chunks):
            # A video without a key picture for long continues from one chunk of this size into the next:
            # decoding needs the chunks before it too.
            goes_on = needed and chunk.end - chunk.offset >= VIDEO_CHUNK_BYTES
            needed = goes_on or any(chunk.start_ns <= end and chunk.end_ns >= start for start, end in windows)
            wanted += [chunk] if needed else []
        remote.fetch([(chunk.offset, chunk.end) for chunk in wanted])


def fetch_without_images(remote: RemoteFile, url: str) -> list[ChunkEntry]:
    """Fetch a file except its image chunks, and write empty message indexes for these into the copy.

    Readers look at the indexes of a chunk even if they skip the chunk.

    Args:
        remote: the file; its copy is created or overwritten.
        url: its URL, for messages.

    Returns:
        The image chunks: those whose messages are all of topics that end in "/image".

    Raises:
        RecordingError: the file is damaged, cut short, or in another format.
        OSError: the file cannot be fetched.
    """
    with remote.copy.open("wb") as file:
        file.truncate(remote.size)
    magic = len(container.MAGIC)
    tail = max(magic, remote.size - FIRST_REQUEST_BYTES)
    remote.fetch([(0, min(magic, remote.size)), (min(tail, remote.size), remote.size)])
    start = _summary_start(remote, url)
    if start < remote.size - FIRST_REQUEST_BYTES:
        remote.fetch([(start, remote.size - FIRST_REQUEST_BYTES)])
    try:
        chunks, topics, others = _parse_summary(remote, start)
    except (ContainerError, struct.error) as error:
        raise RecordingError(f"{url}: damaged: {error}: `acquire recover` saves what can be read") from None
    images = {channel for channel, topic in topics.items() if topic.endswith("/image")}
    of_images = [chunk for chunk in chunks if chunk.index_offsets and chunk.index_offsets.keys() <= images]
    small = [chunk for chunk in chunks if not (chunk.index_offsets and chunk.index_offsets.keys() <= images)]
    remote.fetch([*others, *((chunk.offset, chunk.end) for chunk in small)])
    # A reader looks at a chunk's head even if it skips the chunk, and at its indexes. Both are left empty
    # here, by which `IndexedFile` knows a chunk that was left out. A small chunk may have been fetched with
    # its neighbours: its head is emptied too.
    with remote.copy.open("r+b") as file:
        for chunk in of_images:
            file.seek(chunk.offset)
            file.write(bytes([container.CHUNK]) + bytes(container.RECORD_HEAD - 1))
            for channel, at in chunk.index_offsets.items():
                file.seek(at)
                file.write(container.pack_message_index(channel, []))
    return of_images


def _summary_start(remote: RemoteFile, url: str) -> int:
    magic = len(container.MAGIC)
    with remote.copy.open("rb") as file:
        if file.read(magic) != container.MAGIC:
            raise RecordingForeign(f"{url}: is not a recording: it does not begin like an MCAP file")
        file.seek(max(0, remote.size - FOOTER_AND_MAGIC))
        tail = file.read()
    try:
        return summary_start(tail, remote.size)[0]
    except EndsEarly:
        raise RecordingCut(
            f"{url}: ends early: it was cut short or is still being written: fetch it and use "
            "`acquire recover`"
        ) from None


def _parse_summary(
    remote: RemoteFile, start: int
) -> tuple[list[ChunkEntry], dict[int, str], list[tuple[int, int]]]:
    """Read the summary of an MCAP file from its local copy.

    Args:
        remote: the file, whose copy holds the summary.
        start: offset of the summary [bytes].

    Returns:
        Chunks; topics by channel id; and byte ranges [start, stop) of attachments and metadata.

    Raises:
        ContainerError: the summary is damaged, or points outside the file.
    """
    with remote.copy.open("rb") as file:
        file.seek(start)
        summary = memoryview(file.read(remote.size - FOOTER_AND_MAGIC - start))
    chunks: list[ChunkEntry] = []
    topics: dict[int, str] = {}
    others: list[tuple[int, int]] = []
    for opcode, _, body in walk(summary):
        if opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            topics[channel.id] = channel.topic
        elif opcode == container.CHUNK_INDEX:
            chunks.append(_parse_chunk_entry(body, remote.size))
        elif opcode in {container.ATTACHMENT_INDEX, container.METADATA_INDEX}:
            offset, length = struct.unpack_from("<QQ", body)
            if offset + length > remote.size:
                raise ContainerError("the summary points outside the file")
            others.append((offset, offset + length))
    return chunks, topics, others


def _parse_chunk_entry(body: memoryview, file_size: int) -> ChunkEntry:
    entry = ChunkEntry.parse(body)
    chunk_end = entry.offset + entry.length
    if entry.end > file_size or any(not chunk_end <= at < entry.end for at in entry.index_offsets.values()):
        raise ContainerError("the summary points outside the file")
    return entry


def _merged(ranges: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Yield byte ranges [start, stop) that cover the given ones, few and of MAX_REQUEST_BYTES at most.

    Ranges that lie at most MAX_GAP_BYTES apart are merged, with the gap, while the sum fits into one request;
    a range larger than one request is divided.
    """
    start = stop = -1
    for each_start, each_stop in sorted(ranges):
        if (
            start >= 0
            and each_start - stop <= MAX_GAP_BYTES
            and max(stop, each_stop) - start <= MAX_REQUEST_BYTES
        ):
            stop = max(stop, each_stop)
            continue
        if start >= 0:
            yield from _parts(start, stop)
        start, stop = each_start, each_stop
    if start >= 0:
        yield from _parts(start, stop)


def _parts(start: int, stop: int) -> Iterator[tuple[int, int]]:
    yield from ((at, min(at + MAX_REQUEST_BYTES, stop)) for at in range(start, stop, MAX_REQUEST_BYTES))
