"""Writes a prepared import as a recording.

If all sources are H.264 or H.265 videos, those with a strike are stored whole, as coded. Otherwise only the
images in the strikes' windows (parts of the sources) are stored.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from analyze.importing.log_times import LogTimes
from analyze.importing.manifest import CAMERA, attachments, manifest
from analyze.importing.prepared_import import PreparedImport
from analyze.importing.video_chunks import FULL_CHUNK_BYTES, OpenChunk
from analyze.importing.windows import StrikeWindow
from analyze.importing.writer import RecordingWriter
from analyze.progress import Progress, no_progress
from analyze.sources import image_messages
from analyze.sources.frame_timing import MissingFrames
from analyze.sources.image_messages import VideoMessages
from analyze.sources.picture_numbers import number_pictures
from analyze.sources.source import FrameSource
from analyze.sources.video import VideoSource
from schemas import topics
from schemas.calibration_message import calibration_message
from schemas.mcap.records import Buffer
from schemas.proto import percuss_pb2 as pb

DEFAULT_START_NS = 946_684_800 * 10**9
"""2000-01-01 [ns since 1970], for sources without a date: the same source always gives the same content id"""
SOURCE_GAP_NS = 1_000_000_000
"""log time between a source's last image and the start of the next source [ns]"""
PROGRESS_EVERY_IMAGES = 100
"""images between two updates of the progress bar"""


@dataclass(frozen=True)
class Written:
    """A recording written by an import: path, hash, size, numbers of images and strikes, and remarks."""

    path: Path
    """path of the recording"""
    content_id: str
    """hash of the recording's messages"""
    size: int
    """size of the recording [bytes]"""
    images: int
    """number of images written"""
    strikes: int
    """number of strikes written, without those that have no images"""
    tosses: int
    """number of tosses written"""
    remarks: tuple[str, ...]
    """remarks for the user on sources and camera, missing frames and strikes left out"""


