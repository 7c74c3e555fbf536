"""Reads the last image and the quality of the frame times from a finished test video."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError

from acquire.errors import RecorderError
from acquire.recorder.recover.rewrite import mapped, read_layout
from schemas import topics
from schemas.mcap.records import ContainerError
from schemas.mcap.walk import walk_chunks, walk_messages
from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True)
class VideoContent:
    """Content of a test video's recording: last image, and quality of the frame times.

    The quality is the number of readings of the camera's clock, and the standard deviation of the last
    frame's time on the host's clock [ns].
    """

    image: NDArray[np.uint8]
    """(height, width) last image, grey levels 0 to 255"""
    clock_samples: int
    """number of readings of the camera's clock; 0 if it cannot be latched"""
    mapping_sd_ns: int
    """standard deviation of the last frame's time on the host's clock [ns]; 0 if unknown"""


def read_video(path: Path, camera: str) -> VideoContent:
    """Read the last image and the quality of the frame times from a finished recording of one camera.

    Args:
        path: the recording.
        camera: name of the camera in its topics.

    Returns:
        The last image, the number of readings of the camera's clock, and the standard deviation of the last
        frame's time on the host's clock [ns].

    Raises:
        RecorderError: the file is damaged or not a whole recording, or holds no image or one that cannot be
            read.
    """
    image, clock_samples, mapping_sd_ns = b"", 0, 0
    with mapped(path) as data:
        layout = read_layout(path, data)
        names = layout.topics
        try:
            for messages in walk_chunks(data[: layout.data_end]):
                for _, message in walk_messages(messages):
                    name = names.get(message.channel_id)
                    if name == topics.raw_image(camera).name:
                        image = message.data
                    elif name == topics.frame_meta(camera).name:
                        mapping_sd_ns = pb.FrameMeta.FromString(bytes(message.data)).mapping_sd_ns
                    elif name == topics.CLOCK_SAMPLE.name:
                        clock_samples += (
                            pb.ClockSample.FromString(bytes(message.data)).clock == f"camera/{camera}"
                        )
        except (ContainerError, DecodeError) as error:
            raise RecorderError(
                f"{path}: the test video is damaged: {error}: check the disk, then run `acquire check` again"
            ) from None
        if not image:
            raise RecorderError(f"{path}: the test video holds no image: check that the camera sends frames")
        return VideoContent(_decode_image(path, bytes(image)), clock_samples, mapping_sd_ns)


def _decode_image(path: Path, data: bytes) -> NDArray[np.uint8]:
    """Grey image (height, width) from a serialised RawImage or CompressedImage message.

    The bytes are tried as a mono8 RawImage first, then as a CompressedImage.

    Args:
        path: the recording, named in the error message.
        data: the serialised message.

    Raises:
        RecorderError: the bytes are neither.
    """
    with contextlib.suppress(ValueError, TypeError, DecodeError):
        raw = RawImage.FromString(data)
        if raw.encoding == "mono8" and len(raw.data) == raw.step * raw.height:
            return np.frombuffer(raw.data, np.uint8).reshape(raw.height, raw.step)[:, : raw.width]
    with contextlib.suppress(ValueError, TypeError, DecodeError, cv2.error):
        png = cv2.imdecode(
            np.frombuffer(CompressedImage.FromString(data).data, np.uint8), cv2.IMREAD_GRAYSCALE
        )
        if png is not None:
            return png.astype(np.uint8)
    raise RecorderError(f"{path}: the test video's image cannot be read: run `acquire check` again")
