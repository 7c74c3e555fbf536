"""A topic of images as a source: of a Foxglove MCAP file or a ROS 2 bag.

Times are those in the messages' headers, as a camera's driver set them, where they are set and rise; else the log times, at which the
recorder received the messages. Video is decoded in the order in which its messages stand in the file; where later pictures were coded
first (B-frames, which foxglove.CompressedVideo forbids) times must rise in the order in which they are shown.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from analyze.cameras.foreign_calibrations import calibration_of
from analyze.errors import CalibrationError, ImportRefused
from analyze.reading.compressed_video import decoded
from analyze.reading.indexed_file import RecordedMessage
from analyze.sources import pictures
from analyze.sources.image_file import image_file, is_image_file
from analyze.sources.message_files import Logged, MessageFile, Topic, open_message_file
from analyze.sources.pace import usual_interval
from analyze.sources.pictures import CodedPicture, Picture, grey_of, is_read, picture_of
from analyze.sources.source import TimedFile, TimedImage
from analyze.sources.video_units import video_units
from analyze.types import Array
from schemas.mcap.records import ContainerError
from schemas.session_manifest import CameraCalibrationSpec, TimeSource

_LOOKED_AT = 200
"""messages from which it is told whether headers hold times, and how evenly frames come"""
_MARGIN_NS = 2_000_000_000
"""by which a message may be logged earlier or later than its header says, beside what the first one is"""
_LEAST_DECODED = 0.8
"""of a video's pictures, at least: fewer where they stand in another order than that of decoding"""
_LEAST_SD_NS = 1_000
_CALIBRATIONS = {("cdr", "sensor_msgs/msg/CameraInfo"), ("protobuf", "foxglove.CameraCalibration"), ("json", "foxglove.CameraCalibration")}
_MOST_NAMED = 6


class _Timed(Protocol):
    @property
    def time_ns(self) -> int: ...


_Image = TypeVar("_Image", bound=_Timed)