class _Session:
    """Writer of an import's messages to a recording: the sources' images, then the strikes.

    Images are numbered over all sources, and the sources follow each other on one clock, `SOURCE_GAP_NS`
    apart. Sources without a strike are left out.

    Args:
        prepared: the import.
        writer: open recording, which receives the messages.
        progress: called with a text, the number of images written and of all.
    """

    def __init__(self, prepared: PreparedImport, writer: RecordingWriter, progress: Progress) -> None:
        self._prepared, self._writer, self._progress = prepared, writer, progress
        self.anchor_ns = prepared.all_sources[0].wall_start_ns or DEFAULT_START_NS
        """log time of the first source's start [ns since 1970]"""
        self._at_ns = self.anchor_ns
        """log time of the present source's start [ns]"""
        self._end_ns = self.anchor_ns
        self._sequence = 0
        self.images = self.strikes = self.tosses = 0
        self.remarks: list[str] = []
        self._seen = [LogTimes() for _ in prepared.windows]
        self._image_topic = _image_topic(prepared)
        self._meta_topic = topics.frame_meta(CAMERA)

    def write(self) -> None:
        """Write all content of the recording.

        The order: manifest and attached files, topics, calibration, the images of all sources, strikes.

        Raises:
            ImportRefused: a source cannot be read.
            OutputError: the file cannot be written.
        """
        writer, prepared = self._writer, self._prepared
        writer.write_head(manifest(prepared, self.anchor_ns), attachments(prepared))
        calibration = topics.camera_calibration(CAMERA)
        tossed = (topics.SESSION_TOSS,) if prepared.tosses else ()
        records = (topics.SESSION_STRIKE, *tossed, topics.LOG)
        writer.add_topics(calibration, self._image_topic, self._meta_topic, *records)
        writer.write_small(
            calibration, self.anchor_ns, calibration_message(prepared.calibration, CAMERA).SerializeToString()
        )
        for number, source in enumerate(prepared.sources):
            windows = [
                (seen, window)
                for seen, window in zip(self._seen, prepared.windows, strict=True)
                if window.clip == number
            ]
            if not windows:
                continue
            missing = MissingFrames(1e9 / prepared.rate_hz)
            if prepared.storable_videos is None:
                self._images(source, windows, missing)
            else:
                self._video(prepared.storable_videos[number], windows, missing)
            if (remark := missing.remark(source.name)) is not None:
                self.remarks.append(remark)
            self._at_ns = self._end_ns + SOURCE_GAP_NS
        tosses = [self._toss_images(number) for number in range(len(prepared.tosses))]
        for seen, window in zip(self._seen, prepared.windows, strict=True):
            self._strike(seen, window)
        for number, seen in enumerate(tosses, 1):
            self._toss(number, seen)

    def _toss_images(self, number: int) -> LogTimes:
        """Write all images of a toss; return the log times of the first and the last.

        Args:
            number: index of the toss among all.
        """
        prepared, seen, missing = self._prepared, LogTimes(), MissingFrames(1e9 / self._prepared.rate_hz)
        clip, source = len(prepared.sources) + number, prepared.tosses[number]
        whole = [(seen, StrikeWindow(clip, "", 1, None, None, None))]
        if prepared.storable_videos is None:
            self._images(source, whole, missing)
        else:
            self._video(prepared.storable_videos[clip], whole, missing)
        if (remark := missing.remark(source.name)) is not None:
            self.remarks.append(remark)
        self._at_ns = self._end_ns + SOURCE_GAP_NS
        return seen

    def _toss(self, number: int, seen: LogTimes) -> None:
        """Write the record of a toss, in the plan's order where it plans tosses; none without images.

        Args:
            number: number of the toss, from 1.
            seen: log times of its first and last image.
        """
        planned = [toss.id for toss in self._prepared.plan.tosses]
        name = planned[number - 1] if number <= len(planned) else f"t{number}"
        if seen.first_ns is None:
            self.remarks.append(f"toss {name}: has no images and is left out")
            return
        record = pb.TossRecord(
            toss_id=f"{name}.1",
            plan_toss_id=name,
            attempt=1,
            window_start_ns=seen.first_ns,
            window_end_ns=seen.last_ns,
        )
        self.tosses += 1
        self._writer.write_small(topics.SESSION_TOSS, seen.last_ns, record.SerializeToString())

    def _images(
        self, source: FrameSource, windows: list[tuple[LogTimes, StrikeWindow]], missing: MissingFrames
    ) -> None:
        """Write a source's images of strikes to the recording, each with its FrameMeta (frame metadata).

        Args:
            source: the source.
            windows: for each strike in the source, the log times of its first and last image, which are
                updated here, and its window (time span whose images are written).
            missing: counter of the source's missing frames, which is updated.
        """
        for seen, window in windows:
            missing.restart()
            for time_ns, parts in self._messages(source, window):
                log_time_ns = self._at_ns + time_ns
                if self.images % PROGRESS_EVERY_IMAGES == 0:
                    self._report_progress(source)
                self._writer.write_image(self._image_topic, log_time_ns, self._sequence, parts)
                self._meta(self._sequence, log_time_ns, missing.before(time_ns))
                self.images += 1
                self._end_ns = max(self._end_ns, log_time_ns)
                seen.add(log_time_ns)
                self._sequence += 1

    def _messages(
        self, source: FrameSource, window: StrikeWindow
    ) -> Iterator[tuple[int, tuple[Buffer, ...]]]:
        """Yield for each image in a strike's window its time and its encoded message.

        The time is on the source's clock [ns]; the message is a tuple of buffers that follow each other.
        """
        if self._prepared.are_files:
            for time_ns, file in source.files(window.start_ns, window.end_ns):
                yield time_ns, image_messages.compressed_image(CAMERA, self._at_ns + time_ns, file)
            return
        for frame in self._prepared.images[window.clip].frames(window.start_ns, window.end_ns):
            yield frame.time_ns, image_messages.raw_image(CAMERA, self._at_ns + frame.time_ns, frame.image)

    def _video(
        self, video: VideoSource, windows: list[tuple[LogTimes, StrikeWindow]], missing: MissingFrames
    ) -> None:
        """Write a whole video as coded to the recording, in chunks, and update the strikes' log times.

        FrameMeta (frame metadata) are written for each chunk's first frame and each frame that follows a gap.

        Args:
            video: the video; without a `storable_format` nothing is written.
            windows: for each strike in the video, the log times of its first and last image, which are
                updated, and its window (part of the video).
            missing: counter of the video's missing frames, which is updated.
        """
        if video.storable_format is None:
            return
        channel, chunk = self._writer.channel_id(self._image_topic), OpenChunk()
        room = image_messages.video_room(CAMERA, video.storable_format)
        first = last = self._sequence
        lost: dict[int, tuple[int, int]] = {}
        for pictures, numbers, in_order_ns in number_pictures(video.coded(room), video.name):
            missed = missing.before_each(in_order_ns)
            for at in np.flatnonzero(missed).tolist():
                lost[last + at] = int(in_order_ns[at]), int(missed[at])
            for seen, window in windows:
                seen.add_range(self._at_ns, in_order_ns, window)
            last += len(in_order_ns)
            self.images += len(in_order_ns)
            self._report_progress(video)
            sizes = np.fromiter(map(len, pictures.data), np.int64, len(pictures.data)) - room
            messages = VideoMessages(self._at_ns + pictures.times_ns, first + numbers, sizes)
            image_messages.put_video_heads(CAMERA, video.storable_format, channel, messages, pictures.data)
            for part, begins in _parts(pictures.keys):
                if chunk.size >= (FULL_CHUNK_BYTES if begins else topics.VIDEO_CHUNK_BYTES):
                    self._video_chunk(chunk, lost)
                    chunk = OpenChunk()
                chunk.add(VideoMessages(*(column[part] for column in messages)), pictures.data[part])
        self._video_chunk(chunk, lost)
        self._sequence = last

    def _video_chunk(self, chunk: OpenChunk, lost: dict[int, tuple[int, int]]) -> None:
        """Write a chunk of video, with FrameMeta (frame metadata) of some of its frames.

        These are its first frame and each frame that follows a gap. Nothing is written for an empty chunk.

        Args:
            chunk: the chunk, which must not grow afterwards.
            lost: by frame number: time on the source's clock [ns] and number of frames missing before it;
                those written are removed.
        """
        if not chunk.size:
            return
        closed = chunk.closed()
        self._writer.write_video(self._image_topic, closed)
        first, last = int(closed.messages.sequences.min()), int(closed.messages.sequences.max())
        reported = {number: lost.pop(number) for number in sorted(lost) if first <= number <= last}
        if first not in reported:
            self._meta(first, int(closed.messages.times_ns.min()), 0)
        for number, (time_ns, missing) in reported.items():
            self._meta(number, self._at_ns + time_ns, missing)
        self._end_ns = max(self._end_ns, int(closed.messages.times_ns.max()))

    def _meta(self, sequence: int, log_time_ns: int, lost: int) -> None:
        """Write the FrameMeta (frame metadata) of one image.

        Args:
            sequence: number of the image.
            log_time_ns: log time of the image [ns].
            lost: number of frames missing before it.
        """
        camera = self._prepared.calibration
        meta = pb.FrameMeta(
            sequence=sequence,
            device_time_ns=log_time_ns - self._at_ns,
            host_time_ns=log_time_ns - self.anchor_ns,
            mid_exposure_host_ns=log_time_ns - self.anchor_ns,
            frames_lost_before=lost,
            image_recorded=True,
            width=camera.width,
            height=camera.height,
        )
        self._writer.write_small(self._meta_topic, log_time_ns, meta.SerializeToString(), sequence)

    def _report_progress(self, source: FrameSource) -> None:
        total = (
            sum(each.frame_count or 0 for each in self._prepared.all_sources)
            if self._prepared.storable_videos
            else self.images
        )
        self._progress(f"writing {source.name}", self.images, max(total, self.images))

    def _strike(self, seen: LogTimes, window: StrikeWindow) -> None:
        """Write the record of a strike and a line in the recording's log.

        A strike without images is left out, with a remark.

        Args:
            seen: log times of the strike's first and last image.
            window: the strike's part of a source.
        """
        planned = next(strike for strike in self._prepared.plan.strikes if strike.id == window.plan_strike_id)
        if seen.first_ns is None:
            self.remarks.append(f"strike {window.strike_id}: has no images and is left out")
            return
        record = pb.StrikeRecord(
            strike_id=window.strike_id,
            plan_strike_id=window.plan_strike_id,
            attempt=window.attempt,
            window_start_ns=seen.first_ns,
            window_end_ns=seen.last_ns,
            R_world_object=[value for row in planned.R_world_object for value in row],
            p_world_object=planned.p_world_object,
            T_world_camera=self._prepared.own_pose(window),
        )
        self.strikes += 1
        self._writer.write_small(topics.SESSION_STRIKE, seen.last_ns, record.SerializeToString())
        self._writer.write_small(
            topics.LOG, seen.last_ns, _log(seen.last_ns, self._origin(window)).SerializeToString()
        )

    def _origin(self, window: StrikeWindow) -> str:
        """Line for the recording's log: a strike's source, and when its tag began to move.

        The time is on the source's clock; it is left out if no onset was found.
        """
        clip = self._prepared.clips[window.clip]
        text = f"strike {window.strike_id}: of {clip.path.name}; the contact was not measured"
        if window.onset is None:
            return text
        # The finder misses at most a frame's motion at first.
        earliest_ns = window.onset.time_ns - round(1e9 / self._prepared.rate_hz)
        middle, half = (window.onset.moved_ns + earliest_ns) / 2, (window.onset.moved_ns - earliest_ns) / 2
        return f"{text}, the tag began to move at {middle * 1e-9:.3f} ± {half * 1e-9:.3f} s of it"


