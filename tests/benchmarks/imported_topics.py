"""Strikes as topics of images for `imported_codecs`: Foxglove MCAP files and ROS 2 bags."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import cv2
import foxglove
import numpy as np
from foxglove.channels import RawImageChannel
from foxglove.messages import RawImage, Timestamp
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from analyze.types import ImageFrame

ROS = get_typestore(Stores.ROS2_HUMBLE)
LATER_NS = 3_000_000
"""delay of a message's log time after the time of its image [ns]"""


def foxglove_file(path: Path, frames: Iterable[ImageFrame]) -> None:
    """Write one foxglove.RawImage (mono8) per image."""
    context = foxglove.Context()
    with foxglove.open_mcap(path, context=context):
        channel = RawImageChannel("/camera/image", context=context)
        for frame in frames:
            height, width = frame.image.shape
            stamp = Timestamp(frame.time_ns // 10**9, frame.time_ns % 10**9)
            image = RawImage(
                timestamp=stamp,
                width=width,
                height=height,
                encoding="mono8",
                step=width,
                data=frame.image.tobytes(),
            )
            channel.log(image, log_time=frame.time_ns + LATER_NS)


def ros_colour_bag(path: Path, frames: Iterable[ImageFrame]) -> None:
    """Write one sensor_msgs/Image (bgr8) per image, in SQLite."""
    _bag(path, frames, StoragePlugin.SQLITE3, "sensor_msgs/msg/Image")


def ros_jpeg_bag(path: Path, frames: Iterable[ImageFrame]) -> None:
    """Write one sensor_msgs/CompressedImage (JPEG, quality 95) per image, in MCAP."""
    _bag(path, frames, StoragePlugin.MCAP, "sensor_msgs/msg/CompressedImage")


def _bag(path: Path, frames: Iterable[ImageFrame], storage: StoragePlugin, name: str) -> None:
    kinds = ROS.types
    with Writer(path, version=9, storage_plugin=storage) as writer:
        connection = writer.add_connection("/camera/image_raw", name, typestore=ROS)
        for frame in frames:
            stamp = kinds["builtin_interfaces/msg/Time"](
                sec=frame.time_ns // 10**9, nanosec=frame.time_ns % 10**9
            )
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")
            height, width = frame.image.shape
            if name.endswith("CompressedImage"):
                coded = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, 95])[1]
                message = kinds[name](
                    header=header, format="mono8; jpeg compressed mono8", data=coded.ravel()
                )
            else:
                pixels = np.repeat(frame.image[..., None], 3, axis=-1).ravel()
                message = kinds[name](
                    header=header,
                    height=height,
                    width=width,
                    encoding="bgr8",
                    is_bigendian=0,
                    step=3 * width,
                    data=pixels,
                )
            writer.write(connection, frame.time_ns + LATER_NS, ROS.serialize_cdr(message, name))
