"""A picture of a replay, made without a screen."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rerun.experimental import ViewerClient

from analyze.replay.timelines import SINCE_CONTACT
from analyze.replay.viewer import ReplayError, Viewer, native

_LOADS_S, _SETTLES_S, _TRIES = 60.0, 1.5, 4


def screenshot(rrd: Path, picture: Path, seconds: float = 0.2, timeline: str = SINCE_CONTACT) -> None:
    """Write a PNG of the replay's front page at a moment on a timeline (needs a Vulkan driver; Mesa's software one will do).

    Raises:
        ReplayError: the viewer does not start, or shows nothing.
    """
    with showing(rrd) as client:
        client.set_time(timeline, duration=seconds, play_state="paused")
        # the viewer answers before its views have drawn what they loaded
        time.sleep(_SETTLES_S)
        _save(client, picture.resolve())
    if not picture.exists():
        raise ReplayError(f"{picture}: rerun's viewer wrote no picture: is the folder writable?")


@contextmanager
def showing(rrd: Path) -> Iterator[ViewerClient]:
    """A viewer without a screen that has loaded a file.

    Raises:
        ReplayError: it does not start, or what it is asked in this context fails.
    """
    with native(rrd.stat().st_size, [rrd], headless=True) as viewer:
        viewer.wait_until_ready()
        try:
            yield _loaded(viewer)
        except (RuntimeError, OSError) as error:
            if viewer.ended():
                raise ReplayError(viewer.why_ended()) from None
            raise ReplayError(f"rerun's viewer: {error}: is a Vulkan driver installed (mesa-vulkan-drivers)?") from None


def _save(client: ViewerClient, picture: Path) -> None:
    """The viewer gives itself 15 s; a software renderer on a busy computer may need more."""
    for left in reversed(range(_TRIES)):
        try:
            client.save_screenshot(str(picture))
        except RuntimeError:
            if not left:
                raise
        else:
            return


def _loaded(viewer: Viewer) -> ViewerClient:
    """A connection, once the viewer has loaded the recording."""
    ends = time.monotonic() + _LOADS_S
    while True:
        try:
            client = ViewerClient.connect(viewer.url)
            state = client.get_state()
            if state.active_recording is not None and not state.loading:
                return client
        except (RuntimeError, OSError):
            if viewer.ended() or time.monotonic() > ends:
                raise
        if time.monotonic() > ends:
            raise RuntimeError("does not show the recording")
        time.sleep(0.2)
