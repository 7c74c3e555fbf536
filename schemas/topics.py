"""The topics of a recording: name, message type and content (reference: schemas/README.md)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from schemas.proto import percuss_pb2 as pb

if TYPE_CHECKING:
    from typing import Any

    from google.protobuf.message import Message


@dataclass(frozen=True)
class Topic:
    """Topic of a recording: its name, its message type, and whether its messages are images.

    An `image` topic has chunks (blocks of the file) of its own, so that small topics are read without them.
    """

    name: str
    message: type[Message]
    image: bool = False

    @property
    def schema_name(self) -> str:
        """Full protobuf name of the topic's message type, for example foxglove.RawImage."""
        return self.message.DESCRIPTOR.full_name

    def schema_data(self) -> bytes:
        """Serialised FileDescriptorSet of the message type and all it imports, dependencies first."""
        return _descriptor_set(self.message)


@cache
def _descriptor_set(message: type[Message]) -> bytes:
    files: dict[str, Any] = {}

    def collect(file: Any) -> None:
        for dependency in file.dependencies:
            collect(dependency)
        files.setdefault(file.name, file)

    collect(message.DESCRIPTOR.file)
    result = FileDescriptorSet()
    for file in files.values():
        file.CopyToProto(result.file.add())
    return result.SerializeToString(deterministic=True)


def raw_image(camera: str) -> Topic:
    """Topic of a camera's uncompressed images: foxglove.RawImage, encoding mono8."""
    return Topic(f"/camera/{camera}/image", RawImage, image=True)


def compressed_image(camera: str) -> Topic:
    """Topic of a camera's images as PNG or JPEG files: foxglove.CompressedImage.

    It has the same name as the topic of raw images: a recording contains either kind, not both. Recorded
    images are png, without loss; imported Motion JPEG stays jpeg, as the camera coded it.
    """
    return Topic(f"/camera/{camera}/image", CompressedImage, image=True)


def compressed_video(camera: str) -> Topic:
    """Topic of an imported video: foxglove.CompressedVideo, under the name of the topic of raw images."""
    return Topic(f"/camera/{camera}/image", CompressedVideo, image=True)


def frame_meta(camera: str) -> Topic:
    """Topic of a camera's frame metadata: one FrameMeta message per frame that arrived.

    An imported video has fewer: one for the first image of each chunk (block of the file), and one for the
    first image after each gap.
    """
    return Topic(f"/camera/{camera}/meta", pb.FrameMeta)


def camera_calibration(camera: str) -> Topic:
    """Topic of a camera's calibration, foxglove.CameraCalibration; one message at the start."""
    return Topic(f"/camera/{camera}/calibration", CameraCalibration)


STRIKER_SAMPLE = Topic("/striker/sample", pb.StrikerSample)
STRIKER_EVENT = Topic("/striker/event", pb.StrikerEvent)
CLOCK_SAMPLE = Topic("/clock/sample", pb.ClockSample)
SESSION_STATE = Topic("/session/state", pb.SessionState)
SESSION_STRIKE = Topic("/session/strike", pb.StrikeRecord)
SESSION_TOSS = Topic("/session/toss", pb.TossRecord)
LOG = Topic("/log", Log)
TRUTH_POSE = Topic("/truth/pose", pb.TruthPose)
TRUTH_CONTACT = Topic("/truth/contact", pb.TruthContact)
TRUTH_BODY = Topic("/truth/body", pb.TruthBody)

TRUTH_PREFIX = "/truth/"

VIDEO_CHUNK_BYTES = 1 << 26
"""Size [bytes] from which on a new chunk of CompressedVideo begins even without a key picture.

Below it, every chunk begins with a key picture.
"""
