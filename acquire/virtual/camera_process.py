"""Camera process of the virtual rig: renders the world's poses, serves them as a camera.

    python -m acquire.virtual.camera_process --object carton --seed 1 --dir RUN --address 127.0.0.1

Prints `{"ready": true, ...}` once the camera can be opened, and its statistics when it ends: on SIGTERM or
SIGINT, or when its parent has ended.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import os
import signal
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from acquire.clock.clock import Clock, SystemClock
from acquire.errors import AcquireError
from acquire.virtual.camera_kinds import VIRTUAL_CAMERAS
from acquire.virtual.camera_makes import MAKES
from acquire.virtual.image_source import ImageSource, StreamSettings
from acquire.virtual.pose_ring import PoseRing, PoseRingError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from acquire.virtual.render import Renderer

WORLD_START_S = 10.0
"""longest wait for the first pose of the world [s]"""
STATISTICS_FILE = "camera.json"
SWITCH_INTERVAL_S = 5e-4
"""switch interval of the interpreter's threads [s]: the longest that a due answer or frame waits for its
thread"""


class WorldSource:
    """Image source that renders the poses in the virtual world's pose ring (ring buffer in a mapped file).

    Args:
        ring: the pose ring, open for reading.
        renderer: renderer of object and arm in the view of the camera.
    """

    def __init__(self, ring: PoseRing, renderer: Renderer) -> None:
        self._ring, self._renderer = ring, renderer

    def latest_time_ns(self) -> int:
        """Host monotonic time of the newest pose [ns].

        Raises:
            PoseRingError: there is no pose yet.
        """
        return self._ring.latest_time_ns()

    def image(self, start_ns: int, settings: StreamSettings) -> NDArray[np.uint8]:
        """Image (height, width), uint8, of one exposure, cut to the region of the sensor in `settings`.

        It is the mean of 1 to 8 poses during the exposure, which gives motion blur. It is the same however
        late it is drawn, unless the ring has lost the pose.

        Args:
            start_ns: host monotonic time at which the exposure starts [ns].
            settings: region of the sensor, exposure and gain.

        Raises:
            PoseRingError: there is no pose yet.
        """
        exposure_ns = settings.exposure_us * 1e3
        poses = self._ring.poses_at([start_ns, start_ns + round(exposure_ns)])
        count = self._renderer.subexposures_needed(*poses)
        if count > 1:
            middles = (np.arange(count) + 0.5) * (exposure_ns / count)
            poses = self._ring.poses_at(start_ns + np.round(middles).astype(np.int64))
        p, q, arm_angle, arm_axis = (entry[:count] for entry in poses)
        image = self._renderer.render(p, q, arm_angle, arm_axis, settings.exposure_us, settings.gain_db)
        return image[settings.offset_y :, settings.offset_x :][: settings.height, : settings.width]


def wait_for_world(path: Path, clock: Clock, keep_waiting: Callable[[], bool] = lambda: True) -> PoseRing:
    """Wait until the virtual world has written a pose to its pose ring; return the ring, open for reading.

    The pose ring is a ring buffer of the poses of object and arm, in a mapped file.

    Args:
        path: the pose ring's file (`pose.ring`).
        clock: the host's clock.
        keep_waiting: called after every failed attempt; False ends the wait.

    Raises:
        PoseRingError: there is no pose after 10 s, or `keep_waiting` returned False.
    """
    end_ns = clock.monotonic_ns() + round(WORLD_START_S * 1e9)
    while True:
        try:
            ring = PoseRing.open(path)
            ring.latest_time_ns()
        except PoseRingError:
            if clock.monotonic_ns() > end_ns or not keep_waiting():
                raise
            clock.sleep(0.05)
        else:
            return ring


def serve(
    source: ImageSource, arguments: argparse.Namespace, clock: Clock, parent_alive: Callable[[], bool]
) -> None:
    """Run the camera until SIGTERM or SIGINT, or until `parent_alive` returns False.

    Handlers of both signals are installed. At the end the camera's statistics (frames, delays, lost packets,
    processor time) are written to `camera.json` in the run's folder and printed as one JSON line.

    Args:
        source: source of the images.
        arguments: `kind`, `make`, `address`, `seed`, `packet_loss` and `dir` of the command line.
        clock: the host's clock.
        parent_alive: called ten times a second.

    Raises:
        CameraError: the camera cannot start.
    """
    stopped = False

    def request_stop(*_: object) -> None:
        nonlocal stopped
        stopped = True

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, request_stop)
    camera = VIRTUAL_CAMERAS[arguments.kind](source, arguments, clock)
    try:
        _print_json({"ready": True, "address": arguments.address, "pid": os.getpid()})
        while not stopped and parent_alive():
            clock.sleep(0.1)
    finally:
        camera.close()
    statistics = {**asdict(camera.statistics), "cpu_s": _cpu_s(), **camera.packet_counts}
    # The parent may have closed the output already; the file remains.
    with contextlib.suppress(OSError):
        (arguments.dir / STATISTICS_FILE).write_text(json.dumps(statistics) + "\n", encoding="utf-8")
    with contextlib.suppress(OSError):
        _print_json(statistics)


def main() -> int:
    """Run the camera process with the command line's arguments; return its exit code.

    The code is 0, or 1 after an error, which is printed as one line on standard error.
    """
    parser = argparse.ArgumentParser(
        prog="camera_process", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--object", required=True, help="name of an object, or its .npz file")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--dir", type=Path, required=True, help="folder of the run with pose.ring")
    parser.add_argument("--kind", choices=sorted(VIRTUAL_CAMERAS), default="gige")
    parser.add_argument("--make", choices=sorted(MAKES), help="gige: make that the camera takes on")
    parser.add_argument("--address", default="127.0.0.1", help="gige: loopback address of the camera")
    parser.add_argument(
        "--packet-loss", type=float, default=0.0, help="gige: fraction of stream packets to lose"
    )
    # The default is wrong if the parent has ended by now, hence the option.
    parser.add_argument(
        "--parent", type=int, default=os.getppid(), help="end with this process; default: parent"
    )
    arguments = parser.parse_args()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    cv2.setNumThreads(1)
    clock = SystemClock()

    def parent_alive() -> bool:
        return os.getppid() == arguments.parent

    try:
        from acquire.virtual.object_archive import open_object
        from acquire.virtual.render import Renderer
        from acquire.virtual.station import station

        ring = wait_for_world(arguments.dir / "pose.ring", clock, parent_alive)
        virtual_object = open_object(arguments.object, arguments.seed)
        place = station(arguments.seed, virtual_object.camera_distance_m)
        renderer = Renderer(virtual_object, place, arguments.seed)
        gc.collect()
        gc.freeze()
        serve(WorldSource(ring, renderer), arguments, clock, parent_alive)
    except AcquireError as error:
        print(error, file=sys.stderr)  # noqa: T201 - this is a program
        return 1
    return 0


def _print_json(document: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(document) + "\n")
    sys.stdout.flush()


def _cpu_s() -> float:
    times = os.times()
    return times.user + times.system


if __name__ == "__main__":
    sys.exit(main())
