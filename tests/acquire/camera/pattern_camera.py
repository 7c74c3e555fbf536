"""A virtual camera with the test pattern in a process of its own, until its input closes.

pattern_camera.py ADDRESS [PACKET_LOSS [DRIFT]]
"""

from __future__ import annotations

import json
import sys

from acquire.clock.clock import SystemClock
from acquire.virtual.device_clock import DRIFT
from acquire.virtual.gige_camera import VirtualGigeCamera
from tests.acquire.virtual.pattern_source import PatternSource

if __name__ == "__main__":
    sys.setswitchinterval(5e-4)
    clock = SystemClock()
    loss = float(sys.argv[2]) if len(sys.argv) > 2 else 0.0
    drift = float(sys.argv[3]) if len(sys.argv) > 3 else DRIFT
    camera = VirtualGigeCamera(
        sys.argv[1], "PATTERN", PatternSource(clock, 7), clock, drift=drift, packet_loss=loss, seed=3
    )
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    sys.stdin.read()
    camera.close()
    sys.stdout.write(json.dumps(camera.packet_counts))
