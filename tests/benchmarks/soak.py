"""Recording at line rate for minutes: `make soak-capture` (ten minutes; SOAK_SECONDS=60 for one).

A virtual GigE camera on loopback sends 365 frames of 656 x 492 per second, the capacity of a gigabit cable.
The real client and the real capture process write them continuously into files of 2 GB. A separate reader
checks each finished file and deletes it: every checksum, every frame number that the camera stamped into the
pixels, every frame id, every hundredth image pixel by pixel. Exit code 1 if a frame is missing or a byte is
wrong.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import click
import numpy as np
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage

from acquire.camera.frame_loss import FrameLoss
from acquire.capture.link import CaptureProcess
from acquire.clock.clock import SystemClock
from acquire.errors import RecorderError
from acquire.recorder.recover.rewrite import mapped, read_layout
from schemas.mcap import records as container
from schemas.mcap.chunks import chunk_messages
from schemas.mcap.walk import walk
from schemas.proto import percuss_pb2 as pb
from schemas.rig import CameraConfig, RecorderConfig, RigConfig
from schemas.session_manifest import CameraCalibrationSpec
from tests import small_recording
from tests.acquire.virtual.pattern_source import noise, read_stamp, stamped
from tests.places import ROOT

WIDTH, HEIGHT, SEED = 656, 492, 7
CAMERA = ROOT / "tests" / "acquire" / "camera" / "pattern_camera.py"
CHECK_EVERY = 100


# --- the reader's process
# -----------------------------------------------------------------------------------------


@dataclass
class Reader:
    """Verifier of a sequence of files."""

    rate_hz: float
    files: int = 0
    frames: int = 0
    size: int = 0
    missing: int = 0
    """number of frames missing by the number in the pixels"""
    missing_ids: int = 0
    """number of frames missing by frame id and device time"""
    wrong: list[str] = field(default_factory=list)
    _number: int | None = None

    def __post_init__(self) -> None:
        self._pattern = noise(WIDTH, HEIGHT, SEED)
        self._loss = FrameLoss(self.rate_hz)

    def verify(self, path: Path) -> None:
        """Verify one file from its first byte to its last."""
        images: dict[int, int] = {}
        metas: dict[int, pb.FrameMeta] = {}
        with mapped(path) as data:
            layout = read_layout(path, data)
            for opcode, _, body in walk(data[: layout.data_end], len(container.MAGIC)):
                if opcode == container.CHUNK:
                    self._chunk(chunk_messages(container.parse_chunk(body)), layout.channels, images, metas)
        if list(images) != list(metas):
            self.wrong.append(f"{path.name}: images and meta are not of the same frames")
        for meta in metas.values():
            self.missing_ids += self._loss.before(meta.frame_id, meta.device_time_ns)
        self.files += 1
        self.size += path.stat().st_size

    def _chunk(
        self,
        messages: memoryview,
        channels: dict[int, container.ChannelRecord],
        images: dict[int, int],
        metas: dict[int, pb.FrameMeta],
    ) -> None:
        for opcode, _, record in walk(messages):
            if opcode != container.MESSAGE:
                continue
            message = container.parse_message(record)
            topic = channels[message.channel_id].topic
            if topic.endswith("/image"):
                images[message.sequence] = self._image(message)
            elif topic.endswith("/meta"):
                metas[message.sequence] = pb.FrameMeta.FromString(message.data)

    def _image(self, message: container.MessageRecord) -> int:
        pixels = np.frombuffer(message.data[-WIDTH * HEIGHT :], np.uint8)  # the last field of the message
        start_ns, number = read_stamp(pixels)
        self.missing += number - self._number - 1 if self._number is not None else 0
        self._number = number
        if number % CHECK_EVERY == 0:
            image = np.frombuffer(RawImage.FromString(message.data).data, np.uint8).reshape(HEIGHT, WIDTH)
            if not np.array_equal(image, stamped(self._pattern, start_ns, number)):
                self.wrong.append(f"frame {number}: pixels differ")
        self.frames += 1
        return number


def read_all(first: Path, rate_hz: float) -> None:
    """Verify and delete `first` and the following files as they are finished, until standard input closes."""
    reader = Reader(rate_hz)
    path, part = first, 1
    ended = False
    while True:
        if path.exists():
            try:
                reader.verify(path)
                path.unlink()
            except (FileNotFoundError, RecorderError):  # eight files later the ring takes it
                reader.wrong.append(
                    f"{path.name}: gone before it was read: this machine is too busy for the reader"
                )
            part += 1
            path = first.with_name(f"{first.stem}-{part:04d}{first.suffix}")
        elif ended:
            break
        else:
            ended = bool(select.select([sys.stdin], [], [], 0.2)[0])
    sys.stdout.write(
        json.dumps({key: value for key, value in vars(reader).items() if not key.startswith("_")})
    )


# --- the capture process, seen from outside
# -----------------------------------------------------------------------


@dataclass(frozen=True)
class Usage:
    """CPU time and memory of a process."""

    cpu_s: float
    memory_mb: float

    @classmethod
    def of(cls, pid: int) -> Usage:
        """Read the usage of a process from /proc."""
        fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
        cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return cls(cpu_s, int(fields[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6)


def _rig(address: str, rate_hz: float, rotate_bytes: int) -> RigConfig:
    calibration = CameraCalibrationSpec(
        width=WIDTH,
        height=HEIGHT,
        K=[[1430, 0, 328], [0, 1430, 246], [0, 0, 1]],
        T_world_camera=np.eye(4).tolist(),
    )
    camera = CameraConfig(address=address, frame_rate_hz=rate_hz, exposure_us=1000.0, calibration=calibration)
    return RigConfig(
        camera=camera, recorder=RecorderConfig(mode="continuous", rotate_bytes=rotate_bytes, keep_files=8)
    )


@click.command()
@click.option("--seconds", default=600.0)
@click.option("--rate", "rate_hz", default=365.0, help="Frames per second.")
@click.option("--file-bytes", default=2 << 30)
@click.option("--address", default="127.0.0.61", help="Address of the virtual camera, on loopback.")
@click.option(
    "--folder",
    type=click.Path(path_type=Path, exists=True),
    help="Folder on the disk to be used; a temporary one by default.",
)
@click.option("--verify", type=click.Path(path_type=Path), hidden=True)
def main(
    seconds: float, rate_hz: float, file_bytes: int, address: str, folder: Path | None, verify: Path | None
) -> None:
    """Run camera, capture and reader, and report losses."""
    if verify is not None:
        read_all(verify, rate_hz)
        return
    with tempfile.TemporaryDirectory(dir=folder, prefix="percuss-soak-") as scratch:
        result = soak(Path(scratch) / "soak.mcap", seconds, _rig(address, rate_hz, file_bytes))
    sys.stdout.write(json.dumps(result, indent=1) + "\n")
    if result["frames_verified"] < result["frames"] or any(
        result[key] for key in ("lost", "missing_by_number", "missing_by_frame_id", "wrong")
    ):
        raise SystemExit(1)


def soak(path: Path, seconds: float, rig: RigConfig) -> dict:
    """Record for `seconds`, and return all figures, ready for JSON."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "env": environment}
    reading = [sys.executable, __file__, "--verify", str(path), "--rate", str(rig.camera.frame_rate_hz)]
    with (
        subprocess.Popen([sys.executable, str(CAMERA), rig.camera.address], **pipes) as camera,
        subprocess.Popen(["nice", *reading], **pipes) as reader,
    ):
        capture = CaptureProcess(rig)
        try:
            assert camera.stdout is not None
            camera.stdout.readline()  # "ready"
            capture.start()
            process = capture._process
            assert process is not None
            clock = SystemClock()
            manifest = small_recording.manifest(wall_anchor_ns=clock.wall_ns() - clock.monotonic_ns())
            capture.open_recording(path, manifest, [])
            time.sleep(2.0)
            before, begun = Usage.of(process.pid), time.monotonic()
            memory = [before.memory_mb]
            written = capture.status().bytes_written
            while (elapsed := time.monotonic() - begun) < seconds:
                time.sleep(min(1.0, seconds - elapsed))
                memory.append(Usage.of(process.pid).memory_mb)
                status = capture.status()
                sys.stderr.write(
                    f"\r{elapsed:5.0f} s  {status.fps:6.1f} fps  {status.lost} lost  {status.dropped} "
                    f"dropped  {status.error}"
                )
            after, elapsed = Usage.of(process.pid), time.monotonic() - begun
            written = capture.status().bytes_written - written
            sender = Usage.of(camera.pid)
            report = capture.close_recording()
            status = capture.status()
        finally:
            capture.stop()
            verified, _ = reader.communicate()
            camera.kill()
    found = json.loads(verified)
    return {
        "seconds": round(elapsed, 1),
        "frames": report.frames,
        "lost": report.lost,
        "dropped": status.dropped,
        "MB_per_s": round(written / elapsed / 1e6, 1),
        "frames_per_s": round(status.fps, 1),
        "memory_MB": {
            "start": round(memory[0], 1),
            "end": round(memory[-1], 1),
            "most": round(max(memory), 1),
        },
        "capture_cpu_percent": round(100 * (after.cpu_s - before.cpu_s) / elapsed, 1),
        "camera_cpu_percent": round(100 * sender.cpu_s / (elapsed + 2), 1),
        "receive_buffer_bytes": status.receive_buffer_bytes,
        "files_verified": found["files"],
        "frames_verified": found["frames"],
        "missing_by_number": found["missing"],
        "missing_by_frame_id": found["missing_ids"],
        "wrong": found["wrong"],
    }


if __name__ == "__main__":
    main()
