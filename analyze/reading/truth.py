"""Reads the ground truth (true values of the simulation) of a virtual recording, only for comparisons."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analyze.errors import RecordingError
from analyze.reading import indexed_file
from analyze.reading.decode_message import M, decode_message
from analyze.reading.file_series import find_series_files
from analyze.reading.indexed_series import open_series
from schemas import topics
from schemas.proto import percuss_pb2 as pb


@dataclass(frozen=True)
class Truth:
    """True values of a virtual recording: the object's poses, contacts with the striker, mass properties."""

    pose_time_ns: np.ndarray
    """(n,) int64 log times of the poses [ns]"""
    poses: tuple[pb.TruthPose, ...]
    """n true poses of the object in the world frame, by log time"""
    contacts: tuple[pb.TruthContact, ...]
    """m true contacts of striker and object, by log time"""
    contact_time_ns: np.ndarray
    """(m,) int64 log times of the contacts [ns]"""
    body: pb.TruthBody
    """true mass properties of the object, friction, table tilt and camera pose"""


def read_truth(path: Path) -> Truth:
    """Read the ground truth (true values of the simulation) of a finished virtual recording.

    All files of the recording in the folder are read.

    Args:
        path: any of the recording's files.

    Returns:
        True poses and contacts with their log times [ns], and the object's true parameters.

    Raises:
        RecordingCut: a file ends early.
        RecordingError: `path` does not exist, a file is not MCAP or is damaged, or the recording holds no
            ground truth of the body.
    """
    series = open_series(path, find_series_files(path), indexed_file.open_finished)
    try:

        def decoded(topic: topics.Topic, kind: type[M]) -> tuple[M, ...]:
            return tuple(decode_message(path, message, kind) for message in series.messages(topic.name))

        bodies = decoded(topics.TRUTH_BODY, pb.TruthBody)
        if not bodies:
            raise RecordingError(
                f"{path}: holds no ground truth: only recordings of the virtual rig (`acquire demo`) can be "
                "scored"
            )
        return Truth(
            pose_time_ns=series.index(topics.TRUTH_POSE.name).time_ns,
            poses=decoded(topics.TRUTH_POSE, pb.TruthPose),
            contacts=decoded(topics.TRUTH_CONTACT, pb.TruthContact),
            contact_time_ns=series.index(topics.TRUTH_CONTACT.name).time_ns,
            body=bodies[0],
        )
    finally:
        series.close()