class TopicSource:
    """Images of one topic.

    Args:
        path: an MCAP file, a bag's folder or its .db3.
        topic: its name; None: the only one with images.

    Raises:
        ImportRefused: the file cannot be read, has no such topic, or holds several and none is named.
    """

    def __init__(self, path: Path, topic: str | None = None) -> None:
        self._file: MessageFile = open_message_file(path)
        self._all = self._file.topics()
        self._topic = _chosen(path, self._all, topic)
        self.path = path
        self.name = f"{path.name}:{self._topic.name}"
        self.frame_count = self._topic.count
        self._remarks: dict[str, str] = {}
        self._is_video = self._topic.schema == pictures.VIDEO
        first, stamps, logs = self._looked_at()
        self._by_header = _rise(stamps) and stamps[0] > 0
        times = stamps if self._by_header else logs
        if len(set(times)) < 2:
            raise ImportRefused(f"{self.name}: all its messages have the same time: record it anew, with a clock that runs")
        self._start_ns, self._logged_ns = times[0], logs[0]
        self.time_source = TimeSource.CONTAINER_PTS if self._by_header else TimeSource.HOST_ARRIVAL
        self.time_sd_ns = _scatter_ns(times)
        self.rate_hz = 1e9 / usual_interval(times)
        self.wall_start_ns: int | None = self._start_ns if self._by_header else self._logged_ns
        if not self._by_header:
            why = "are not set" if not any(stamps) else "do not rise"
            self._remarks["times"] = f"{self.name}: its header stamps {why}: log times are taken, ± {1e-6 * self.time_sd_ns:.2g} ms"
        self.height, self.width = first.shape
        picture = next(self._pictures())[1]
        self.is_coded = isinstance(picture, CodedPicture)
        self.holds_files = not self._is_video and isinstance(picture, CodedPicture) and is_image_file(picture.data)

    @property
    def remarks(self) -> tuple[str, ...]:
        """See FrameSource."""
        return tuple(self._remarks.values())

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """See FrameSource."""
        for frame in self._rising(self._images(start_ns, end_ns)):
            height, width = frame.image.shape
            self._refuse_other_size(frame.time_ns, width, height)
            yield frame

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """See FrameSource."""
        for each in self._rising(self._files(start_ns, end_ns)):
            self._refuse_other_size(each.time_ns, each.file.width, each.file.height)
            yield each

    def calibration(self) -> tuple[CameraCalibrationSpec, str] | None:
        """What the file says of the topic's camera, and on which topic; None where it says nothing.

        Raises:
            CalibrationError, DocumentError: of a lens of a kind that is not read.
        """
        namespace = self._topic.name.rsplit("/", 1)[0]
        said = [topic for topic in self._all if (topic.encoding, topic.schema) in _CALIBRATIONS]
        near = [topic for topic in said if topic.name.rsplit("/", 1)[0] in {namespace, namespace.rsplit("/", 1)[0]}] or said
        if len(near) != 1:
            return None
        message = next(iter(self._file.messages(near[0])), None)
        if message is None:
            return None
        where = f"{self.path}:{near[0].name}"
        try:
            fields = pictures.camera_info(near[0].encoding, near[0].schema, message.data)
        except ContainerError as error:
            raise CalibrationError(f"{where}: {error}") from None
        return calibration_of(fields, where)[0], near[0].name

    def close(self) -> None:
        """Nothing is open between two readings."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # --- messages -------------------------------------------------------------------------------------------------

    def _pictures(self, log_from: int | None = None, log_to: int | None = None) -> Iterator[tuple[Logged, Picture]]:
        found = self._messages(log_from, log_to)
        if not self._is_video:
            yield from found
            return
        try:
            yield from video_units((message, picture) for message, picture in found if isinstance(picture, CodedPicture))
        except ContainerError as error:
            raise ImportRefused(f"{self.name}: {error}") from None

    def _messages(self, log_from: int | None, log_to: int | None) -> Iterator[tuple[Logged, Picture]]:
        for message in self._file.messages(self._topic, log_from, log_to, as_written=self._is_video):
            try:
                yield message, picture_of(self._topic.encoding, self._topic.schema, message.data)
            except ContainerError as error:
                raise ImportRefused(f"{self.name}: {error}: the file is damaged") from None

    def _between(self, start_ns: int | None, end_ns: int | None) -> Iterator[tuple[int, Picture]]:
        """Time since the start and picture of the messages in a range; of a video of all before it too, which its decoder needs."""
        margin = _MARGIN_NS if self._by_header or self._is_video else 0
        log_from = None if start_ns is None or self._is_video else max(self._logged_ns + start_ns - margin, 0)
        log_to = None if end_ns is None else max(self._logged_ns + end_ns + margin, 0)
        for message, picture in self._pictures(log_from, log_to):
            time_ns = self._time_ns(message, picture)
            if self._is_video or _lies_in(time_ns, start_ns, end_ns):
                yield time_ns, picture

    def _images(self, start_ns: int | None, end_ns: int | None) -> Iterator[TimedImage]:
        found = self._between(start_ns, end_ns)
        try:
            if self._is_video:
                last, last_ns = -1, -1
                for frame in decoded(self._as_recorded(found)):
                    if frame.sequence < last and frame.time_ns <= last_ns:
                        raise self._no_times()
                    last, last_ns = max(last, frame.sequence), max(last_ns, frame.time_ns)
                    if _lies_in(frame.time_ns, start_ns, end_ns):
                        yield TimedImage(frame.time_ns, frame.image)
                return
            for time_ns, picture in found:
                yield TimedImage(time_ns, grey_of(picture))
        except ContainerError as error:
            raise ImportRefused(f"{self.name}: {error}") from None

    def _files(self, start_ns: int | None, end_ns: int | None) -> Iterator[TimedFile]:
        for time_ns, picture in self._between(start_ns, end_ns):
            file = image_file(picture.data) if isinstance(picture, CodedPicture) else None
            if file is None:
                raise ImportRefused(f"{self.name}: an image at {1e-9 * time_ns:.3f} s cannot be decoded")
            yield TimedFile(time_ns, file)

    def _rising(self, found: Iterator[_Image]) -> Iterator[_Image]:
        last_ns, behind = -1, 0
        for each in found:
            if each.time_ns <= last_ns:
                behind += 1
                continue
            last_ns = each.time_ns
            yield each
        if behind:
            self._remarks["behind"] = f"{self.name}: {behind} images that are stamped earlier than one before them are left out"

    def _refuse_other_size(self, time_ns: int, width: int, height: int) -> None:
        if (width, height) != (self.width, self.height):
            sizes = f"{width} x {height} px, the first {self.width} x {self.height}"
            raise ImportRefused(f"{self.name}: an image at {1e-9 * time_ns:.3f} s has {sizes}: import a topic of one size")

    def _as_recorded(self, found: Iterator[tuple[int, Picture]]) -> Iterator[RecordedMessage]:
        for number, (time_ns, picture) in enumerate(found):
            if isinstance(picture, CodedPicture):
                yield RecordedMessage(self._topic.name, time_ns, number, memoryview(pictures.as_video(picture)))

    def _time_ns(self, message: Logged, picture: Picture) -> int:
        """Since the source's start."""
        return (picture.stamp_ns if self._by_header else message.log_ns) - self._start_ns

    def _looked_at(self) -> tuple[NDArray[np.uint8], list[int], list[int]]:
        """The first image, and header stamps and log times [ns] of the first messages."""
        found = [(picture.stamp_ns, message.log_ns) for message, picture in islice(self._pictures(), _LOOKED_AT)]
        if self._is_video and not found:
            raise ImportRefused(f"{self.name}: no key picture brings its parameter sets, with which a decoder begins: repeat them")
        if len(found) < 2:
            raise ImportRefused(f"{self.name}: holds {len(found)} images: a strike has more")
        self._by_header, self._start_ns, self._logged_ns = False, found[0][1], found[0][1]
        if self._is_video:
            first, shown = self._first_shown(len(found))
            self._note_late(found[0][1])
            stamps, logs = ([found[number][which] for number in shown] for which in (0, 1))
            if shown != sorted(shown) and not _rise(stamps) and not _rise(logs):
                raise self._no_times()
            return first, stamps, logs
        image = next(self._images(None, None)).image
        return image, [stamp_ns for stamp_ns, _ in found], [log_ns for _, log_ns in found]

    def _first_shown(self, count: int) -> tuple[NDArray[np.uint8], list[int]]:
        """A video's first image, and the numbers of the first `count` coded pictures in the order in which they are shown."""
        first, shown = None, list[int]()
        numbered = ((number, picture) for number, (_, picture) in enumerate(islice(self._pictures(), count)))
        try:
            for frame in decoded(self._as_recorded(numbered)):
                first = frame.image.copy() if first is None else first
                shown.append(frame.sequence)
        except ContainerError as error:
            raise ImportRefused(f"{self.name}: {error}") from None
        if first is None or len(shown) < _LEAST_DECODED * count:
            raise ImportRefused(
                f"{self.name}: of its first {count} pictures {len(shown)} can be decoded in the file's order: were its messages sorted "
                "by time, or some left out? Record it anew, without B-frames"
            )
        return first, shown

    def _note_late(self, log_ns: int) -> None:
        """Say what comes before the first picture that can be decoded."""
        first_ns = next(self._messages(None, None))[0].log_ns
        if log_ns > first_ns:
            self._remarks["late"] = f"{self.name}: its first {1e-9 * (log_ns - first_ns):.2f} s are left out: no key picture begins them"

    def _no_times(self) -> ImportRefused:
        return ImportRefused(
            f"{self.name}: holds B-frames, which foxglove.CompressedVideo forbids, and the times of its messages are not those of its "
            "pictures: record it anew, without B-frames (x264: bf=0, or tune=zerolatency)"
        )


