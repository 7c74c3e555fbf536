"""Destinations of a replay: the viewer rerun in a window, a browser, or a file."""

from __future__ import annotations

import tempfile
import time
import webbrowser
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pyarrow as pa

from analyze.replay.stream_file import finish_file
from analyze.replay.viewer import ReplayError, Viewer, native_viewer, web_viewer

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import rerun as rr

_FLUSH_TIMEOUT_S = 20.0
_POLL_S = 0.2


class ViewerClosed(Exception):
    """The user closed the replay's viewer before everything was sent."""


class Target(Protocol):
    """Destination of a replay: called with the stream at each stage of the sending."""

    def connect(self, stream: rr.RecordingStream) -> None:
        """Connect the stream of the replay to this destination."""
        ...

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Deliver the replay's stream so far to this destination; it holds at least one strike's images.

        It is called once for a complete recording, and repeatedly for one that is still being written.
        """
        ...

    def check(self) -> None:
        """Raise ViewerClosed if the user closed the viewer, ReplayError if it failed."""
        ...

    def sent(self, stream: rr.RecordingStream) -> None:
        """Finish the replay, after everything was put into the stream."""
        ...


class ToViewer:
    """Destination of a replay: a running viewer, in a window or as a server for browsers."""

    def __init__(self, viewer: Viewer) -> None:
        self._viewer = viewer

    def connect(self, stream: rr.RecordingStream) -> None:
        """Wait until the viewer accepts data, and connect the stream.

        Raises:
            ReplayError: the viewer does not accept data.
        """
        # At its first array of Python objects pyarrow imports pandas and ignores every exception on the way,
        # Ctrl-C too: not while the user already sees an address. The viewer is starting meanwhile.
        pa.array([""])
        self._viewer.wait_until_ready()
        stream.connect_grpc(self._viewer.url)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Flush the stream, which has the images of at least one strike by now, to the viewer.

        Raises:
            ViewerClosed: the user closed the viewer.
            ReplayError: the viewer failed, or does not accept data.
        """
        self._flush(stream)

    def check(self) -> None:
        """Raise ViewerClosed if the user closed the viewer, ReplayError if it failed."""
        if self._viewer.ended():
            if self._viewer.process.returncode != 0:
                raise ReplayError(self._viewer.why_ended())
            raise ViewerClosed

    def sent(self, stream: rr.RecordingStream) -> None:
        """Flush the stream to the viewer and close it.

        Raises:
            ViewerClosed: the user closed the viewer.
            ReplayError: the viewer failed, or does not accept data.
        """
        self._flush(stream)
        stream.disconnect()

    def _flush(self, stream: rr.RecordingStream) -> None:
        try:
            stream.flush(timeout_sec=_FLUSH_TIMEOUT_S)
        except RuntimeError as error:
            self.check()
            raise ReplayError(f"rerun's viewer does not accept data: {error}") from None

    def wait(self) -> None:
        """Wait until the user closes the viewer, without a limit of time.

        Raises:
            ReplayError: the viewer failed.
        """
        while not self._viewer.ended():
            time.sleep(_POLL_S)
        if self._viewer.process.returncode != 0:
            raise ReplayError(self._viewer.why_ended())


class ToBrowser(ToViewer):
    """Destination of a replay: rerun's web viewer, shown in a browser.

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
        """Wait until the server accepts data, connect the stream, and announce the page's address.

        Raises:
            ReplayError: the server does not accept data.
        """
        super().connect(stream)
        self._announce(self._page)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Flush the stream; on the first call, open the browser if requested.

        Raises:
            ViewerClosed: the server was ended by the user.
            ReplayError: the server failed, or does not accept data.
        """
        super().first_strike_sent(stream)
        if self._open:
            self._open = False
            webbrowser.open(self._page)


class ToFile:
    """Destination of a replay: a file of rerun (.rrd).

    Args:
        part: path while the file is being written.
        output: final path of the complete file.
    """

    def __init__(self, part: Path, output: Path) -> None:
        self._part = part
        self.output = output

    def connect(self, stream: rr.RecordingStream) -> None:
        """Start writing the stream to the temporary file `part`."""
        stream.save(self._part)

    def first_strike_sent(self, stream: rr.RecordingStream) -> None:
        """Do nothing: a file has no viewer that waits."""

    def check(self) -> None:
        """Do nothing: a file cannot be closed by the user."""

    def sent(self, stream: rr.RecordingStream) -> None:
        """Flush and close the stream, and rename the temporary file `part` to `output`.

        Raises:
            OutputError: the file could not be written to its end.
        """
        finish_file(stream, self._part, self.output)


@contextmanager
def to_window(recording_bytes: int, headless_port: int | None = None) -> Iterator[ToViewer]:
    """Run the viewer rerun in a window for the duration of a `with` block.

    Args:
        recording_bytes: size of the recording, from which the memory limit follows.
        headless_port: port on which to run without a screen, for measurements; None for a window.

    Yields:
        The viewer as a destination, which may not accept data yet.

    Raises:
        ReplayError: rerun's viewer is not installed.
    """
    with native_viewer(recording_bytes, headless=headless_port is not None, port=headless_port) as viewer:
        yield ToViewer(viewer)


@contextmanager
def to_browser(
    recording_bytes: int, announce_address: Callable[[str], None], *, open_browser: bool
) -> Iterator[ToViewer]:
    """Serve rerun's web viewer on this computer for the duration of a `with` block.

    Args:
        recording_bytes: size of the recording, from which the memory limit follows.
        announce_address: called with the page's address once the server answers.
        open_browser: True to open a browser once the first strike was sent.

    Yields:
        The server as a destination, which may not accept data yet.

    Raises:
        ReplayError: rerun's viewer is not installed.
    """
    with web_viewer(recording_bytes) as viewer:
        yield ToBrowser(viewer, announce_address, open_browser=open_browser)


@contextmanager
def to_file(output: Path | None) -> Iterator[ToFile]:
    """Write a replay to a file (.rrd) that appears complete or not at all.

    Args:
        output: the file; None for a temporary file, which is removed at the end of the `with` block.

    Yields:
        The file as a destination.

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
