"""Image packets (GVSP) of a stranger: layouts as a camera sends them, from any sender.

Layouts: GigE Vision 2.0, chapter 25 (16-bit block ids).
"""

from __future__ import annotations

import socket
import struct

import numpy as np
from numpy.typing import NDArray

MONO8 = 0x01080001
_LEADER, _TRAILER, _PAYLOAD = 1, 2, 3
_IMAGE = 1
_OVERHEAD = 20 + 8 + 8
"""bytes of the IP, UDP and GVSP headers, which the packet size of a stream includes"""


def image_packets(
    frame_id: int, device_time_ns: int, image: NDArray[np.uint8], packet_size: int
) -> list[bytes]:
    """Packets of one Mono8 image (height, width): leader, payload, trailer.

    Args:
        frame_id: block id, 1 to 65535.
        device_time_ns: time of the image on the camera's clock [ns].
        image: the pixels.
        packet_size: packet size of the stream [bytes].
    """
    height, width = image.shape
    data, step = image.tobytes(), packet_size - _OVERHEAD
    pieces = [data[at : at + step] for at in range(0, len(data), step)]
    return [
        _leader(frame_id, device_time_ns, width, height),
        *(_header(frame_id, _PAYLOAD, index) + piece for index, piece in enumerate(pieces, 1)),
        _trailer(frame_id, len(pieces) + 1, height),
    ]


def headless_packets(frame_id: int, device_time_ns: int, width: int, height: int) -> list[bytes]:
    """Leader and trailer of an image without any pixels, which Aravis completes with what its buffer held."""
    return [_leader(frame_id, device_time_ns, width, height), _trailer(frame_id, 1, height)]


def _leader(frame_id: int, device_time_ns: int, width: int, height: int) -> bytes:
    content = struct.pack(">HHQIIIIIHH", 0, _IMAGE, device_time_ns, MONO8, width, height, 0, 0, 0, 0)
    return _header(frame_id, _LEADER, 0) + content


def _trailer(frame_id: int, packet_id: int, height: int) -> bytes:
    return _header(frame_id, _TRAILER, packet_id) + struct.pack(">HHI", 0, _IMAGE, height)


def _header(frame_id: int, kind: int, packet_id: int) -> bytes:
    return struct.pack(">HHI", 0, frame_id, kind << 24 | packet_id)


def spoofed(sender: tuple[str, int], receiver: tuple[str, int], packets: list[bytes]) -> None:
    """Send UDP packets under another sender's address and port, through a raw socket (needs CAP_NET_RAW)."""
    with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW) as raw:
        for packet in packets:
            udp = struct.pack(">HHHH", sender[1], receiver[1], 8 + len(packet), 0) + packet
            header = struct.pack(
                ">BBHHHBBH4s4s",
                0x45,
                0,
                20 + len(udp),
                0,
                0,
                64,
                socket.IPPROTO_UDP,
                0,
                socket.inet_aton(sender[0]),
                socket.inet_aton(receiver[0]),
            )
            raw.sendto(header + udp, (receiver[0], 0))