def _chosen(path: Path, topics: list[Topic], name: str | None) -> Topic:
    images = [topic for topic in topics if is_read(topic.encoding, topic.schema) and topic.count != 0]
    listed = ", ".join(topic.name for topic in images[:_MOST_NAMED]) + (", ..." if len(images) > _MOST_NAMED else "")
    if name is None:
        if len(images) == 1:
            return images[0]
        if images:
            raise ImportRefused(f"{path}: holds {len(images)} topics of images: say which with --topic: {listed}")
        others = sorted({topic.schema or topic.encoding for topic in topics})
        held = ", ".join(others[:_MOST_NAMED]) or "nothing"
        raise ImportRefused(f"{path}: holds no images that are read (of Foxglove: protobuf or JSON; of ROS 2: CDR), but {held}")
    found = next((topic for topic in images if topic.name == name), None)
    if found is None:
        another = next((topic for topic in topics if topic.name == name), None)
        what = (
            "holds no such topic" if another is None else f"its messages are {another.schema or another.encoding}, no images that are read"
        )
        raise ImportRefused(f"{path}: --topic {name}: {what}: it has {listed or 'no images'}")
    return found


def _lies_in(time_ns: int, start_ns: int | None, end_ns: int | None) -> bool:
    return (start_ns is None or time_ns >= start_ns) and (end_ns is None or time_ns <= end_ns)


def _rise(times: list[int]) -> bool:
    return all(earlier < later for earlier, later in pairwise(times))


def _scatter_ns(times: list[int]) -> int:
    """1 sigma of a time stamp, by how unevenly frames that come evenly are stamped; a lost frame is none of it."""
    second: Array = np.diff(np.array(times, dtype=np.int64), 2).astype(np.float64)
    if len(second) == 0:
        return _LEAST_SD_NS
    return max(_LEAST_SD_NS, round(1.4826 * float(np.median(np.abs(second))) / 6**0.5))
