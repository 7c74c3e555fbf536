"""Screenshots of a replay, from the viewer rerun running without a screen."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rerun.experimental import ViewerClient

from analyze.replay.timelines import SINCE_CONTACT
from analyze.replay.viewer import ReplayError, Viewer, native_viewer

_LOAD_TIMEOUT_S, _DRAWING_TIME_S, _SAVE_ATTEMPTS = 60.0, 1.5, 4


def screenshot(rrd: Path, picture: Path, seconds: float = 0.2, timeline: str = SINCE_CONTACT) -> None:
    """Write a PNG of a replay's front page at one time.

    This needs a Vulkan driver; Mesa's software driver is sufficient.

    Args:
        rrd: file of the replay (.rrd).
        picture: the PNG file.
        seconds: time to show [s], on `timeline`.
        timeline: name of the timeline: "since_contact", with time 0 at each strike's contact, or "session".

    Raises:
        ReplayError: the viewer does not start, shows nothing, or writes no picture.
    """
    with headless_viewer(rrd) as client:
        client.set_time(timeline, duration=seconds, play_state="paused")
        # The viewer answers before its views have drawn the loaded data.
        time.sleep(_DRAWING_TIME_S)
        _save(client, picture.resolve())
    if not picture.exists():
        raise ReplayError(f"{picture}: rerun's viewer wrote no picture: is the folder writable?")


@contextmanager
def headless_viewer(rrd: Path) -> Iterator[ViewerClient]:
    """Run the viewer rerun without a screen for the duration of a `with` block.

    Args:
        rrd: file of the replay (.rrd) to load.

    Yields:
        Client of the viewer, once it has loaded the file.

    Raises:
        ReplayError: the viewer does not start, or a request to it fails within this context.
    """
    with native_viewer(rrd.stat().st_size, [rrd], headless=True) as viewer:
        viewer.wait_until_ready()
        try:
            yield _loaded(viewer)
        except (RuntimeError, OSError) as error:
            if viewer.ended():
                raise ReplayError(viewer.why_ended()) from None
            raise ReplayError(
                f"rerun's viewer: {error}: is a Vulkan driver installed (mesa-vulkan-drivers)?"
            ) from None


def _save(client: ViewerClient, picture: Path) -> None:
    """Save a screenshot as PNG, in up to four attempts.

    One attempt may fail, since the viewer's limit of 15 s can be too short for software rendering.

    Raises:
        RuntimeError: all attempts failed.
    """
    for left in reversed(range(_SAVE_ATTEMPTS)):
        try:
            client.save_screenshot(str(picture))
        except RuntimeError:
            if not left:
                raise
        else:
            return


def _loaded(viewer: Viewer) -> ViewerClient:
    """Connect to the viewer and wait until it has loaded the recording, at most about 60 s.

    Returns:
        Client of the viewer.

    Raises:
        RuntimeError, OSError: the viewer ended, does not answer, or does not show the recording.
    """
    deadline = time.monotonic() + _LOAD_TIMEOUT_S
    while True:
        try:
            client = ViewerClient.connect(viewer.url)
            state = client.get_state()
            if state.active_recording is not None and not state.loading:
                return client
        except (RuntimeError, OSError):
            if viewer.ended() or time.monotonic() > deadline:
                raise
        if time.monotonic() > deadline:
            raise RuntimeError("does not show the recording")
        time.sleep(0.2)
