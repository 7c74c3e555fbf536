"""Frame count, losses and last frame's time of a finished file, for the gap before the next file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mcap.exceptions import McapError
from mcap.reader import make_reader

from acquire.errors import RecorderError
from schemas import topics
from schemas.proto import percuss_pb2 as pb


@dataclass(frozen=True)
class FrameTimes:
    """Numbers of frames and of lost frames, and log time [ns] of the last, of one camera in one file."""

    frames: int
    lost: int
    """number of frames lost between the file's first and last frame"""
    last_ns: int | None
    """log time of the last frame [ns]; None if the file has no frame"""

    @classmethod
    def read(cls, path: Path, camera: str) -> FrameTimes:
        """Count the frames of a complete file by their FrameMeta messages (one per frame).

        Args:
            path: complete file of a recording.
            camera: name of the camera.

        Returns:
            Number of frames, number lost between the first and the last of them (losses before the first do
            not count), and log time [ns] of the last frame in the file. If the file has no frame of this
            camera: 0, 0 and None.

        Raises:
            RecorderError: the file cannot be read, or is incomplete.
        """
        meta = topics.frame_meta(camera)
        frames = lost = 0
        last_ns = None
        try:
            with path.open("rb") as file:
                for _, _, message in make_reader(file).iter_messages(
                    topics=[meta.name], log_time_order=False
                ):
                    lost += pb.FrameMeta.FromString(message.data).frames_lost_before if frames else 0
                    frames += 1
                    last_ns = message.log_time
        except (OSError, McapError) as error:
            raise RecorderError(f"{path}: cannot be read: {error}") from None
        return cls(frames, lost, last_ns)
