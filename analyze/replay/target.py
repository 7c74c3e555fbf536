"""Where a replay is sent: a viewer's window, a browser, a file, a picture."""

from __future__ import annotations

import tempfile
import time
import webbrowser
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from analyze.replay.viewer import ReplayError, Viewer, native, web

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import rerun as rr

_FLUSH_S = 20.0
_LOOK_S = 0.2


class ViewerClosed(Exception):
    """The user closed the viewer while it was being sent to: there is nobody to replay for."""


class Target(Protocol):
    """Where a replay is sent."""

    def connect(self, stream: rr.RecordingStream) -> None:
        """Lead the stream there."""
        ...

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """A strike's images are in the stream, and should be seen now."""
        ...

    def check(self) -> None:
        """Raise ViewerClosed when nobody looks any more."""
        ...

    def sent(self, stream: rr.RecordingStream) -> None:
        """All is in the stream."""
        ...


class ToViewer:
    """A viewer that runs, in a window or as a server for browsers."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer

    def connect(self, stream: rr.RecordingStream) -> None:
        """Wait until it takes data.

        Raises:
            ReplayError: it does not.
        """
        self._viewer.wait_until_ready()
        stream.connect_grpc(self._viewer.url)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Send what waits."""
        self._flush(stream)

    def check(self) -> None:
        """Raise ViewerClosed when it was closed, ReplayError when it died."""
        if self._viewer.ended():
            if self._viewer.process.returncode != 0:
                raise ReplayError(self._viewer.why_ended())
            raise ViewerClosed

    def sent(self, stream: rr.RecordingStream) -> None:
        """Send what waits."""
        self._flush(stream)
        stream.disconnect()

    def _flush(self, stream: rr.RecordingStream) -> None:
        try:
            stream.flush(timeout_sec=_FLUSH_S)
        except RuntimeError as error:
            self.check()
            raise ReplayError(f"rerun's viewer takes no data: {error}") from None

    def wait(self) -> None:
        """Until the user closes it.

        Raises:
            ReplayError: it died.
        """
        while not self._viewer.ended():
            time.sleep(_LOOK_S)
        if self._viewer.process.returncode != 0:
            raise ReplayError(self._viewer.why_ended())


class ToBrowser(ToViewer):
    """rerun's web viewer.

    Args:
        viewer: its server.
        say: told the address once it answers.
        open_browser: with the first strike, so that the page is not empty.
    """

    def __init__(self, viewer: Viewer, say: Callable[[str], None], *, open_browser: bool) -> None:
        super().__init__(viewer)
        self._page, self._say, self._open = viewer.page, say, open_browser

    def connect(self, stream: rr.RecordingStream) -> None:
        """Wait until it serves."""
        super().connect(stream)
        self._say(self._page)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Send what waits, and open the browser the first time."""
        super().first_strike_sent(stream)
        if self._open:
            self._open = False
            webbrowser.open(self._page)


class ToFile:
    """A .rrd file.

    Args:
        part: what is written.
        output: what it is called once it is whole.
    """

    def __init__(self, part: Path, output: Path) -> None:
        self._part = part
        self.output = output

    def connect(self, stream: rr.RecordingStream) -> None:
        """Write to the file."""
        stream.save(self._part)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Nobody waits for it."""

    def check(self) -> None:
        """A file is always there."""

    def sent(self, stream: rr.RecordingStream) -> None:
        """Write what waits, and the file's end; now it has its name."""
        stream.flush()
        stream.disconnect()
        self._part.replace(self.output)


@contextmanager
def to_window(recording_bytes: int, headless_port: int | None = None) -> Iterator[ToViewer]:
    """The viewer in a window, started at once; with a port for who asks it instead of looking, it draws to nowhere."""
    with native(recording_bytes, headless=headless_port is not None, port=headless_port) as viewer:
        yield ToViewer(viewer)


@contextmanager
def to_browser(recording_bytes: int, say: Callable[[str], None], *, open_browser: bool) -> Iterator[ToViewer]:
    """The web viewer, started at once; `say` is told its address."""
    with web(recording_bytes) as viewer:
        yield ToBrowser(viewer, say, open_browser=open_browser)


@contextmanager
def to_file(output: Path | None) -> Iterator[ToFile]:
    """A .rrd that appears at `output` whole or not at all; None: one that goes with the context.

    Raises:
        ReplayError: it cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="percuss-replay-") as folder:
        whole = output or Path(folder) / "replay.rrd"
        part = whole.with_name(whole.name + ".part")
        try:
            part.write_bytes(b"")
        except OSError as error:
            raise ReplayError(f"{whole}: cannot be written ({error.strerror}): choose another place") from None
        try:
            yield ToFile(part, whole)
        finally:
            part.unlink(missing_ok=True)
