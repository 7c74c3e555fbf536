"""Image source of a video file; one file, as images, compressed pictures and timing read one stream.

Any codec that FFmpeg reads is accepted. Images are in the sensor's orientation: a file's rotation tag is
ignored, as in a calibration's images, since the lens belongs to the sensor, and the camera's orientation is
part of its pose in the world frame. Frames, compressed pictures and timing are read in one class, since all
three read the same stream and add to the same remarks for the user.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from fractions import Fraction
from pathlib import Path
from typing import cast

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from numpy.typing import NDArray

from analyze.errors import ImportRefused
from analyze.reading.annex_b import VideoFormat
from analyze.reading.compressed_video import grey_image
from analyze.sources.access_units import AccessUnits, has_lengths
from analyze.sources.frame_timing import FrameTiming, frame_timing, interval_range, time_scatter
from analyze.sources.image_file import image_file
from analyze.sources.listed_timing import ListedTiming, read_listed_timing
from analyze.sources.picture_numbers import CodedPictures
from analyze.sources.source import TimedFile, TimedImage
from analyze.sources.video_container import (
    MP4_SUFFIXES,
    begins_like_mp4,
    capture_rate_hz,
    stated_end_s,
    video_stream,
    wall_start_ns,
)
from schemas.session_manifest import TimeSource
from schemas.wording import counted

FILE_CODECS = {"mjpeg", "png"}
"""codecs whose pictures are image files, at most without tables"""
KEPT_CODECS = {"h264": VideoFormat.H264, "hevc": VideoFormat.H265}
"""codecs, by FFmpeg's name, whose pictures can be stored as coded"""
EXAMINED_FRAMES = 1000
"""number of first frames from which the timing is determined"""
MAX_TIME_SCATTER = 0.05
"""scatter of frame times, relative to their interval, above which it is reported"""
MIN_RATE_JUMP = 2.5
"""ratio of two frame rates in a video above which the change is not a phone's reaction to the light"""
MIN_SLOW_FACTOR = 1.2
"""ratio of capture rate to playing rate from which on a video is slow motion"""
GROUP_PICTURES, GROUP_BYTES = 512, 2 << 20
"""number of pictures, and of bytes, at which a group of pictures handled at once ends"""
WITHOUT_PARSER = {"fflags": "noparse+nofillin"}
"""FFmpeg options that leave out its parser, which takes as long as reading; for files whose container
describes every access unit (coded picture)"""


