"""A virtual webcam with the test pattern in a process of its own, until its input closes.

pattern_video.py LINK WIDTH HEIGHT [CODES [end|start [READOUT_NS]]]

It has a process of its own because a fault in a mapped page would wait for this file's server while it holds
the interpreter.
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path

from acquire.clock.clock import SystemClock
from acquire.errors import CameraError
from acquire.virtual.video_camera import VirtualVideoCamera, WebcamHabits
from tests.acquire.virtual.pattern_source import PatternSource

if __name__ == "__main__":
    sys.setswitchinterval(5e-4)
    clock = SystemClock()
    link, width, height, *rest = sys.argv[1:]
    codes = tuple((rest[0] if rest else "GREY,YUYV,MJPG").split(","))
    habits = WebcamHabits(codes, rest[1:2] == ["end"], int(rest[2]) if len(rest) > 2 else 0)
    try:
        camera = VirtualVideoCamera(int(width), int(height), PatternSource(clock, 7), clock, habits)
    except CameraError as error:
        sys.stdout.write(f"{error}\n")
        sys.exit(1)
    camera.link(Path(link))
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.read()
    camera.close()
    sys.stdout.write(json.dumps(asdict(camera.statistics)))
