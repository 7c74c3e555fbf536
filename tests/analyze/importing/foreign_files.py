"""Recordings of other programs: Foxglove MCAP files by foxglove-sdk, ROS 2 bags by rosbags."""

from __future__ import annotations

import base64
import json
from fractions import Fraction

import av
import cv2
import foxglove
import numpy as np
from foxglove.channels import (
    CameraCalibrationChannel,
    CompressedImageChannel,
    CompressedVideoChannel,
    RawImageChannel,
)
from foxglove.messages import CameraCalibration, CompressedImage, CompressedVideo, RawImage, Timestamp
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

ROS = get_typestore(Stores.ROS2_HUMBLE)
START_NS = 1_790_000_000 * 10**9
FRAME_NS = 8_333_333
LOGGED_LATER_NS = 4_000_000
K = [300.0, 0.0, 31.5, 0.0, 300.0, 23.5, 0.0, 0.0, 1.0]
D = [-0.1, 0.02, 0.0, 0.0, 0.0]
JSON_RAW = foxglove.Schema(name="foxglove.RawImage", encoding="jsonschema", data=b'{"type": "object"}')


def images(count=12, width=64, height=48):
    """Grey ramps that brighten, smooth enough for any encoding."""
    ramp = np.linspace(40, 160, width)[None, :] + np.linspace(0, 30, height)[:, None]
    return [np.rint(ramp + 2 * i).astype(np.uint8) for i in range(count)]


def times(count):
    return [START_NS + i * FRAME_NS for i in range(count)]


def coded(image, suffix):
    return cv2.imencode(suffix, image)[1].tobytes()