def _image_topic(prepared: PreparedImport) -> topics.Topic:
    if prepared.storable_videos is not None:
        return topics.compressed_video(CAMERA)
    return topics.compressed_image(CAMERA) if prepared.are_files else topics.raw_image(CAMERA)


def _parts(keys: NDArray[np.bool_]) -> Iterator[tuple[slice, bool]]:
    """Divide consecutive coded pictures into parts, each of which begins with a key picture.

    Args:
        keys: (n,) True for key pictures, where a decoder may begin.

    Yields:
        Slice of each part, and True if a key picture begins it; only the first part may begin without one.
    """
    begins = np.flatnonzero(keys).tolist()
    for start, stop in pairwise(sorted({0, len(keys), *begins})):
        yield slice(start, stop), bool(keys[start])


def write_recording(
    prepared: PreparedImport, output: Path, progress: Progress = no_progress, *, replace: bool = False
) -> Written:
    """Write a prepared import as a recording.

    On failure no file is left, except a finished `.part` file whose final name was taken meanwhile.

    Args:
        prepared: the import.
        output: path of the recording.
        progress: called with a text, the number of images written and of all.
        replace: True to replace an existing recording, once the new one is finished.

    Returns:
        The recording with its counts, content hash and remarks.

    Raises:
        OutputError: the file exists already, or cannot be written.
        ImportRefused: a source cannot be read.
    """
    with RecordingWriter(output, replace=replace) as writer:
        session = _Session(prepared, writer, progress)
        session.write()
        content_id = writer.finish()
        remarks = tuple(dict.fromkeys([*prepared.remarks(), *session.remarks]))
        counts = session.images, session.strikes, session.tosses
        return Written(output, content_id, writer.size, *counts, remarks)


def _log(time_ns: int, text: str) -> Log:
    stamp = Timestamp(seconds=time_ns // 10**9, nanos=time_ns % 10**9)
    return Log(timestamp=stamp, level=Log.Level.INFO, message=text, name="import")
