"""A recording in a bucket, brought here by ranges: all of it but the images, and of these what lies in the strikes' windows.

What is not fetched is a hole in a file of the same length, which costs no disk; so whoever reads it reads it as any other file. Nothing
looks into a hole: the summary says where every chunk is, and images are only read in the windows.
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
from schemas.mcap.records import ContainerError
from schemas.topics import VIDEO_CHUNK_BYTES

_TAIL = 1 << 16
"""bytes asked for at first: the summary of some hundred frames"""
_TOGETHER = 1 << 18
"""a gap below which two ranges are one request: a request costs as much as this many bytes"""
_MOST = 1 << 25
"""bytes of one request: that much is held in memory"""


@dataclass(frozen=True)
class _Chunk:
    """Where a chunk and its message indexes lie, and when its messages are."""

    start_ns: int
    end_ns: int
    offset: int
    end: int
    """of its message indexes, which follow it"""
    indexes: dict[int, int]
    """where each channel's begins"""


@dataclass
class _Remote:
    """A file of the row: its bytes there, and its copy here."""

    system: fsspec.AbstractFileSystem
    path: str
    size: int
    copy: Path
    fetched: int = 0
    """bytes"""

    @property
    def url(self) -> str:
        """For messages: with its protocol."""
        return self.path if "://" in self.path else str(self.system.unstrip_protocol(self.path))

    def fetch_all(self) -> None:
        """Bring all of it here."""
        self.copy.touch()
        self.fetch([(0, self.size)])

    def fetch(self, ranges: Sequence[tuple[int, int]]) -> None:
        """Bring [start, stop) ranges here, near ones together."""
        with self.copy.open("r+b") as file:
            for start, stop in _joined(ranges):
                data = self._bytes(start, stop)
                assert isinstance(data, bytes)  # noqa: S101 - of one path it is
                if len(data) != stop - start:
                    raise RecordingCut(f"{self.url}: ends early: it changed while it was read: try again")
                file.seek(start)
                file.write(data)
                self.fetched += len(data)

    def _bytes(self, start: int, stop: int) -> object:
        try:
            return self.system.cat_file(self.path, start=start, end=stop)
        except MemoryError:
            raise
        except FileNotFoundError:
            raise OSError(f"{self.url}: is gone: it was removed or renamed meanwhile") from None
        except Exception as error:  # every protocol's library has its own
            text = " ".join(str(error).split())
            raise OSError(f"{self.url}: cannot be fetched: {text}: try again with --only-failed") from None


@contextmanager
def sparse_copies(source: Source, folder: Path, *, whole: bool = False) -> Iterator[Path]:
    """The recording's first file as a path; removed at the end.

    Args:
        source: what lies in the bucket.
        folder: where its copies are.
        whole: fetch every byte, as its seal needs it.

    Raises:
        OSError: it cannot be fetched.
        RecordingError: it is damaged.
    """
    copies: list[Path] = []
    try:
        remotes: list[tuple[_Remote, list[_Chunk]]] = []
        for each in source.files:
            system, path = url_to_fs(each.url)
            copy = folder / each.url.rsplit("/", 1)[-1]
            copies.append(copy)
            remote = _Remote(system, path, each.size, copy)
            if whole:
                remote.fetch_all()
                continue
            remotes.append((remote, _without_images(remote, each.url)))
        if not whole:
            _fetch_windows(copies[0], remotes)
        yield copies[0]
    finally:
        for copy in copies:
            copy.unlink(missing_ok=True)


def _fetch_windows(first: Path, remotes: Sequence[tuple[_Remote, list[_Chunk]]]) -> None:
    """The images of the strikes' windows; `first` is the copy of the first file, all but images there."""
    with open_recording(first) as recording:
        windows = [(strike.window_start_ns, strike.window_end_ns) for strike in recording.strikes]
    for remote, chunks in remotes:
        wanted: list[_Chunk] = []
        needed = False
        for chunk in reversed(chunks):
            # A video that has no key picture for long goes on from one chunk of this size to the next: what comes before is decoded too.
            goes_on = needed and chunk.end - chunk.offset >= VIDEO_CHUNK_BYTES
            needed = goes_on or any(chunk.start_ns <= end and chunk.end_ns >= start for start, end in windows)
            wanted += [chunk] if needed else []
        remote.fetch([(chunk.offset, chunk.end) for chunk in wanted])


def fetched_without_images(url: str, folder: Path) -> tuple[Path, int]:
    """A copy of a remote recording with everything but its images, and how many bytes were read for it."""
    system, path = url_to_fs(url)
    remote = _Remote(system, path, int(system.info(path)["size"]), folder / url.rsplit("/", 1)[-1])
    _without_images(remote, url)
    return remote.copy, remote.fetched