def encoded(image, encoding):
    """Bytes and row length [bytes] of a grey image in an encoding of raw images."""
    height, width = image.shape
    channels = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4}.get(encoding, 1)
    if encoding in {"uyvy", "yuv422", "yuyv", "yuv422_yuy2"}:
        grey = np.full_like(image, 128)
        pair = (grey, image) if encoding in {"uyvy", "yuv422"} else (image, grey)
        pixels = np.stack(pair, axis=-1)
    elif encoding == "mono16":
        pixels = (image.astype("<u2") * 256 + 77).view(np.uint8)
    elif encoding == "nv12":
        pixels = np.concatenate([image, np.full((height // 2, width), 128, np.uint8)])
        return pixels.tobytes(), width
    else:
        pixels = np.repeat(image[..., None], channels, axis=-1)
    pixels = np.ascontiguousarray(pixels).reshape(height, -1)
    padded = np.pad(pixels, ((0, 0), (0, 6)))  # rows may be longer than the image is wide
    return padded.tobytes(), padded.shape[1]


def access_units(frames):
    """H.264 of the frames, one coded picture for each, with start codes."""
    encoder = av.CodecContext.create("libx264", "w")
    encoder.height, encoder.width = frames[0].shape
    encoder.pix_fmt, encoder.time_base = "yuv420p", Fraction(1, 120)
    encoder.options = {
        "preset": "ultrafast",
        "crf": "4",
        "bf": "0",
        "g": "5",
        "x264-params": "repeat-headers=1:annexb=1",
    }
    found = []
    for i, image in enumerate(frames):
        frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(
            format="yuv420p", dst_color_range="JPEG"
        )
        frame.pts = i
        found += encoder.encode(frame)
    return [bytes(packet) for packet in [*found, *encoder.encode(None)]]


def write_foxglove(
    path, frames, kind="mono8", topic="/cam/image", stamps=None, calibrated=True, more=(), intrinsics=None
):
    """Write an MCAP file of Foxglove's messages.

    `kind` is an encoding of raw images, "jpeg", "png", "h264" or "json".
    """
    context = foxglove.Context()
    logged = times(len(frames))
    with foxglove.open_mcap(path, context=context, allow_overwrite=True):
        if calibrated:
            CameraCalibrationChannel("/cam/calibration", context=context).log(
                CameraCalibration(
                    width=frames[0].shape[1],
                    height=frames[0].shape[0],
                    distortion_model="plumb_bob",
                    **lens(intrinsics),
                ),
                log_time=START_NS,
            )
        for other in more:
            RawImageChannel(other, context=context).log(
                RawImage(width=1, height=1, encoding="mono8", step=1, data=b"0"), log_time=START_NS
            )
        if kind == "json":
            channel = foxglove.Channel(topic, schema=JSON_RAW, message_encoding="json", context=context)
        else:
            kinds = {
                "jpeg": CompressedImageChannel,
                "png": CompressedImageChannel,
                "h264": CompressedVideoChannel,
            }
            channel = kinds.get(kind, RawImageChannel)(topic, context=context)
        units = access_units(frames) if kind == "h264" else []
        for i, image in enumerate(frames):
            stamp_ns = logged[i] if stamps is None else stamps[i]
            stamp = Timestamp(stamp_ns // 10**9, stamp_ns % 10**9)
            if units:
                message = CompressedVideo(timestamp=stamp, format=kind, data=units[i])
            elif kind in {"jpeg", "png"}:
                message = CompressedImage(timestamp=stamp, format=kind, data=coded(image, f".{kind}"))
            else:
                data, step = encoded(image, "mono8" if kind == "json" else kind)
                fields = {"width": image.shape[1], "height": image.shape[0], "step": step}
                if kind == "json":
                    when = {"sec": stamp_ns // 10**9, "nsec": stamp_ns % 10**9}
                    said = {
                        "timestamp": when,
                        **fields,
                        "encoding": "mono8",
                        "data": base64.b64encode(data).decode(),
                    }
                    message = json.dumps(said).encode()
                else:
                    message = RawImage(timestamp=stamp, encoding=kind, data=data, **fields)
            channel.log(message, log_time=logged[i] + LOGGED_LATER_NS)
    return path


def ros_header(stamp_ns):
    kinds = ROS.types
    stamp = kinds["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="camera")


def lens(intrinsics):
    """Entries K and D of the calibration messages: the file's own, or given as K's nine and then D's five."""
    if intrinsics is None:
        return {"K": K, "D": D}
    return {"K": intrinsics[:9], "D": intrinsics[9:] or [0.0] * 5}


def camera_info(header, width, height, intrinsics=None):
    kinds = ROS.types
    roi = kinds["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return kinds["sensor_msgs/msg/CameraInfo"](
        header=header,
        height=height,
        width=width,
        distortion_model="plumb_bob",
        d=np.array(lens(intrinsics)["D"]),
        k=np.array(lens(intrinsics)["K"]),
        r=np.eye(3).ravel(),
        p=np.eye(3, 4).ravel(),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


def write_bag(
    path,
    frames,
    kind="mono8",
    storage=StoragePlugin.MCAP,
    topic="/cam/image_raw",
    stamps=None,
    compressed=False,
    intrinsics=None,
):
    """Write a ROS 2 bag; `kind` is an encoding of sensor_msgs/Image, "jpeg" or "png"."""
    kinds, logged = ROS.types, times(len(frames))
    of_file = kind in {"jpeg", "png"}
    name = "sensor_msgs/msg/CompressedImage" if of_file else "sensor_msgs/msg/Image"
    writer = Writer(path, version=9, storage_plugin=storage)
    if compressed:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        info = writer.add_connection(
            f"{topic.rsplit('/', 1)[0]}/camera_info", "sensor_msgs/msg/CameraInfo", typestore=ROS
        )
        connection = writer.add_connection(topic, name, typestore=ROS)
        for i, image in enumerate(frames):
            header = ros_header(logged[i] if stamps is None else stamps[i])
            height, width = image.shape
            if i == 0:
                writer.write(
                    info,
                    logged[0],
                    ROS.serialize_cdr(
                        camera_info(header, width, height, intrinsics), "sensor_msgs/msg/CameraInfo"
                    ),
                )
            if of_file:
                data = np.frombuffer(coded(image, f".{kind}"), np.uint8)
                message = kinds[name](header=header, format=f"mono8; {kind} compressed mono8", data=data)
            else:
                data, step = encoded(image, kind)
                pixels = np.frombuffer(data, np.uint8)
                message = kinds[name](
                    header=header,
                    height=height,
                    width=width,
                    encoding=kind,
                    is_bigendian=0,
                    step=step,
                    data=pixels,
                )
            writer.write(connection, logged[i] + LOGGED_LATER_NS, ROS.serialize_cdr(message, name))
    return path
