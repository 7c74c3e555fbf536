"""One file that this process serves through the kernel's FUSE, for programs that open it like a device.

The kernel passes open, ioctl and poll to the server, which also stores the pages that programs have mapped:
only `stat` distinguishes such a file from a driver's. The file system is attached nowhere: it is reached as
/proc/PID/fd/N/NAME, and vanishes with the process however that ends. Protocol after the kernel's
`include/uapi/linux/fuse.h`, version 7.31.
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import os
import select
import struct
import threading
from typing import TYPE_CHECKING, Final, Protocol

from acquire.errors import CameraError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

_FUSE: Final = "/dev/fuse"
_REQUEST, _ANSWER = struct.Struct("<IIQQIIII"), struct.Struct("<IiQ")
_ATTRIBUTES = struct.Struct("<6Q10I")
_ENTRY, _ATTRIBUTE_HEAD = struct.Struct("<4QII"), struct.Struct("<QII")
_IOCTL, _IOCTL_ANSWER = struct.Struct("<QIIQII"), struct.Struct("<iIII")
_POLL, _POLL_ANSWER, _READ = struct.Struct("<QQII"), struct.Struct("<II"), struct.Struct("<QQI")
_OPENED, _STORE = struct.Struct("<QIi"), struct.Struct("<QQII")
(_LOOKUP, _FORGET, _GETATTR, _OPEN, _READ_FILE, _STATFS, _RELEASE, _FLUSH, _INIT) = (
    1,
    2,
    3,
    14,
    15,
    17,
    18,
    25,
    26,
)
_INTERRUPT, _IOCTL_FILE, _POLL_FILE, _BATCH_FORGET = 36, 39, 40, 42
_WITHOUT_ANSWER = {_FORGET, _INTERRUPT, _BATCH_FORGET}
_NOTIFY_POLL, _NOTIFY_STORE = 1, 4
_ROOT, _FILE = 1, 2
_WANTS_NOTICE = 1
_FOR_EVER_S: Final = 1 << 30
_FILE_BYTES: Final = 1 << 30
_LARGEST_REQUEST: Final = 1 << 20
_SYS_FSOPEN, _SYS_FSCONFIG, _SYS_FSMOUNT = 430, 431, 432
_SET_STRING, _CREATE = 1, 6
_OPEN_FLAGS: Final = 1 << 1
"""FOPEN_KEEP_CACHE: stored pages stay when the file is opened again"""


class FileServer(Protocol):
    """Answers of the program that serves a file. Called from the file's thread; OSError refuses a request."""

    def release(self, handle: int) -> None:
        """The file was closed by the program that opened it as number `handle`."""
        ...

    def ioctl(self, handle: int, request: int, data: bytes) -> bytes:
        """Data that the ioctl number `request` returns for the data that the program gave with it."""
        ...

    def events(self, handle: int) -> int:
        """Present events of poll for the program that opened the file as number `handle`."""
        ...