def _without_images(remote: _Remote, url: str) -> list[_Chunk]:
    """Fetch all but image chunks; these chunks."""
    with remote.copy.open("wb") as file:
        file.truncate(remote.size)
    magic = len(container.MAGIC)
    tail = max(magic, remote.size - _TAIL)
    remote.fetch([(0, min(magic, remote.size)), (min(tail, remote.size), remote.size)])
    start = _summary_start(remote, url)
    if start < remote.size - _TAIL:
        remote.fetch([(start, remote.size - _TAIL)])
    try:
        chunks, topics, others = _listed(remote, start)
    except (ContainerError, struct.error) as error:
        raise RecordingError(f"{url}: damaged: {error}: `acquire recover` saves what can be read") from None
    images = {channel for channel, topic in topics.items() if topic.endswith("/image")}
    of_images = [chunk for chunk in chunks if chunk.indexes and chunk.indexes.keys() <= images]
    small = [chunk for chunk in chunks if not (chunk.indexes and chunk.indexes.keys() <= images)]
    remote.fetch([*others, *((chunk.offset, chunk.end) for chunk in small)])
    # Whoever opens it looks at a chunk's first byte, whether it reads the chunk or not, and at its indexes, which here name no image.
    with remote.copy.open("r+b") as file:
        for chunk in of_images:
            file.seek(chunk.offset)
            file.write(bytes([container.CHUNK]))
            for channel, at in chunk.indexes.items():
                file.seek(at)
                file.write(struct.pack("<BQHI", container.MESSAGE_INDEX, 6, channel, 0))
    return of_images


def _summary_start(remote: _Remote, url: str) -> int:
    magic = len(container.MAGIC)
    with remote.copy.open("rb") as file:
        if file.read(magic) != container.MAGIC:
            raise RecordingForeign(f"{url}: is not a recording: it does not begin like an MCAP file")
        if remote.size < 2 * magic + container.FOOTER_SIZE:
            raise RecordingCut(f"{url}: ends early: it was cut short")
        file.seek(remote.size - magic - container.FOOTER_SIZE)
        footer = file.read()
    opcode, size, start = struct.unpack_from("<BQQ", footer)
    if footer[-magic:] != container.MAGIC or opcode != container.FOOTER or size != 20 or not 0 < start < remote.size:
        raise RecordingCut(f"{url}: ends early: it was cut short or is still being written: fetch it and use `acquire recover`")
    return int(start)


def _listed(remote: _Remote, start: int) -> tuple[list[_Chunk], dict[int, str], list[tuple[int, int]]]:
    """Chunks, topics by channel, and the ranges of attachments and metadata, as the summary lists them."""
    with remote.copy.open("rb") as file:
        file.seek(start)
        summary = memoryview(file.read(remote.size - len(container.MAGIC) - container.FOOTER_SIZE - start))
    chunks: list[_Chunk] = []
    topics: dict[int, str] = {}
    others: list[tuple[int, int]] = []
    for opcode, _, body in container.walk(summary):
        if opcode == container.CHANNEL:
            channel = container.parse_channel(body)
            topics[channel.id] = channel.topic
        elif opcode == container.CHUNK_INDEX:
            chunks.append(_chunk(body, remote.size))
        elif opcode in {container.ATTACHMENT_INDEX, container.METADATA_INDEX}:
            offset, length = struct.unpack_from("<QQ", body)
            if offset + length > remote.size:
                raise ContainerError("the summary points outside the file")
            others.append((offset, offset + length))
    return chunks, topics, others


def _chunk(body: memoryview, size: int) -> _Chunk:
    start_ns, end_ns, offset, length, table = struct.unpack_from("<QQQQI", body)
    if table > len(body) - 44 or table % 10:
        raise ContainerError("a chunk index record ends early")
    places = {int(channel): int(at) for channel, at in struct.iter_unpack("<HQ", body[36 : 36 + table])}
    (length_of_indexes,) = struct.unpack_from("<Q", body, 36 + table)
    end = offset + length + length_of_indexes
    if end > size or any(not offset + length <= at < end for at in places.values()):
        raise ContainerError("the summary points outside the file")
    return _Chunk(start_ns, end_ns, offset, end, places)


def _joined(ranges: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """The same bytes in fewer requests, none larger than may be held."""
    start = stop = -1
    for each_start, each_stop in sorted(ranges):
        if start >= 0 and each_start - stop <= _TOGETHER and max(stop, each_stop) - start <= _MOST:
            stop = max(stop, each_stop)
            continue
        if start >= 0:
            yield from _parts(start, stop)
        start, stop = each_start, each_stop
    if start >= 0:
        yield from _parts(start, stop)


def _parts(start: int, stop: int) -> Iterator[tuple[int, int]]:
    yield from ((at, min(at + _MOST, stop)) for at in range(start, stop, _MOST))
