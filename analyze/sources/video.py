"""A video file as a source: any codec that FFmpeg reads, grey values by their own time stamps; of some codecs the pictures as coded, too.

Images are given out as the sensor has them. A file's note of how the camera was held is not followed, as it is not in a calibration's
images: the lens belongs to the sensor, and how the camera was held is in its place in W.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from datetime import datetime
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import av
import numpy as np
from av.container import InputContainer
from av.error import FFmpegError
from numpy.typing import NDArray

from analyze.errors import ImportRefused
from analyze.reading.annex_b import VideoFormat
from analyze.reading.compressed_video import grey_values
from analyze.sources.access_units import AccessUnits, has_lengths
from analyze.sources.image_file import image_file
from analyze.sources.kept import CodedPictures
from analyze.sources.pace import Pace, pace_of, paces
from analyze.sources.source import TimedFile, TimedImage
from schemas.session_manifest import TimeSource

_OF_FILES = {"mjpeg", "png"}
"""codecs whose every picture is an image file, or nearly"""
_KEPT = {"h264": VideoFormat.H264, "hevc": VideoFormat.H265}
_LOOKED_AT = 1000
"""frames from which the pace is read off"""
_CAPTURED = "com.android.capture.fps"
"""what Android phones write into slow motion: the rate at which it was captured, where the stamps are those at which it plays"""
_FASTEST_HZ = 1e6
_RAMP = 2.5
"""times another, from which on two paces are no phone's that follows the light"""
_SLOWED = 1.2
"""times the rate of the stamps, from which on that is another one"""
_TOGETHER, _TOGETHER_BYTES = 512, 2 << 20
"""pictures and bytes that are handed on at once"""
_UNPARSED = {"fflags": "noparse+nofillin"}
"""for FFmpeg: where a file says of every access unit what it is, it need not be looked into, which takes as long as reading it"""


