"""Choice of the topic of images that the user means, among all topics of a message file."""

from __future__ import annotations

from pathlib import Path

from analyze.errors import ImportRefused
from analyze.sources.message_files import LoggedTopic
from analyze.sources.pictures import is_readable
from schemas.wording import counted

MAX_NAMED = 6
"""largest number of topics or types that a message names"""


def choose_topic(path: Path, topics: list[LoggedTopic], name: str | None) -> LoggedTopic:
    """Choose the topic of a message file that the user means; it must have images that can be read.

    Args:
        path: the message file, for error messages.
        topics: all topics of the file.
        name: name of the topic; None for the only one with images.

    Raises:
        ImportRefused: no topic of this name has readable images; or `name` is None, and no topic or several
            have them.
    """
    images = [topic for topic in topics if is_readable(topic.encoding, topic.schema) and topic.count != 0]
    listed = ", ".join(topic.name for topic in images[:MAX_NAMED]) + (
        ", ..." if len(images) > MAX_NAMED else ""
    )
    if name is None:
        if len(images) == 1:
            return images[0]
        if images:
            raise ImportRefused(
                f"{path}: contains {counted(len(images), 'topic')} of images: choose one with "
                f"--topic: {listed}"
            )
        others = sorted({topic.schema or topic.encoding for topic in topics})
        held = ", ".join(others[:MAX_NAMED]) or "nothing"
        raise ImportRefused(
            f"{path}: contains no readable images (Foxglove: protobuf or JSON; ROS 2: CDR), but {held}"
        )
    found = next((topic for topic in images if topic.name == name), None)
    if found is None:
        another = next((topic for topic in topics if topic.name == name), None)
        what = (
            "no such topic"
            if another is None
            else f"its messages are {another.schema or another.encoding}, not readable images"
        )
        raise ImportRefused(f"{path}: --topic {name}: {what}: it has {listed or 'no images'}")
    return found