class VideoSource:
    """Source of the images of a video file's first video stream.

    Args:
        path: video file.
        capture_hz: frame rate at which it was captured, if it plays slower [Hz]. None to use the capture rate
            that the file states; if it states none, its time stamps are taken as true.
        times: table (CSV) with the capture times of all frames, in place of the file's time stamps, which
            then only order the frames; None to use the stamps.

    Raises:
        ImportRefused: the file does not exist, is not a video, cannot be decoded, is interlaced, or has fewer
            than two time stamps; or the table of times is not of this video.
    """

    def __init__(self, path: Path, capture_hz: float | None = None, times: Path | None = None) -> None:
        self.path = path
        self.name = path.name
        self._remarks: dict[str, str] = {}
        self._numbered = False
        """True to number the frames in place of their time stamps, which are missing or not different"""
        with closing(self._open()) as container:
            stream = video_stream(container, path)
            self.codec = stream.codec_context.name
            self.storable_format = KEPT_CODECS.get(self.codec)
            """codec in which the pictures can be stored as coded; None if they cannot"""
            self.holds_files = self.codec in FILE_CODECS
            self.is_coded = self.codec != "rawvideo"
            self._has_lengths = has_lengths(stream)
            self.frame_count = stream.frames or None
            self.timing: FrameTiming | ListedTiming
            if times is None:
                self.timing = self._read_timing(container, stream, capture_hz)
                self.time_source = TimeSource.CONTAINER_PTS
                self._stated_end_s = stated_end_s(container, self.timing)
            else:
                self.timing = self._listed_timing(container, stream, times)
                self.time_source, self._stated_end_s = self.timing.time_source, None
                self.frame_count = len(self.timing.stamps)
            self.rate_hz, self.time_sd_ns = 1 / self.timing.interval_s, self.timing.sd_ns
            self.wall_start_ns = wall_start_ns(container)
        with closing(self._open()) as container:
            frame = self._first_frame(container)
            self.width, self.height = frame.width, frame.height
            self._note_rotation(frame.rotation)
            if frame.interlaced_frame:
                raise ImportRefused(
                    f"{path}: is interlaced, so that every image shows two moments: use a progressive mode"
                )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks for the user on faults of the video; complete once all images were read.

        Faults: slow motion, rotation, damaged frames, end cut short; a changing frame rate only after a call
        of `check_constant_rate`.
        """
        return tuple(self._remarks.values())

    @property
    def may_be_slow(self) -> bool:
        """True if the video may be slow motion that states no capture rate, and whose times are its own."""
        return self.timing.slowed == 1 and not isinstance(self.timing, ListedTiming)

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """Yield the decoded grey images with increasing times since the first frame.

        Frames that cannot be decoded or have no time stamp are left out, with a remark at the file's end.

        Args:
            start_ns: earliest capture time since the first frame [ns], included; None for no limit.
            end_ns: latest capture time since the first frame [ns], included; None for no limit.

        Raises:
            ImportRefused: the file cannot be opened, times do not increase, or the image size changes.
        """
        decoded, damaged, last_ns = 0, 0, -1
        with closing(self._open()) as container:
            stream = video_stream(container, self.path)
            stream.thread_type = "AUTO"
            if start_ns and not self._numbered:
                container.seek(self.timing.stamp(start_ns), stream=stream)
            for packet in self._packets(container, stream):
                try:
                    frames = packet.decode()
                except FFmpegError:
                    damaged += 1
                    continue
                for frame in cast("list[av.VideoFrame]", frames):
                    decoded += 1
                    if frame.is_corrupt or frame.pts is None:
                        damaged += 1
                        continue
                    time_ns = self.timing.time_ns(frame.pts)
                    if start_ns is not None and time_ns < start_ns:
                        continue
                    if end_ns is not None and time_ns > end_ns:
                        return
                    self._refuse_decreasing(time_ns, last_ns)
                    self._refuse_other_size(frame.width, frame.height)
                    last_ns = time_ns
                    yield TimedImage(time_ns, grey_image(frame))
        self._note_damaged(damaged)
        if start_ns is None and end_ns is None:
            self._note_count(decoded, last_ns)

    def coded(self, room: int = 0) -> Iterator[CodedPictures]:
        """Yield the video's pictures still compressed, in decoding order, in groups.

        Each group has the pictures' capture times since the first frame [ns], and which are key pictures.
        Damaged pictures are left out, with a remark. Only H.264 and H.265 can be stored as coded:
        `storable_format` is the one of these in the file, None for any other codec.

        Args:
            room: number of bytes left free before each picture, for the message's head in a recording.

        Raises:
            ImportRefused: the file cannot be opened, a picture has no time stamp, or the codec cannot be
                stored as coded (`storable_format` is None).
        """
        if self.storable_format is None:
            raise ImportRefused(f"{self.path}: {self.codec} is not stored as coded")
        seen = damaged = last_ns = 0
        with closing(self._open(WITHOUT_PARSER if self._has_lengths else {})) as container:
            stream = video_stream(container, self.path)
            units = AccessUnits(self.storable_format, stream, room)
            for packets in _groups(self._packets(container, stream)):
                stamps, keys = [packet.pts for packet in packets], [packet.is_keyframe for packet in packets]
                if None in stamps:
                    raise ImportRefused(
                        f"{self.path}: a frame has no time stamp: use a container that has them (MP4, "
                        "Matroska)"
                    )
                data = units.convert(packets)
                whole = np.array([unit is not None for unit in data])
                seen, damaged = seen + len(data), damaged + data.count(None)
                times_ns = self.timing.times_ns(cast("list[int]", stamps))[whole]
                last_ns = int(times_ns.max(initial=last_ns))
                yield CodedPictures(
                    times_ns, np.array(keys)[whole], [unit for unit in data if unit is not None]
                )
        self._note_damaged(damaged)
        self._note_count(seen, last_ns)

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """Yield the pictures of a PNG or Motion JPEG video as image files, with increasing times.

        Times are capture times since the first frame. Pictures without a time stamp are left out. Pictures
        that are damaged, or no image files because the video has another codec, are left out with a remark at
        the file's end.

        Args:
            start_ns: earliest capture time since the first frame [ns], included; None for no limit.
            end_ns: latest capture time since the first frame [ns], included; None for no limit.

        Raises:
            ImportRefused: the file cannot be opened, times do not increase, or the image size changes.
        """
        seen, damaged, last_ns = 0, 0, -1
        with closing(self._open()) as container:
            stream = video_stream(container, self.path)
            if start_ns and not self._numbered:
                container.seek(self.timing.stamp(start_ns), stream=stream)
            for packet in self._packets(container, stream):
                if packet.pts is None:
                    continue
                seen += 1
                time_ns = self.timing.time_ns(packet.pts)
                if start_ns is not None and time_ns < start_ns:
                    continue
                if end_ns is not None and time_ns > end_ns:
                    return
                file = image_file(memoryview(packet))
                if file is None:
                    damaged += 1
                    continue
                self._refuse_decreasing(time_ns, last_ns)
                self._refuse_other_size(file.width, file.height)
                last_ns = time_ns
                yield TimedFile(time_ns, file)
        self._note_damaged(damaged)
        if start_ns is None and end_ns is None:
            self._note_count(seen, last_ns)

    def add_remark(self, kind: str, text: str) -> None:
        """Add a remark for the user, in place of an earlier one of its kind."""
        self._remarks[kind] = text

    def check_constant_rate(self, times_ns: NDArray[np.int64]) -> None:
        """Add remarks if frame times scatter, or the frame rate changes by a factor of `MIN_RATE_JUMP`.

        Args:
            times_ns: (n,) times of all frames [ns], increasing.

        Raises:
            ImportRefused: the rate changes and the video is slow motion, which one capture rate cannot
                correct.
        """
        scatter, interval = time_scatter(times_ns)
        remedy = "import the video as the camera recorded it, not converted or shared"
        if isinstance(self.timing, ListedTiming):
            remedy = "check that the table's times are those of exposure, not of arrival or writing"
        if scatter > max(MAX_TIME_SCATTER * interval, 2 * self.time_sd_ns):
            self._remarks["time_scatter"] = (
                f"{self.name}: its frame times scatter by {scatter * 1e-6:.2g} ms, {scatter / interval:.0%} "
                f"of their interval, so that motions look jerky: {remedy}"
            )
        shortest, longest = interval_range(times_ns)
        if longest < MIN_RATE_JUMP * shortest or not shortest:
            return
        fast, slow = (1e9 / float(self.timing.slowed) / interval for interval in (shortest, longest))
        what = f"its frame rate is {fast:.3g} a second in one part and {slow:.3g} in another"
        remedy = "import the video as the camera recorded it, not as it was edited or shared"
        if self.timing.slowed != 1:
            raise ImportRefused(
                f"{self.path}: {what}, so that one --capture-fps cannot correct its times: {remedy}"
            )
        self._remarks["interval_range"] = f"{self.name}: {what}: if a slow-motion effect was added, {remedy}"

    # --- the file

    def _open(self, options: dict[str, str] | None = None) -> InputContainer:
        """Open the video file with FFmpeg and return the open file.

        Args:
            options: FFmpeg's options by name; None for none.

        Raises:
            ImportRefused: the file does not exist, is a folder, or is not a readable video.
        """
        begins = False
        try:
            begins = begins_like_mp4(self.path)  # refuses a pipe, for which FFmpeg would wait
            return av.open(str(self.path), options=options, metadata_errors="replace")
        except FileNotFoundError:
            raise ImportRefused(f"{self.path}: no such file: check the path") from None
        except IsADirectoryError:
            raise ImportRefused(
                f"{self.path}: is a folder: name a video, or a folder of images with its CSV of times"
            ) from None
        except (FFmpegError, OSError) as error:
            cut = (
                ": an MP4 file that was cut short has no index: record the video again, or repair it"
                if self.path.suffix.lower() in MP4_SUFFIXES and begins
                else ""
            )
            raise ImportRefused(f"{self.path}: not a readable video ({error.strerror}){cut}") from None

    def _packets(self, container: InputContainer, stream: av.VideoStream) -> Iterator[av.Packet]:
        """Yield the stream's packets (coded pictures), up to the end or an error of reading.

        Corrupt packets are left out; the others have their number as time stamp where the file's are of no
        use (`_numbered`). Corrupt ones and an error of reading add the remark that the file is cut short.
        """
        packets, number = container.demux(stream), 0
        while True:
            try:
                packet = next(packets)
            except StopIteration:
                return
            except FFmpegError:
                self._note_cut()
                return
            if packet.is_corrupt:
                self._note_cut()
                continue
            if self._numbered and packet.size:
                packet.pts, number = number, number + 1
            yield packet

    def _listed_timing(self, container: InputContainer, stream: av.VideoStream, times: Path) -> ListedTiming:
        """Read the capture times of all frames from a table; the file's stamps only give their order.

        Frames are numbered as they come where stamps are missing or not different.

        Args:
            container: the open file.
            stream: its video stream.
            times: the table.

        Raises:
            ImportRefused: the table cannot be read or is not of this video, or the frames' order is unknown,
                as stamps are missing and the codec stores frames out of order.
        """
        stamps = [packet.pts for packet in self._packets(container, stream) if packet.size]
        different = {stamp for stamp in stamps if stamp is not None}
        if len(different) < len(stamps):
            if stream.codec_context.has_b_frames:
                raise ImportRefused(
                    f"{self.path}: its frames have no time stamps and are not stored in their order "
                    "(B-frames), so that their rows in the table are unknown: record without B-frames, or "
                    "in a container with time stamps (MP4, Matroska)"
                )
            self._numbered, different = True, set(range(len(stamps)))
        stated = stream.average_rate
        timing, remark = read_listed_timing(
            times, sorted(different), self.name, float(stated) if stated else None
        )
        if remark is not None:
            self._remarks["table"] = f"{self.name}: {remark}"
        return timing

    def _read_timing(
        self, container: InputContainer, stream: av.VideoStream, capture_hz: float | None
    ) -> FrameTiming:
        """Determine how time stamps convert to capture times, from the first `EXAMINED_FRAMES` stamps.

        Args:
            container: the open file.
            stream: its video stream.
            capture_hz: capture rate that the user states [Hz]; None for the file's.

        Returns:
            The conversion; the zero of capture times is the first frame.

        Raises:
            ImportRefused: there are fewer than two different time stamps.
        """
        stamps: list[int] = []
        for packet in self._packets(container, stream):
            if packet.pts is not None:
                stamps.append(packet.pts)
            if len(stamps) >= EXAMINED_FRAMES:
                break
        stated = stream.average_rate
        unit, stated_hz = Fraction(stream.time_base or 1), Fraction(stated) if stated else None
        played = frame_timing(stamps, unit, stated_hz, None)
        if played is None:
            raise ImportRefused(
                f"{self.path}: contains fewer than two frames with time stamps: record again, or use a "
                "container that has them (MP4, Matroska)"
            )
        captured_hz = self._capture_rate(container, played, capture_hz)
        return played if captured_hz is None else frame_timing(stamps, unit, stated_hz, captured_hz) or played

    def _capture_rate(
        self, container: InputContainer, played: FrameTiming, given_hz: float | None
    ) -> float | None:
        """Capture rate [Hz]: the user's, else the one that the file states; None if the stamps are true.

        The file's capture rate is considered only if it is at least `MIN_SLOW_FACTOR` times the rate at which
        the file plays. A remark is added if the file's rate is returned, or differs from the user's by this
        factor.

        Args:
            container: the open file.
            played: timing of the file as it plays, of which the frame interval is used.
            given_hz: capture rate that the user states [Hz]; None if he states none.
        """
        stated_hz = capture_rate_hz(container)
        if stated_hz is None or stated_hz * played.interval_s < MIN_SLOW_FACTOR:
            return given_hz
        if given_hz is None:
            self._remarks["captured"] = (
                f"{self.name}: plays at {1 / played.interval_s:.3g} frames a second and states that "
                f"{stated_hz:.6g} were captured: its times are corrected accordingly (--capture-fps sets "
                "another rate)"
            )
        elif not 1 / MIN_SLOW_FACTOR < given_hz / stated_hz < MIN_SLOW_FACTOR:
            self._remarks["captured"] = (
                f"{self.name}: states that {stated_hz:.6g} frames a second were captured, not {given_hz:.6g}"
            )
        return given_hz or stated_hz

    def _first_frame(self, container: InputContainer) -> av.VideoFrame:
        """First frame of the opened video file, decoded by FFmpeg.

        Raises:
            ImportRefused: no frame can be decoded.
        """
        try:
            for frame in container.decode(video_stream(container, self.path)):
                return frame
        except FFmpegError as error:
            raise ImportRefused(
                f"{self.path}: its {self.codec} cannot be decoded ({error.strerror}): record it again"
            ) from None
        raise ImportRefused(f"{self.path}: contains no image that can be decoded: record it again")

    def _refuse_decreasing(self, time_ns: int, last_ns: int) -> None:
        if time_ns <= last_ns:
            raise ImportRefused(
                f"{self.path}: its time stamps do not increase at {time_ns * 1e-9:.3f} s: record it again, "
                "or repair them"
            )

    def _refuse_other_size(self, width: int, height: int) -> None:
        if (width, height) != (self.width, self.height):
            sizes = f"from {self.width} x {self.height} to {width} x {height}"
            raise ImportRefused(
                f"{self.path}: its images change {sizes}: record again without changing lens or mode"
            )

    def _note_rotation(self, degrees: int) -> None:
        if degrees % 360:
            self._remarks["turned"] = (
                f"{self.name}: is displayed rotated by {degrees % 360} deg; its images are used in the "
                f"sensor's orientation, {self.width} x {self.height}, as in a calibration"
            )

    def _note_damaged(self, frames: int) -> None:
        if frames:
            self._remarks["damaged"] = (
                f"{self.name}: left out: {counted(frames, 'frame')} that cannot be decoded"
            )

    def _note_count(self, frames: int, last_ns: int) -> None:
        """Add the remark "cut short" if the file ends before the frame count or duration that it states.

        Args:
            frames: number of frames that were read.
            last_ns: capture time of the last frame since the first [ns].
        """
        if self.frame_count and frames < self.frame_count:
            self._note_cut(f": it has {frames} of {counted(self.frame_count, 'frame')}")
        elif self._stated_end_s is not None and last_ns * 1e-9 < self._stated_end_s:
            self._note_cut(f" at {last_ns * 1e-9:.2f} s")

    def _note_cut(self, what: str = "") -> None:
        self._remarks["cut"] = f"{self.name}: is cut short{what}; the rest is imported"


def _groups(packets: Iterator[av.Packet]) -> Iterator[list[av.Packet]]:
    """Yield packets in lists, each ended once it has `GROUP_PICTURES` packets or `GROUP_BYTES` bytes.

    The empty packet with which FFmpeg ends a stream is left out.
    """
    group, size = list[av.Packet](), 0
    for packet in packets:
        if packet.pts is None and packet.dts is None and not packet.size:
            continue
        group.append(packet)
        size += packet.size
        if size >= GROUP_BYTES or len(group) >= GROUP_PICTURES:
            yield group
            group, size = [], 0
    if group:
        yield group
