"""The two topics of a camera's frames in a recording: images, and meta (times, exposure, losses)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from acquire.frames.frame import Frame
from acquire.recorder.checksum import crc_of
from acquire.recorder.file_series import FileSeries
from acquire.recorder.frame_format import FrameFormat
from acquire.recorder.image import RawImageEncoder, png_message
from acquire.recorder.messages import BorrowedImage, ImageMessage, SmallMessage
from schemas import topics
from schemas.mcap.records import Buffer
from schemas.proto import percuss_pb2 as pb

FRAME_ID: Final = "camera"
"""Foxglove's name of the camera frame C; the calibration message carries the same name"""


class FrameFile:
    """Writer of frames as messages of two topics: the image, and the meta (times, exposure, losses)."""

    def __init__(self, sink: FileSeries, frames: FrameFormat, wall_anchor_ns: int, *, raw: bool) -> None:
        """Declare two topics in `sink`: the camera's images, and the frames' metadata (FrameMeta).

        Args:
            sink: file, or series of files, that is written.
            frames: camera name and size of the images.
            wall_anchor_ns: log time minus host monotonic time [ns].
            raw: format of the images. True: foxglove.RawImage; False: foxglove.CompressedImage (PNG).
        """
        self._sink = sink
        self._anchor = wall_anchor_ns
        self._encoder = RawImageEncoder(FRAME_ID, frames.width, frames.height)
        self._raw = raw
        self._images = sink.add_topic(
            topics.raw_image(frames.camera) if raw else topics.compressed_image(frames.camera)
        )
        self._metas = sink.add_topic(topics.frame_meta(frames.camera))
        self._meta_template = pb.FrameMeta(width=frames.width, height=frames.height)

    def write_images(self, frames: Sequence[Frame]) -> None:
        """Write the images of frames together, all or none; without their metadata (FrameMeta).

        Raises:
            DiskBehind: there is no memory for the images now.
            RecorderError: the file accepts no images (disk full or failing, recording finished), a raw image
                differs in size from the recording's, or a PNG cannot be encoded. In each case none was
                written.
        """
        messages: list[ImageMessage] = []
        for frame in frames:
            time_ns = self._anchor + frame.mid_exposure_ns
            image = frame.image
            data: list[Buffer] = (
                self._encoder.encode(time_ns, image) if self._raw else [png_message(FRAME_ID, time_ns, image)]
            )
            messages.append(ImageMessage(time_ns, data, frame.sequence))
        self._sink.write_images(self._images, messages)

    def write_borrowed(self, frames: Sequence[Frame]) -> None:
        """Write the raw images of frames directly from the camera's buffers, all or none.

        Their metadata (times, exposure, losses) are not written here. Each buffer is released when the disk
        has its image, or when the disk fails later.

        Args:
            frames: at least one, each with a borrowed buffer (kept until its release).

        Raises:
            DiskBehind: there is no room for the images now.
            RecorderError: the file accepts no images (disk full or failing, recording finished), or an image
                differs in size from the recording's. In each case no buffer was released.
        """
        anchor, prefix = self._anchor, self._encoder.prefix
        pixels = [frame.pixels for frame in frames]
        crcs = [crc_of(each) for each in pixels]
        images: list[BorrowedImage] = []
        for frame, each, crc in zip(frames, pixels, crcs, strict=True):
            time_ns = anchor + frame.mid_exposure_ns
            message = BorrowedImage(
                time_ns, frame.sequence, prefix(time_ns, len(each)), each, crc, frame.buffer.release
            )
            images.append(message)
        self._sink.write_borrowed(self._images, images)

    def write_metas(self, frames: Sequence[tuple[Frame, bool]]) -> None:
        """Write the meta (FrameMeta message: times, exposure, losses) of frames.

        Args:
            frames: pairs of a frame and a bool, True if the frame's image is in the file.

        Raises:
            RecorderError: the disk is full or failing, or the recording is finished.
        """
        anchor = self._anchor
        self._sink.write_small(
            self._metas,
            [
                SmallMessage(anchor + frame.mid_exposure_ns, self._meta(frame, recorded), frame.sequence)
                for frame, recorded in frames
            ],
        )

    def flush(self) -> None:
        """Hand small messages that wait in memory to the current file.

        Small messages are those of all topics but the images. On return other programs can read them, except
        those for which the file has no room now: these stay in memory.

        Raises:
            RecorderError: the disk refused some of the messages.
        """
        self._sink.flush()

    def _meta(self, frame: Frame, recorded: bool) -> bytes:
        meta = pb.FrameMeta()
        meta.CopyFrom(self._meta_template)  # takes half as long as naming every field
        meta.sequence = frame.sequence
        meta.device_time_ns = frame.device_time_ns
        meta.host_time_ns = frame.host_time_ns
        meta.mid_exposure_host_ns = frame.mid_exposure_ns
        meta.frame_id = frame.frame_id
        meta.mapping_sd_ns = frame.mapping_sd_ns
        meta.exposure_us = frame.exposure_us
        if frame.lost_before:
            meta.frames_lost_before = frame.lost_before
        if recorded:
            meta.image_recorded = True
        return meta.SerializeToString()
