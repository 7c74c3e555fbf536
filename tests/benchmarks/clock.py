"""Recorded frame times compared with ground truth: `make bench-clock` (about a minute).

A virtual camera with a drifting clock stamps the true start of each exposure, on the host's clock, into the
image. The real client and the real capture process record it, from the camera's first frame on. Each frame's
recorded time is then compared with its stamp, and the error with the recorded 1 sigma. For the last row two
busy programs per core run at the same time. Exit code 1 if a frame of an undisturbed row is off by more than
30 us, or the stated uncertainty does not cover the errors.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import click
import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap.reader import make_reader
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from acquire.capture.link import CaptureProcess
from acquire.clock.clock import DeviceClockMapper, SystemClock
from acquire.clock.reading import ClockReading
from schemas import topics
from schemas.proto import percuss_pb2 as pb
from schemas.rig import CameraConfig, RecorderConfig, RigConfig
from schemas.session_manifest import CameraCalibrationSpec
from tests import small_recording
from tests.acquire.virtual.pattern_source import read_stamp
from tests.places import ROOT

CAMERA = ROOT / "tests" / "acquire" / "camera" / "pattern_camera.py"
WIDTH, HEIGHT = 160, 120
LIMIT_US = 30.0


@dataclass(frozen=True)
class FrameTimes:
    """A recording's frames and clock readings; arrays of one entry each."""

    error_us: NDArray[np.float64]
    """(n,) recorded start of exposure minus the true one [us]"""
    sd_us: NDArray[np.float64]
    """(n,) recorded 1 sigma of that time [us]"""
    since_start_s: NDArray[np.float64]
    round_trip_us: NDArray[np.float64]
    drift: float
    """relative rate error of the camera's clock, from the readings"""
    lost: int


def rig(address: str) -> RigConfig:
    """Rig with small images, so that the link and not the disk is measured."""
    calibration = CameraCalibrationSpec(
        width=WIDTH,
        height=HEIGHT,
        K=[[1430, 0, 80], [0, 1430, 60], [0, 0, 1]],
        T_world_camera=np.eye(4).tolist(),
    )
    camera = CameraConfig(
        address=address, width=WIDTH, height=HEIGHT, receive_buffer_bytes=8 << 20, calibration=calibration
    )
    return RigConfig(camera=camera, recorder=RecorderConfig(mode="continuous", disk_reserve_bytes=0))


@contextlib.contextmanager
def busy(programs: int) -> Iterator[None]:
    """Context in which `programs` programs use a whole core each."""
    with contextlib.ExitStack() as cleanup:
        for _ in range(programs):
            loop = cleanup.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            cleanup.callback(loop.kill)
        yield


def record(path: Path, address: str, drift: float, seconds: float) -> None:
    """Record for `seconds` from the camera's first frame on."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, str(CAMERA), address, "0", str(drift)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as camera:
        capture = CaptureProcess(rig(address))
        try:
            assert camera.stdout is not None
            camera.stdout.readline()  # "ready"
            capture.start()
            clock = SystemClock()
            capture.open_recording(
                path, small_recording.manifest(wall_anchor_ns=clock.wall_ns() - clock.monotonic_ns()), []
            )
            clock.sleep(seconds)
            capture.close_recording()
        finally:
            capture.stop()
            camera.kill()


def read(path: Path) -> FrameTimes:
    """Frame times from the finished file alone, without the processes that made it."""
    stamps: dict[int, int] = {}
    metas: dict[int, pb.FrameMeta] = {}
    readings: list[pb.ClockSample] = []
    image_topic, meta_topic = topics.raw_image("main").name, topics.frame_meta("main").name
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            if channel.topic == image_topic:
                stamps[message.sequence] = read_stamp(
                    np.frombuffer(RawImage.FromString(message.data).data, np.uint8)
                )[0]
            elif channel.topic == meta_topic:
                metas[message.sequence] = pb.FrameMeta.FromString(message.data)
            elif channel.topic == topics.CLOCK_SAMPLE.name:
                readings.append(pb.ClockSample.FromString(message.data))
    frames = [(metas[number], stamp) for number, stamp in sorted(stamps.items())]
    mapper = DeviceClockMapper(window_s=1e9)
    for sample in readings:
        mapper.add(ClockReading(sample.device_time_ns, sample.host_before_ns, sample.host_after_ns))
    return FrameTimes(
        error_us=np.array(
            [meta.mid_exposure_host_ns - round(meta.exposure_us * 500.0) - stamp for meta, stamp in frames]
        )
        * 1e-3,
        sd_us=np.array([meta.mapping_sd_ns for meta, _ in frames]) * 1e-3,
        since_start_s=np.array([stamp - frames[0][1] for _, stamp in frames]) * 1e-9,
        round_trip_us=np.array([sample.host_after_ns - sample.host_before_ns for sample in readings]) * 1e-3,
        drift=10**12 / (mapper.to_host(10**12) - mapper.to_host(0)) - 1.0,
        lost=sum(meta.frames_lost_before for meta, _ in frames[1:]),
    )


@click.command()
@click.option("--seconds", default=12.0, help="Duration of each row [s].")
@click.option("--address", default="127.0.0.68", help="Address of the virtual camera, on loopback.")
def main(seconds: float, address: str) -> None:
    """Record at three drifts, and once with busy programs."""
    cores = os.cpu_count() or 1
    columns = (
        "drift",
        "measured drift",
        "frames",
        "lost",
        "round trip",
        "bias",
        "rms",
        "worst",
        "in 1st s",
        "1 sigma stated",
        "error < 1, 2, 3 sigma",
    )
    table = Table(
        *columns,
        title="Recorded frame times compared with ground truth, us; round trip: least, median, greatest",
    )
    good = True
    with tempfile.TemporaryDirectory(prefix="percuss-clock-") as scratch:
        for drift, programs in ((-50e-6, 0), (0.0, 0), (50e-6, 0), (50e-6, 2 * cores)):
            path = Path(scratch) / f"{drift}-{programs}.mcap"
            with busy(programs):
                record(path, address, drift, seconds)
            times = read(path)
            path.unlink()
            covered = [float(np.mean(np.abs(times.error_us) <= k * times.sd_us)) for k in (1, 2, 3)]
            error = times.error_us
            trips = times.round_trip_us
            worst = float(np.abs(error).max())
            good &= covered[2] == 1.0 and (worst <= LIMIT_US or programs > 0)
            table.add_row(
                f"{1e6 * drift:+.0f} ppm" + (f", {programs} busy programs" if programs else ""),
                f"{1e6 * times.drift:+.1f}",
                str(len(error)),
                str(times.lost),
                f"{trips.min():.0f}, {np.median(trips):.0f}, {trips.max():.0f}",
                f"{error.mean():+.1f}",
                f"{np.sqrt(np.mean(error**2)):.1f}",
                f"{worst:.1f}",
                f"{np.abs(error[times.since_start_s < 1.0]).max():.1f}",
                f"{np.median(times.sd_us):.1f} (most {times.sd_us.max():.1f})",
                ", ".join(f"{100 * fraction:.0f} %" for fraction in covered),
            )
    Console(width=170).print(table)
    if not good:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
