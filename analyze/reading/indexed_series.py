"""Reads messages of a recording in several files (a series), by topic and time over all files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analyze.errors import RecordingCut, RecordingError
from analyze.reading.file_series import SeriesFiles, final_path
from analyze.reading.indexed_file import IndexedFile, RecordedMessage
from analyze.reading.time_range import index_range


@dataclass(frozen=True)
class SeriesIndex:
    """Log times [ns] of a topic's messages in all files of a recording, and the file that has each.

    The messages are in order of log time; those of equal time keep the order of the files.
    """

    time_ns: NDArray[np.int64]
    """(n,) log times [ns]"""
    file: NDArray[np.int64]
    """(n,) number of the file among the series' files, from 0"""
    number: NDArray[np.int64]
    """(n,) number of the message in the topic's index (`TopicIndex`) of that file"""


class IndexedSeries:
    """Memory-mapped files of one recording, in their order; views of them stay valid after `close`."""

    def __init__(self, files: Sequence[IndexedFile]) -> None:
        self.files = tuple(files)
        self._indexes: dict[str, SeriesIndex] = {}

    def release_memory(self) -> None:
        """Return cached pages of the mapped files to the system; views read them again when used."""
        for file in self.files:
            file.release_memory()

    def close(self) -> None:
        """Unmap the files; a file stays mapped while views of its bytes are in use."""
        self._indexes.clear()
        for file in self.files:
            file.close()

    def topic_names(self) -> tuple[str, ...]:
        """Names of all topics, in the order of files and channels, each once."""
        return tuple(dict.fromkeys(name for file in self.files for name in file.topic_names()))

    def schema_of(self, topic: str) -> str:
        """Full name of the topic's message type, "" if unknown."""
        return next((schema for file in self.files if (schema := file.schema_of(topic))), "")

    def index(self, topic: str) -> SeriesIndex:
        """Positions of the topic's messages over all files, read once and kept; empty for an unknown topic.

        Raises:
            RecordingError: a file is damaged.
        """
        if topic not in self._indexes:
            times = [file.index(topic).time_ns for file in self.files]
            time_ns = np.concatenate(times)
            file = np.repeat(np.arange(len(times)), [len(each) for each in times])
            number = np.concatenate([np.arange(len(each)) for each in times])
            order = np.argsort(time_ns, kind="stable")
            self._indexes[topic] = SeriesIndex(time_ns[order], file[order], number[order])
        return self._indexes[topic]

    def messages(
        self, topic: str, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """Yield a topic's messages by log time; none for an unknown topic.

        Args:
            topic: name of the topic.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.

        Raises:
            RecordingError: a file is damaged.
        """
        index = self.index(topic)
        for at in range(*index_range(index.time_ns, start_ns, end_ns)):
            yield self._message(topic, index, at)

    def messages_to_decode(
        self,
        topic: str,
        start_ns: int | None,
        end_ns: int | None,
        is_start: Callable[[RecordedMessage], bool],
    ) -> Iterator[RecordedMessage]:
        """Yield the messages of a video that a decoder needs for a range of times, in file order.

        File order is that of the series' files and of the messages in them; their times need not increase. A
        message suits as the start if a decoder can begin with it (`is_start`) and its time is not after the
        earliest in the range. The search for it goes back in file order from the first message in the range,
        that one included, and takes the first that suits; if none does, the topic's first message. The
        messages run from there to the last one in the range. An empty range yields none.

        Args:
            topic: topic of the video.
            start_ns: earliest log time [ns], included; None for no limit.
            end_ns: latest log time [ns], included; None for no limit.
            is_start: returns True if a decoder can begin with a message; its errors are passed on.

        Raises:
            RecordingError: a file is damaged.
        """
        index = self.index(topic)
        first, last = index_range(index.time_ns, start_ns, end_ns)
        if first >= last:
            return
        order = self._file_order(topic, index)
        wanted = np.flatnonzero((order >= first) & (order < last))
        begin, end = int(wanted[0]), int(wanted[-1])
        while begin > 0 and not (
            order[begin] <= first and is_start(self._message(topic, index, int(order[begin])))
        ):
            begin -= 1
        for at in order[begin : end + 1]:
            yield self._message(topic, index, int(at))

    def _message(self, topic: str, index: SeriesIndex, at: int) -> RecordedMessage:
        file = self.files[int(index.file[at])]
        message = file.message(file.index(topic), int(index.number[at]))
        return RecordedMessage(topic, message.log_time_ns, message.sequence, message.data)

    def _file_order(self, topic: str, index: SeriesIndex) -> NDArray[np.intp]:
        """Indices (n,) that put a topic's messages, as listed in `index`, in their order in the files.

        That is the order by file, chunk and offset.
        """
        chunk, offset = np.empty_like(index.number), np.empty_like(index.number)
        for number, file in enumerate(self.files):
            own = index.file == number
            chunk[own] = file.index(topic).chunk[index.number[own]]
            offset[own] = file.index(topic).offset[index.number[own]]
        return np.lexsort((offset, chunk, index.file))

    def first_times(self, topic: str) -> list[int]:
        """Log time [ns] of the topic's earliest message in each file that has one, in the files' order.

        Raises:
            RecordingError: a file is damaged.
        """
        return [int(times[0]) for file in self.files if len(times := file.index(topic).time_ns)]


def open_series(path: Path, series: SeriesFiles, open_file: Callable[[Path], IndexedFile]) -> IndexedSeries:
    """Open every file of a recording with `open_file`; return them as one series.

    Args:
        path: the file that the user named, for error messages.
        series: files of the recording that `path` belongs to.
        open_file: opens one file; `open_finished` or `open_cut`.

    Raises:
        RecordingCut: `open_file` found that a file ends early; the message says how to recover it.
        RecordingError: a file is missing, cannot be read, is not MCAP (RecordingForeign), or is damaged.
    """
    files: list[IndexedFile] = []
    try:
        for file in series.files:
            try:
                files.append(open_file(file))
            except RecordingCut as error:
                if file == path:
                    raise
                final = final_path(file)
                remedy = f"-o {final}`" if final != file else "-o NEW.mcap`, and put that in its place"
                raise RecordingCut(
                    f"{path}: {file.name} of the same recording was cut short or is still being written: "
                    f"`acquire recover {file} {remedy}"
                ) from error
    except RecordingError:
        IndexedSeries(files).close()
        raise
    return IndexedSeries(files)


def series_content_id(content_ids: Sequence[str | None]) -> str | None:
    """Content id (hash of all messages outside /truth/) of a recording, from the ids of its files.

    Args:
        content_ids: hexadecimal content id that each file's seal (checksum record) states, in order; None for
            a file without one.

    Returns:
        The id of the only file; for several files BLAKE2b-256 over their hexadecimal ids; None if any file
        has none.
    """
    known = [each for each in content_ids if each is not None]
    if len(known) < len(content_ids):
        return None
    if len(known) == 1:
        return known[0]
    return hashlib.blake2b("".join(known).encode("ascii"), digest_size=32).hexdigest()
