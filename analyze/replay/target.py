"""Destinations of a replay: a viewer's window, a browser, or a file."""

from __future__ import annotations

import tempfile
import time
import webbrowser
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from analyze.replay.viewer import ReplayError, Viewer, native_viewer, web_viewer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import rerun as rr

_FLUSH_TIMEOUT_S = 20.0
_POLL_S = 0.2


class ViewerClosed(Exception):
    """The user closed the viewer before everything was sent."""


class Target(Protocol):
    """Destination of a replay."""

    def connect(self, stream: rr.RecordingStream) -> None:
        """Connect the stream to this destination."""
        ...

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Deliver what is in the stream: the images of at least one strike."""
        ...

    def check(self) -> None:
        """Raise ViewerClosed if the user closed the viewer."""
        ...

    def sent(self, stream: rr.RecordingStream) -> None:
        """Finish the replay; everything is in the stream."""
        ...


class ToViewer:
    """Running viewer, in a window or as a server for browsers."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer

    def connect(self, stream: rr.RecordingStream) -> None:
        """Wait until the viewer accepts data, and connect the stream.

        Raises:
            ReplayError: the viewer does not accept data.
        """
        self._viewer.wait_until_ready()
        stream.connect_grpc(self._viewer.url)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Flush the stream."""
        self._flush(stream)

    def check(self) -> None:
        """Raise ViewerClosed if the user closed the viewer, ReplayError if it failed."""
        if self._viewer.ended():
            if self._viewer.process.returncode != 0:
                raise ReplayError(self._viewer.why_ended())
            raise ViewerClosed

    def sent(self, stream: rr.RecordingStream) -> None:
        """Flush and close the stream."""
        self._flush(stream)
        stream.disconnect()

    def _flush(self, stream: rr.RecordingStream) -> None:
        try:
            stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
        except RuntimeError as error:
            self.check()
            raise ReplayError(f"rerun's viewer does not accept data: {error}") from None

    def wait(self) -> None:
        """Wait until the user closes the viewer.

        Raises:
            ReplayError: the viewer failed.
        """
        while not self._viewer.ended():
            time.sleep(_POLL_S)
        if self._viewer.process.returncode != 0:
            raise ReplayError(self._viewer.why_ended())


class ToBrowser(ToViewer):
    """Web viewer of rerun.

    Args:
        viewer: running server of the web viewer.
        announce_address: called with the address once the server answers.
        open_browser: True to open a browser after the first strike, when the page is no longer empty.
    """

    def __init__(
        self, viewer: Viewer, announce_address: Callable[[str], None], *, open_browser: bool
    ) -> None:
        super().__init__(viewer)
        self._page, self._announce, self._open = viewer.page, announce_address, open_browser

    def connect(self, stream: rr.RecordingStream) -> None:
        """Connect the stream, and announce the address."""
        super().connect(stream)
        self._announce(self._page)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Flush the stream, and open the browser after the first strike."""
        super().first_strike_sent(stream)
        if self._open:
            self._open = False
            webbrowser.open(self._page)


class ToFile:
    """Recording file of rerun (.rrd).

    Args:
        part: path while the file is being written.
        output: final path of the complete file.
    """

    def __init__(self, part: Path, output: Path) -> None:
        self._part = part
        self.output = output

    def connect(self, stream: rr.RecordingStream) -> None:
        """Write to the file."""
        stream.save(self._part)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Do nothing: a file has no viewer that waits."""

    def check(self) -> None:
        """Do nothing: a file cannot be closed by the user."""

    def sent(self, stream: rr.RecordingStream) -> None:
        """Complete the file and give it its final name."""
        stream.flush()
        stream.disconnect()
        self._part.replace(self.output)


@contextmanager
def to_window(recording_bytes: int, headless_port: int | None = None) -> Iterator[ToViewer]:
    """Start the viewer in a window; with `headless_port` it runs without a screen, for measurements."""
    with native_viewer(recording_bytes, headless=headless_port is not None, port=headless_port) as viewer:
        yield ToViewer(viewer)


@contextmanager
def to_browser(
    recording_bytes: int, announce_address: Callable[[str], None], *, open_browser: bool
) -> Iterator[ToViewer]:
    """Start the web viewer; `announce_address` is called with its address."""
    with web_viewer(recording_bytes) as viewer:
        yield ToBrowser(viewer, announce_address, open_browser=open_browser)


@contextmanager
def to_file(output: Path | None) -> Iterator[ToFile]:
    """Write a .rrd that appears at `output` complete or not at all; None writes a temporary file.

    Raises:
        ReplayError: the file cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="percuss-replay-") as folder:
        whole = output or Path(folder) / "replay.rrd"
        part = whole.with_name(whole.name + ".part")
        try:
            part.write_bytes(b"")
        except OSError as error:
            raise ReplayError(
                f"{whole}: cannot be written ({error.strerror}): choose another place"
            ) from None
        try:
            yield ToFile(part, whole)
        finally:
            part.unlink(missing_ok=True)
