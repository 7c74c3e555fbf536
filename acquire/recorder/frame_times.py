"""When the frames of a finished recording were exposed, and how many never came: what is needed to say what lies between two files."""

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
    """The frames of one file."""

    frames: int
    lost: int
    """between its first and its last"""
    last_ns: int | None
    """log time of the last frame; None where there is none"""

    @classmethod
    def of(cls, path: Path, camera: str) -> FrameTimes:
        """Read a whole file.

        Raises:
            RecorderError: it is not whole.
        """
        meta = topics.frame_meta(camera)
        frames = lost = 0
        last_ns = None
        try:
            with path.open("rb") as file:
                for _, _, message in make_reader(file).iter_messages(topics=[meta.name], log_time_order=False):
                    lost += pb.FrameMeta.FromString(message.data).frames_lost_before if frames else 0
                    frames += 1
                    last_ns = message.log_time
        except (OSError, McapError) as error:
            raise RecorderError(f"{path}: cannot be read: {error}") from None
        return cls(frames, lost, last_ns)