class FuseFile:
    """One file of a FUSE file system, served until `close`.

    Args:
        name: name of the file.
        server: answers of its requests.

    Raises:
        CameraError: this user may not make file systems, or the kernel has no FUSE.
    """

    def __init__(self, name: str, server: FileServer) -> None:
        self._name, self._server = name.encode(), server
        self._opened = 0
        self._lock = threading.Lock()
        self._waiting: dict[int, int] = {}
        try:
            self._fuse = os.open(_FUSE, os.O_RDWR | os.O_CLOEXEC)
        except OSError as error:
            raise _no_fuse(error) from None
        try:
            self._mount = _detached_mount(self._fuse)
        except OSError as error:
            os.close(self._fuse)
            raise _no_fuse(error) from None
        self.path = f"/proc/{os.getpid()}/fd/{self._mount}/{name}"
        """path by which this user's programs can open the file while this process runs"""
        self._wake_read, self._wake_write = os.pipe2(os.O_CLOEXEC)
        self._answers: dict[int, Callable[[int, bytes], bytes]] = {
            _LOOKUP: self._lookup,
            _GETATTR: lambda node, _: _ATTRIBUTE_HEAD.pack(_FOR_EVER_S, 0, 0) + _attributes(node),
            _OPEN: self._open,
            _READ_FILE: lambda _, data: bytes(_READ.unpack_from(data)[2]),
            _STATFS: lambda *_: bytes(80),
            _RELEASE: self._release,
            _FLUSH: lambda *_: b"",
            _INIT: self._init,
            _IOCTL_FILE: self._ioctl,
            _POLL_FILE: self._poll,
        }
        self._thread = threading.Thread(target=self._serve, name="fuse-file")
        self._thread.start()

    def store(self, offset: int, data: NDArray) -> None:
        """Write an array's bytes into the file's pages from `offset` on, where programs have them mapped.

        Args:
            offset: whole pages [bytes].
            data: contiguous array of whole pages.
        """
        head = _STORE.pack(_FILE, offset, data.nbytes, 0)
        self._send(_NOTIFY_STORE, 0, head, data.data.cast("B"))

    def notify(self) -> None:
        """Wake the programs that wait for the file (poll)."""
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        for wait in waiting.values():
            with contextlib.suppress(OSError):
                self._send(_NOTIFY_POLL, 0, struct.pack("<Q", wait))

    def close(self) -> None:
        """End the file: programs that have it open get errors. May be repeated."""
        if self._fuse < 0:
            return
        os.write(self._wake_write, b"x")
        self._thread.join()
        fuse, self._fuse = self._fuse, -1
        for fd in (fuse, self._mount, self._wake_read, self._wake_write):
            os.close(fd)

    def _serve(self) -> None:
        watch = select.poll()
        watch.register(self._fuse, select.POLLIN)
        watch.register(self._wake_read, select.POLLIN)
        while True:
            ready = dict(watch.poll())
            if self._wake_read in ready:
                return
            try:
                request = os.read(self._fuse, _LARGEST_REQUEST + 4096)
            except (FileNotFoundError, InterruptedError):  # the request was withdrawn
                continue
            except OSError:  # the file system is gone
                return
            self._serve_one(request)

    def _serve_one(self, request: bytes) -> None:
        _, operation, unique, node, *_ = _REQUEST.unpack_from(request)
        if operation in _WITHOUT_ANSWER:
            return
        answer = self._answers.get(operation)
        try:
            if answer is None:
                raise OSError(errno.ENOSYS, "not served")
            body, status = answer(node, request[_REQUEST.size :]), 0
        except OSError as error:
            body, status = b"", -(error.errno or errno.EIO)
        with contextlib.suppress(OSError):  # the program that asked has ended
            self._send(status, unique, body)

    def _send(self, status: int, unique: int, *parts: bytes | memoryview) -> None:
        size = _ANSWER.size + sum(len(part) for part in parts)
        os.writev(self._fuse, [_ANSWER.pack(size, status, unique), *parts])

    @staticmethod
    def _init(_node: int, data: bytes) -> bytes:
        major, _minor, readahead, _flags = struct.unpack_from("<4I", data)
        return struct.pack("<4I2H2I2H8I", major, 31, readahead, 0, 16, 12, 4096, 1, 0, 0, *[0] * 8)

    def _lookup(self, _node: int, data: bytes) -> bytes:
        if data.rstrip(b"\0") != self._name:
            raise FileNotFoundError(errno.ENOENT, "no such file")
        return _ENTRY.pack(_FILE, 0, _FOR_EVER_S, _FOR_EVER_S, 0, 0) + _attributes(_FILE)

    def _open(self, _node: int, _data: bytes) -> bytes:
        self._opened += 1
        return _OPENED.pack(self._opened, _OPEN_FLAGS, 0)

    def _release(self, _node: int, data: bytes) -> bytes:
        (handle,) = struct.unpack_from("<Q", data)
        with self._lock:
            self._waiting.pop(handle, None)
        self._server.release(handle)
        return b""

    def _ioctl(self, _node: int, data: bytes) -> bytes:
        handle, _flags, request, _argument, given, wanted = _IOCTL.unpack_from(data)
        answer = self._server.ioctl(handle, request, data[_IOCTL.size : _IOCTL.size + given])
        return _IOCTL_ANSWER.pack(0, 0, 0, 0) + answer[:wanted]

    def _poll(self, _node: int, data: bytes) -> bytes:
        handle, wait, flags, _events = _POLL.unpack_from(data)
        with self._lock:  # first the notice, then the look: no event falls between
            if flags & _WANTS_NOTICE:
                self._waiting[handle] = wait
        return _POLL_ANSWER.pack(self._server.events(handle), 0)


def _attributes(node: int) -> bytes:
    """Attributes of the folder, or of the file: that anyone may read and write, and its size."""
    mode, size = (0o040755, 0) if node == _ROOT else (0o100666, _FILE_BYTES)
    return _ATTRIBUTES.pack(node, size, 0, 0, 0, 0, 0, 0, 0, mode, 1, os.getuid(), os.getgid(), 0, 4096, 0)


def _detached_mount(fuse: int) -> int:
    """Descriptor of the root folder of a new FUSE file system, which is attached to no folder.

    Raises:
        OSError: the kernel refuses.
    """
    library = ctypes.CDLL(None, use_errno=True)

    def call(*arguments: int | bytes | None) -> int:
        result = library.syscall(*arguments)
        if result < 0:
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        return int(result)

    context = call(_SYS_FSOPEN, b"fuse", 1)
    try:
        options = {
            "fd": str(fuse),
            "rootmode": "40000",
            "user_id": str(os.getuid()),
            "group_id": str(os.getgid()),
        }
        for name, value in options.items():
            call(_SYS_FSCONFIG, context, _SET_STRING, name.encode(), value.encode(), 0)
        call(_SYS_FSCONFIG, context, _CREATE, None, None, 0)
        return call(_SYS_FSMOUNT, context, 1, 0)
    finally:
        os.close(context)


def _no_fuse(error: OSError) -> CameraError:
    return CameraError(
        f"a virtual video device cannot be made ({error.strerror}): it needs root and the kernel's FUSE; "
        "run it as root, or use the virtual GigE camera"
    )