class VideoSource:
    """A video file.

    Args:
        path: of the file.
        capture_hz: rate at which it was captured, where it plays slower; None: as the file says it, else its time stamps are true.

    Raises:
        ImportRefused: it is no video, cannot be decoded, or has no time stamps.
    """

    def __init__(self, path: Path, capture_hz: float | None = None) -> None:
        self.path = path
        self.name = path.name
        self.time_source = TimeSource.CONTAINER_PTS
        self._remarks: dict[str, str] = {}
        with closing(self._open()) as container:
            stream = _video_stream(container, path)
            self.codec = stream.codec_context.name
            self._has_lengths = has_lengths(stream)
            self.pace = self._pace(container, stream, capture_hz)
            self.frame_count = stream.frames or None
            self.wall_start_ns = _wall_start(container)
            self._said_s = _said_seconds(container, self.pace)
        with closing(self._open()) as container:
            frame = self._first_frame(container)
            self.width, self.height = frame.width, frame.height
            self._note_turn(frame.rotation)
            if frame.interlaced_frame:
                raise ImportRefused(f"{path}: is interlaced: every image holds two moments: film with a progressive mode")

    @property
    def keeps(self) -> VideoFormat | None:
        """The format in which it can be kept as it is; None where it can not."""
        return _KEPT.get(self.codec)

    @property
    def holds_files(self) -> bool:
        """See FrameSource."""
        return self.codec in _OF_FILES

    @property
    def is_coded(self) -> bool:
        """See FrameSource."""
        return self.codec != "rawvideo"

    @property
    def rate_hz(self) -> float:
        """See FrameSource."""
        return 1 / self.pace.interval_s

    @property
    def time_sd_ns(self) -> int:
        """1 sigma of a frame's time, by the step of the file's stamps."""
        return self.pace.sd_ns

    @property
    def remarks(self) -> tuple[str, ...]:
        """See FrameSource."""
        return tuple(self._remarks.values())

    def frames(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedImage]:
        """See FrameSource."""
        decoded, damaged, last_ns = 0, 0, -1
        with closing(self._open()) as container:
            stream = _video_stream(container, self.path)
            stream.thread_type = "AUTO"
            if start_ns:
                container.seek(self.pace.stamp(start_ns), stream=stream)
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
                    time_ns = self.pace.time_ns(frame.pts)
                    if start_ns is not None and time_ns < start_ns:
                        continue
                    if end_ns is not None and time_ns > end_ns:
                        return
                    self._refuse_behind(time_ns, last_ns)
                    self._refuse_other_size(frame.width, frame.height)
                    last_ns = time_ns
                    yield TimedImage(time_ns, grey_values(frame))
        self._note_damaged(damaged)
        if start_ns is None and end_ns is None:
            self._note_count(decoded, last_ns)

    def coded(self, room: int = 0) -> Iterator[CodedPictures]:
        """Coded pictures in the order in which they are decoded, some at a time.

        Args:
            room: bytes left free before each of them, for what stands there in a recording.

        Raises:
            ImportRefused: a picture has no time stamp, or the file is none that can be kept.
        """
        if self.keeps is None:
            raise ImportRefused(f"{self.path}: {self.codec} is not kept as it is")
        seen = damaged = last_ns = 0
        with closing(self._open(_UNPARSED if self._has_lengths else {})) as container:
            stream = _video_stream(container, self.path)
            units = AccessUnits(self.keeps, stream, room)
            for packets in _groups(self._packets(container, stream)):
                stamps, keys = [packet.pts for packet in packets], [packet.is_keyframe for packet in packets]
                if None in stamps:
                    raise ImportRefused(f"{self.path}: a frame has no time stamp: put it into a container that has them (MP4, Matroska)")
                data = units.of(packets)
                whole = np.array([unit is not None for unit in data])
                seen, damaged = seen + len(data), damaged + data.count(None)
                times_ns = self.pace.times_ns(cast("list[int]", stamps))[whole]
                last_ns = int(times_ns.max(initial=last_ns))
                yield CodedPictures(times_ns, np.array(keys)[whole], [unit for unit in data if unit is not None])
        self._note_damaged(damaged)
        self._note_count(seen, last_ns)

    def files(self, start_ns: int | None = None, end_ns: int | None = None) -> Iterator[TimedFile]:
        """See FrameSource."""
        seen, damaged, last_ns = 0, 0, -1
        with closing(self._open()) as container:
            stream = _video_stream(container, self.path)
            if start_ns:
                container.seek(self.pace.stamp(start_ns), stream=stream)
            for packet in self._packets(container, stream):
                if packet.pts is None:
                    continue
                seen += 1
                time_ns = self.pace.time_ns(packet.pts)
                if start_ns is not None and time_ns < start_ns:
                    continue
                if end_ns is not None and time_ns > end_ns:
                    return
                file = image_file(memoryview(packet))
                if file is None:
                    damaged += 1
                    continue
                self._refuse_behind(time_ns, last_ns)
                self._refuse_other_size(file.width, file.height)
                last_ns = time_ns
                yield TimedFile(time_ns, file)
        self._note_damaged(damaged)
        if start_ns is None and end_ns is None:
            self._note_count(seen, last_ns)

    def heed_paces(self, times_ns: NDArray[np.int64]) -> None:
        """Say that parts of it play slower than others.

        Args:
            times_ns: (n,) of all its frames, as it gives them.

        Raises:
            ImportRefused: it is slow motion, which no one rate undoes then.
        """
        shortest, longest = paces(times_ns)
        if longest < _RAMP * shortest or not shortest:
            return
        fast, slow = (1e9 / float(self.pace.slowed) / interval for interval in (shortest, longest))
        what = f"its frames come at {fast:.3g} a second in one part and at {slow:.3g} in another"
        remedy = "import the film as the camera took it, not as it was edited or shared"
        if self.pace.slowed != 1:
            raise ImportRefused(f"{self.path}: {what}, so that one --capture-fps does not make its times true: {remedy}")
        self._remarks["paces"] = f"{self.name}: {what}: if a slow-motion effect was laid over it, {remedy}"

    def close(self) -> None:
        """Nothing is open between two readings."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    # --- the file -------------------------------------------------------------------------------------------------

    def _open(self, options: dict[str, str] | None = None) -> InputContainer:
        try:
            return av.open(str(self.path), options=options)
        except FileNotFoundError:
            raise ImportRefused(f"{self.path}: no such file: check the path") from None
        except IsADirectoryError:
            raise ImportRefused(f"{self.path}: is a folder: name a video, or a folder of images with its CSV of times") from None
        except (FFmpegError, OSError) as error:
            cut = (
                ": an MP4 file that was cut short has no index: film again, or repair it first"
                if self.path.suffix.lower() in _INDEXED and _begins_as_mp4(self.path)
                else ""
            )
            raise ImportRefused(f"{self.path}: is no video that can be read ({error.strerror}){cut}") from None

    def _packets(self, container: InputContainer, stream: av.VideoStream) -> Iterator[av.Packet]:
        """The stream's packets; a file that ends early ends them."""
        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets)
            except StopIteration:
                return
            except FFmpegError:
                self._note_cut("")
                return
            if packet.is_corrupt:
                self._note_cut("")
                continue
            yield packet

    def _pace(self, container: InputContainer, stream: av.VideoStream, capture_hz: float | None) -> Pace:
        stamps: list[int] = []
        for packet in self._packets(container, stream):
            if packet.pts is not None:
                stamps.append(packet.pts)
            if len(stamps) >= _LOOKED_AT:
                break
        said = stream.average_rate
        unit, said_hz = Fraction(stream.time_base or 1), Fraction(said) if said else None
        played = pace_of(stamps, unit, said_hz, None)
        if played is None:
            why = "holds no two frames with time stamps: film again, or put it into a container that has them (MP4, Matroska)"
            raise ImportRefused(f"{self.path}: {why}")
        captured_hz = self._captured(container, played, capture_hz)
        return played if captured_hz is None else pace_of(stamps, unit, said_hz, captured_hz) or played

    def _captured(self, container: InputContainer, played: Pace, given_hz: float | None) -> float | None:
        """The rate at which it was captured as the user gives it, else as the file says it; None: as it plays."""
        said_hz = _number(container.metadata.get(_CAPTURED))
        if said_hz is None or said_hz * played.interval_s < _SLOWED:
            return given_hz
        if given_hz is None:
            self._remarks["captured"] = (
                f"{self.name}: plays at {1 / played.interval_s:.3g} frames a second and says that {said_hz:.6g} were captured: "
                "its times are taken so (--capture-fps says another rate)"
            )
        elif not 1 / _SLOWED < given_hz / said_hz < _SLOWED:
            self._remarks["captured"] = f"{self.name}: says that {said_hz:.6g} frames a second were captured, not {given_hz:.6g}"
        return given_hz or said_hz

    def _first_frame(self, container: InputContainer) -> av.VideoFrame:
        try:
            for frame in container.decode(_video_stream(container, self.path)):
                return frame
        except FFmpegError as error:
            raise ImportRefused(f"{self.path}: its {self.codec} cannot be decoded ({error.strerror}): film again") from None
        raise ImportRefused(f"{self.path}: holds no image that can be decoded")

    def _refuse_behind(self, time_ns: int, last_ns: int) -> None:
        if time_ns <= last_ns:
            raise ImportRefused(f"{self.path}: its time stamps do not rise at {time_ns * 1e-9:.3f} s: film again, or repair them")

    def _refuse_other_size(self, width: int, height: int) -> None:
        if (width, height) != (self.width, self.height):
            sizes = f"from {self.width} x {self.height} to {width} x {height}"
            raise ImportRefused(f"{self.path}: its images change {sizes}: film again without changing lens or mode")

    def _note_turn(self, degrees: int) -> None:
        if degrees % 360:
            self._remarks["turned"] = (
                f"{self.name}: is shown turned by {degrees % 360} deg; the images are taken as the sensor has them, "
                f"{self.width} x {self.height}, as a calibration must be"
            )

    def _note_damaged(self, frames: int) -> None:
        if frames:
            self._remarks["damaged"] = f"{self.name}: {frames} frames cannot be decoded and are left out"

    def _note_count(self, frames: int, last_ns: int) -> None:
        if self.frame_count and frames < self.frame_count:
            self._note_cut(f": {frames} of {self.frame_count} frames are there")
        elif self._said_s is not None and last_ns * 1e-9 < self._said_s:
            self._note_cut(f" at {last_ns * 1e-9:.2f} s")

    def _note_cut(self, what: str) -> None:
        self._remarks["cut"] = f"{self.name}: is cut short{what or ''}; what is there is imported"


