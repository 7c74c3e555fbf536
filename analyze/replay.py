"""A recording as something to look at, in rerun: written to a file, shown, or photographed without a screen.

Only loopback is used: rerun's viewer binds 0.0.0.0 unless it is told otherwise.
"""

from __future__ import annotations

import socket
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import rerun as rr
import rerun_cli
from rerun.experimental import ViewerClient

from analyze.errors import AnalyzeError
from analyze.recording import open_recording
from analyze.replay_layout import layout
from analyze.replay_scene import SINCE_CONTACT, Scene
from analyze.replay_views import ReplayContent, content_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from analyze.pipeline import Estimate

_APPLICATION = "percuss"
_LOOPBACK = "127.0.0.1"
_STARTS_S, _LOADS_S, _SETTLES_S = 30.0, 30.0, 1.5
_SIZE = "1680x1050"


class ReplayError(AnalyzeError):
    """The viewer cannot be started, or shows nothing."""


def replay_recording(recording: Path, estimate: Estimate, save: Path | None, picture: Path | None) -> None:
    """Write the replay to `save` and a PNG of it to `picture`; open the viewer where neither is given."""
    content = content_of(estimate)
    if save is None and picture is None:
        show_replay(recording, content)
        return
    with tempfile.TemporaryDirectory(prefix="percuss-replay-") as folder:
        output = save or Path(folder) / "replay.rrd"
        write_replay(recording, content, output)
        if picture is not None:
            screenshot(output, picture, moment_of(content))


def write_replay(recording: Path, content: ReplayContent, output: Path) -> None:
    """Write a rerun recording (.rrd); it appears complete or not at all.

    Raises:
        RecordingError: `recording` cannot be read.
        ReplayError: `output` cannot be written.
    """
    part = output.with_name(output.name + ".part")
    try:
        part.write_bytes(b"")
    except OSError as error:
        raise ReplayError(f"{output}: cannot be written ({error.strerror}): choose another place") from None
    try:
        with open_recording(recording) as opened:
            blueprint = layout(content)
            with rr.RecordingStream(_APPLICATION, recording_id=opened.manifest.recording_id) as stream:
                stream.save(part, default_blueprint=blueprint)
                stream.send_recording_name(recording.stem)
                Scene(stream, opened, content).write()
                stream.flush()
                stream.disconnect()
        part.replace(output)
    finally:
        part.unlink(missing_ok=True)


def show_replay(recording: Path, content: ReplayContent) -> None:
    """Open the viewer and wait until it is closed."""
    with tempfile.TemporaryDirectory(prefix="percuss-replay-") as folder:
        output = Path(folder) / "replay.rrd"
        write_replay(recording, content, output)
        code = subprocess.call(_command(output, _free_port()))
    if code != 0:
        raise ReplayError(f"rerun's viewer ended with code {code}: no screen? write a file with --save or a picture with --screenshot")


def screenshot(rrd: Path, picture: Path, seconds_since_contact: float = 0.2) -> None:
    """Write a PNG of the replay's front page at a moment, without a screen (needs a Vulkan driver; Mesa's software one will do).

    Raises:
        ReplayError: the viewer does not start, or shows nothing.
    """
    with _viewer(rrd) as client:
        client.set_time(SINCE_CONTACT, duration=seconds_since_contact, play_state="paused")
        # the viewer answers before its views have drawn what they loaded
        time.sleep(_SETTLES_S)
        client.save_screenshot(str(picture.resolve()))
    if not picture.exists():
        raise ReplayError(f"{picture}: rerun's viewer wrote no picture: is the folder writable?")


def moment_of(content: ReplayContent) -> float:
    """A moment [s since contact] that shows something: when the object of the front page stands on its edge."""
    motion = content.front()
    if motion is not None and motion.angle is not None and motion.phases is not None and motion.phases.stage_one is not None:
        first, last = motion.phases.stage_one
        time_ns = motion.angle.time_ns
        return float(time_ns[min(last, len(time_ns) - 1)] - time_ns[first]) * 1e-9
    return 0.2


@contextmanager
def _viewer(rrd: Path) -> Iterator[ViewerClient]:
    port = _free_port()
    with tempfile.TemporaryFile() as output:
        process = subprocess.Popen(
            [*_command(rrd, port), "--headless", "--window-size", _SIZE], stdin=subprocess.DEVNULL, stdout=output, stderr=output
        )
        client: ViewerClient | None = None
        try:
            client = _connected(process, port)
            _wait_for_recording(client)
            yield client
        except (RuntimeError, OSError, ConnectionError) as error:
            output.seek(0)
            last = [line for line in output.read().decode(errors="replace").splitlines() if line.strip()][-1:]
            raise ReplayError(f"rerun's viewer: {error} {' '.join(last)}: is a Vulkan driver installed (mesa-vulkan-drivers)?") from None
        finally:
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _connected(process: subprocess.Popen[bytes], port: int) -> ViewerClient:
    ends = time.monotonic() + _STARTS_S
    while True:
        if process.poll() is not None:
            raise RuntimeError(f"ended with code {process.returncode}")
        try:
            client = ViewerClient.connect(f"rerun+http://{_LOOPBACK}:{port}/proxy")
            client.get_state()
        except (RuntimeError, OSError, ConnectionError):
            if time.monotonic() > ends:
                raise
            time.sleep(0.2)
        else:
            return client


def _wait_for_recording(client: ViewerClient) -> None:
    ends = time.monotonic() + _LOADS_S
    while True:
        state = client.get_state()
        if state.active_recording is not None and not state.loading:
            return
        if time.monotonic() > ends:
            raise RuntimeError("does not show the recording")
        time.sleep(0.2)


def _command(rrd: Path, port: int) -> list[str]:
    # below the file's size, images vanish silently from the viewer
    limit = max(2 << 30, 4 * rrd.stat().st_size)
    return [
        _executable(), str(rrd), "--bind", _LOOPBACK, "--port", str(port), "--hide-welcome-screen",
        "--memory-limit", f"{limit >> 20}MB",
    ]  # fmt: skip


def _executable() -> str:
    """The viewer itself: `python -m rerun` would start it as a child that outlives its parent's end."""
    folder = Path(rerun_cli.__file__).parent
    found = next((folder / name for name in ("rerun", "rerun.exe") if (folder / name).exists()), None)
    if found is None:
        raise ReplayError(f"{folder}: holds no rerun viewer: install rerun-sdk again")
    return str(found)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((_LOOPBACK, 0))
        return int(probe.getsockname()[1])
