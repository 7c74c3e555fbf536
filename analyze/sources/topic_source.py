"""Image source: a topic of images in an MCAP file or a ROS 2 bag.

Times are the headers' stamps, set by the camera's driver, if they are set and increase; else the log times,
at which the recorder received the messages. Video is decoded in file order; if later pictures were coded
first (B-frames, which foxglove.CompressedVideo forbids), times must increase in display order.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from analyze.errors import CalibrationError, ImportRefused
from analyze.reading.compressed_video import decode_video
from analyze.reading.indexed_file import RecordedMessage
from analyze.reading.time_range import is_within
from analyze.sources import pictures
from analyze.sources.choose_topic import choose_topic
from analyze.sources.foreign_calibrations import calibration_of
from analyze.sources.frame_timing import time_sd_ns, usual_interval
from analyze.sources.image_file import image_file, is_image_file
from analyze.sources.message_files import LoggedMessage, open_message_file
from analyze.sources.pictures import CodedPicture, Picture, grey_values, parse_picture
from analyze.sources.source import TimedFile, TimedImage
from analyze.sources.video_units import video_units
from schemas.mcap.records import ContainerError
from schemas.session_manifest import CameraCalibrationSpec, TimeSource
from schemas.wording import counted

EXAMINED_MESSAGES = 200
"""number of first messages examined to choose between stamps and log times and to measure the frame rate"""
LOG_MARGIN_NS = 2_000_000_000
"""largest change of the difference of log time and header stamp against that of the first message [ns]"""
MIN_DECODED_FRACTION = 0.8
"""least fraction of a video's first pictures that must decode; fewer do if the messages are not in decoding
order"""
_CALIBRATIONS = {
    ("cdr", "sensor_msgs/msg/CameraInfo"),
    ("protobuf", "foxglove.CameraCalibration"),
    ("json", "foxglove.CameraCalibration"),
}


_Image = TypeVar("_Image", TimedImage, TimedFile)


class TopicSource:
    """Source of the images of one topic of an MCAP file or ROS 2 bag.

    Args:
        path: an MCAP file, a bag's folder or its .db3 file.
        topic: name of the topic; None for the only one with images.

    Raises:
        ImportRefused: the file cannot be read, has no such topic, has several topics of images and none is
            named, or the topic has fewer than two images or times, or video that cannot be decoded.
    """

    def __init__(self, path: Path, topic: str | None = None) -> None:
        self._file = open_message_file(path)
        self._all = self._file.topics()
        self._topic = choose_topic(path, self._all, topic)
        self.path = path
        self.name = f"{path.name}:{self._topic.name}"
        self.frame_count = self._topic.count
        self._remarks: dict[str, str] = {}
        self._is_video = self._topic.schema == pictures.VIDEO
        first, stamps, logs = self._examine()
        self._by_header = _is_increasing(stamps) and stamps[0] > 0
        times = stamps if self._by_header else logs
        if len(set(times)) < 2:
            raise ImportRefused(
                f"{self.name}: all its messages have the same time: record it again with a running clock"
            )
        self._start_ns, self._logged_ns = times[0], logs[0]
        self.time_source = TimeSource.CONTAINER_PTS if self._by_header else TimeSource.HOST_ARRIVAL
        self.time_sd_ns = time_sd_ns(times)
        self.rate_hz = 1e9 / usual_interval(times)
        self.wall_start_ns: int | None = self._start_ns if self._by_header else self._logged_ns
        if not self._by_header:
            why = "are not set" if not any(stamps) else "do not increase"
            self._remarks["times"] = (
                f"{self.name}: its header stamps {why}: log times are used, ± {1e-6 * self.time_sd_ns:.2g} ms"
            )
        self.height, self.width = first.shape
        picture = next(self._pictures())[1]
        self.is_coded = isinstance(picture, CodedPicture)
        self.holds_files = (
            not self._is_video and isinstance(picture, CodedPicture) and is_image_file(picture.data)
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for the user on faults of the topic; complete once all images were read.

        Faults: log times used for want of header stamps, a video's start left out, images left out.
        """
        return tuple(self._remarks.values())

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Yield the decoded grey images with increasing times since the topic's first image.

        Images whose time is not after the previous one's are left out, with a remark.

        Args:
            start_ns: earliest time since the topic's first image [ns], included; None for no limit.
            end_ns: latest time since the topic's first image [ns], included; None for no limit.

        Raises:
            ImportRefused: the file is damaged, an image cannot be decoded or differs in size from the first,
                or a video's times are not in display order.
        """
        for frame in self._increasing(self._images(start_ns, end_ns)):
            height, width = frame.image.shape
            self._refuse_other_size(frame.time_ns, width, height)
            yield frame

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """Yield the images as PNG or JPEG files, with increasing times since the topic's first image.

        Images whose time is not after the previous one's are left out, with a remark.

        Args:
            start_ns: earliest time since the topic's first image [ns], included; None for no limit.
            end_ns: latest time since the topic's first image [ns], included; None for no limit.

        Raises:
            ImportRefused: the file is damaged, an image is no image file (but raw pixels), or it differs in
                size from the first.
        """
        for each in self._increasing(self._files(start_ns, end_ns)):
            self._refuse_other_size(each.time_ns, each.file.width, each.file.height)
            yield each

    def calibration(self) -> tuple[CameraCalibrationSpec, str] | None:
        """Read the calibration of the topic's camera from a calibration topic of the same file.

        Calibration topics in the image topic's namespace, or the namespace above it, are preferred to others.

        Returns:
            The calibration and its topic's name; None if there is no such topic or message, or the choice is
            not unique.

        Raises:
            CalibrationError, DocumentError: the message is damaged, or its lens cannot be used.
            ImportRefused: the file is damaged.
        """
        namespace = self._topic.name.rsplit("/", 1)[0]
        stated = [topic for topic in self._all if (topic.encoding, topic.schema) in _CALIBRATIONS]
        near = [
            topic
            for topic in stated
            if topic.name.rsplit("/", 1)[0] in {namespace, namespace.rsplit("/", 1)[0]}
        ] or stated
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

    # --- messages

    def _pictures(
        self, log_from: int | None = None, log_to: int | None = None
    ) -> Iterator[tuple[LoggedMessage, Picture]]:
        """Yield the topic's messages, each with its picture, which is not decoded.

        Of a video only whole pictures are yielded, from the first at which a decoder can begin. A picture
        that is split over messages comes with the first of them.

        Args:
            log_from: earliest log time [ns], included; None for no limit.
            log_to: latest log time [ns], included; None for no limit.

        Raises:
            ImportRefused: the file or a message is damaged, or a message of a video is not usable.
        """
        found = self._messages(log_from, log_to)
        if not self._is_video:
            yield from found
            return
        try:
            yield from video_units(
                (message, picture) for message, picture in found if isinstance(picture, CodedPicture)
            )
        except ContainerError as error:
            raise ImportRefused(f"{self.name}: {error}") from None

    def _messages(self, log_from: int | None, log_to: int | None) -> Iterator[tuple[LoggedMessage, Picture]]:
        """Yield the topic's messages between two log times [ns], each with its picture, not decoded.

        Both times are included; None stands for no limit.

        Raises:
            ImportRefused: the file or a message is damaged.
        """
        for message in self._file.messages(self._topic, log_from, log_to):
            try:
                yield message, parse_picture(self._topic.encoding, self._topic.schema, message.data)
            except ContainerError as error:
                raise ImportRefused(f"{self.name}: {error}: the file is damaged") from None

    def _between(self, start_ns: int | None, end_ns: int | None) -> Iterator[tuple[int, Picture]]:
        """Yield the topic's pictures in a range of times, each as (time [ns], picture), not decoded.

        All times are since the topic's first image; both ends are included, None stands for no limit. Of a
        video, all earlier pictures (which the decoder needs) and some later ones are yielded, too.
        """
        margin = LOG_MARGIN_NS if self._by_header or self._is_video else 0
        log_from = None if start_ns is None or self._is_video else max(self._logged_ns + start_ns - margin, 0)
        log_to = None if end_ns is None else max(self._logged_ns + end_ns + margin, 0)
        for message, picture in self._pictures(log_from, log_to):
            time_ns = (picture.stamp_ns if self._by_header else message.log_ns) - self._start_ns
            if self._is_video or is_within(time_ns, start_ns, end_ns):
                yield time_ns, picture

    def _images(self, start_ns: int | None, end_ns: int | None) -> Iterator[TimedImage]:
        """Yield the topic's decoded grey images between two times since its first image [ns].

        Both times are included; None stands for no limit. Increasing times and equal sizes are not checked.

        Raises:
            ImportRefused: the file is damaged, an image cannot be decoded, or a video's times are not in
                display order.
        """
        found = self._between(start_ns, end_ns)
        try:
            if self._is_video:
                last, last_ns = -1, -1
                for frame in decode_video(self._as_recorded(found)):
                    if frame.sequence < last and frame.time_ns <= last_ns:
                        raise self._unknown_times_error()
                    last, last_ns = max(last, frame.sequence), max(last_ns, frame.time_ns)
                    if is_within(frame.time_ns, start_ns, end_ns):
                        yield TimedImage(frame.time_ns, frame.image)
                return
            for time_ns, picture in found:
                yield TimedImage(time_ns, grey_values(picture))
        except ContainerError as error:
            raise ImportRefused(f"{self.name}: {error}") from None

    def _files(self, start_ns: int | None, end_ns: int | None) -> Iterator[TimedFile]:
        """Yield the topic's images as PNG or JPEG files, between two times since its first image [ns].

        Both times are included; None stands for no limit. Increasing times and equal sizes are not checked.

        Raises:
            ImportRefused: the file is damaged, or an image is no image file.
        """
        for time_ns, picture in self._between(start_ns, end_ns):
            file = image_file(picture.data) if isinstance(picture, CodedPicture) else None
            if file is None:
                raise ImportRefused(
                    f"{self.name}: an image at {1e-9 * time_ns:.3f} s cannot be decoded: the file is damaged"
                )
            yield TimedFile(time_ns, file)

    def _increasing(self, found: Iterator[_Image]) -> Iterator[_Image]:
        """Yield those images of `found` whose time is after that of the last one yielded.

        The others are left out; a remark with their number is added at the end.
        """
        last_ns, behind = -1, 0
        for each in found:
            if each.time_ns <= last_ns:
                behind += 1
                continue
            last_ns = each.time_ns
            yield each
        if behind:
            self._remarks["behind"] = (
                f"{self.name}: left out: {counted(behind, 'image')} with a stamp earlier than a previous one"
            )

    def _refuse_other_size(self, time_ns: int, width: int, height: int) -> None:
        if (width, height) != (self.width, self.height):
            sizes = f"{width} x {height} px, the first {self.width} x {self.height}"
            raise ImportRefused(
                f"{self.name}: an image at {1e-9 * time_ns:.3f} s has {sizes}: import a topic whose images "
                "have one size"
            )

    def _as_recorded(self, found: Iterator[tuple[int, Picture]]) -> Iterator[RecordedMessage]:
        """Yield coded pictures as messages of a recording, the form that the video decoder takes.

        Args:
            found: pairs of a picture's time [ns], which becomes its message's log time, and the picture. A
                message's sequence number is the place of its pair, from 0. Raw pictures give no message.
        """
        for number, (time_ns, picture) in enumerate(found):
            if isinstance(picture, CodedPicture):
                yield RecordedMessage(
                    self._topic.name, time_ns, number, memoryview(pictures.as_video(picture))
                )

    def _examine(self) -> tuple[NDArray[np.uint8], list[int], list[int]]:
        """Read the first image and the times of the first `EXAMINED_MESSAGES` images.

        The source's times are provisionally set to log times since the first image.

        Returns:
            The first image (height, width) uint8; the header stamps [ns] and the log times [ns] of the
            images. The times of a video are those of the pictures that decode, in display order.

        Raises:
            ImportRefused: there are fewer than two images, or video cannot be decoded or has wrong times.
        """
        found = [
            (picture.stamp_ns, message.log_ns)
            for message, picture in islice(self._pictures(), EXAMINED_MESSAGES)
        ]
        if self._is_video and not found:
            raise ImportRefused(
                f"{self.name}: no key picture contains the parameter sets that a decoder needs: record them "
                "with the key pictures"
            )
        if len(found) < 2:
            raise ImportRefused(
                f"{self.name}: contains {counted(len(found), 'image')}: a strike needs more: record it again"
            )
        self._by_header, self._start_ns, self._logged_ns = False, found[0][1], found[0][1]
        if self._is_video:
            first, shown = self._decode_first(len(found))
            self._note_skipped_start(found[0][1])
            stamps, logs = ([found[number][which] for number in shown] for which in (0, 1))
            if shown != sorted(shown) and not _is_increasing(stamps) and not _is_increasing(logs):
                raise self._unknown_times_error()
            return first, stamps, logs
        image = next(self._images(None, None)).image
        return image, [stamp_ns for stamp_ns, _ in found], [log_ns for _, log_ns in found]

    def _decode_first(self, count: int) -> tuple[NDArray[np.uint8], list[int]]:
        """Decode the first `count` coded pictures of a video.

        Returns:
            The first image (height, width) uint8; the numbers of the pictures that decode, in display order
            (a number is the picture's place in the file, from 0).

        Raises:
            ImportRefused: less than `MIN_DECODED_FRACTION` of the pictures decode, or decoding fails.
        """
        first, shown = None, list[int]()
        number_pictures = (
            (number, picture) for number, (_, picture) in enumerate(islice(self._pictures(), count))
        )
        try:
            for frame in decode_video(self._as_recorded(number_pictures)):
                first = frame.image.copy() if first is None else first
                shown.append(frame.sequence)
        except ContainerError as error:
            raise ImportRefused(f"{self.name}: {error}") from None
        if first is None or len(shown) < MIN_DECODED_FRACTION * count:
            raise ImportRefused(
                f"{self.name}: only {len(shown)} of its first {counted(count, 'picture')} can be decoded "
                "in the file's "
                "order: its messages were sorted by time, or some are missing: record it again without "
                "B-frames"
            )
        return first, shown

    def _note_skipped_start(self, log_ns: int) -> None:
        """Add a remark if a video's first pictures are left out because no key picture begins them.

        Args:
            log_ns: log time of the first picture that can be decoded [ns].
        """
        first_ns = next(self._messages(None, None))[0].log_ns
        if log_ns > first_ns:
            self._remarks["late"] = (
                f"{self.name}: its first {1e-9 * (log_ns - first_ns):.2f} s are left out: they have no key "
                "picture to begin with"
            )

    def _unknown_times_error(self) -> ImportRefused:
        return ImportRefused(
            f"{self.name}: contains B-frames, which foxglove.CompressedVideo forbids, and its messages' "
            "times are not those of its pictures: record it again without B-frames (x264: bf=0, or "
            "tune=zerolatency)"
        )


def _is_increasing(times: list[int]) -> bool:
    """True if every time is later than the one before."""
    return all(earlier < later for earlier, later in pairwise(times))