def _groups(packets: Iterator[av.Packet]) -> Iterator[list[av.Packet]]:
    """Some at a time; without the empty one at the end."""
    group, size = list[av.Packet](), 0
    for packet in packets:
        if packet.pts is None and packet.dts is None and not packet.size:
            continue
        group.append(packet)
        size += packet.size
        if size >= _TOGETHER_BYTES or len(group) >= _TOGETHER:
            yield group
            group, size = [], 0
    if group:
        yield group


_INDEXED = {".mp4", ".mov", ".m4v", ".3gp"}


def _begins_as_mp4(path: Path) -> bool:
    """What is something else, or empty, was not cut short."""
    with path.open("rb") as file:
        return file.read(8)[4:] in {b"ftyp", b"moov", b"mdat", b"wide", b"free"}


def _video_stream(container: InputContainer, path: Path) -> av.VideoStream:
    if not container.streams.video:
        raise ImportRefused(f"{path}: holds no video: name the file that does")
    return container.streams.video[0]


def _number(text: str | None) -> float | None:
    """A rate as metadata have it; None where it is none."""
    try:
        number = float(text or "")
    except ValueError:
        return None
    return number if 1 <= number <= _FASTEST_HZ else None


def _said_seconds(container: InputContainer, pace: Pace) -> float | None:
    """Time by which, as the file says, the last frame is over, and which the last one reaches surely where it is there."""
    if container.duration is None:
        return None
    # A sound track may go on for a moment.
    slack_s = 2.5 * pace.interval_s if len(container.streams) == 1 else 1.0
    return container.duration / av.time_base / float(pace.slowed) - slack_s


def _wall_start(container: InputContainer) -> int | None:
    """When it was filmed, as the file says it [ns since 1970]."""
    try:
        said = datetime.fromisoformat(str(container.metadata.get("creation_time", "")))
    except ValueError:
        return None
    wall_ns = round(said.timestamp()) * 10**9
    return wall_ns if wall_ns > 0 else None  # a camera without a clock says 1970, or 1904
