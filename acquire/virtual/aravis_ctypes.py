"""Functions of libaravis that the virtual camera needs, through ctypes.

GObject introspection cannot be used: `arv_fake_camera_set_fill_pattern` is annotated with scope "call", so
PyGObject frees the callback and the first frame crashes the process (as stream callbacks did, Aravis #453).
With ctypes the callback lives as long as its Python object.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import TYPE_CHECKING, Any

from acquire.errors import CameraError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

FILL_PATTERN = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint32, ctypes.c_uint32
)
"""void fill(ArvBuffer *, void *data, guint32 exposure_us, guint32 gain, ArvPixelFormat)"""


class AravisLibrary:
    """Typed entry points of libaravis: each attribute is one C function.

    An attribute is named as the function without `arv_` and `_camera` (`object_unref`: without `g_`). `fake`
    stands for an ArvFakeCamera*, `gv_fake` for an ArvGvFakeCamera*, `buffer` for an ArvBuffer*.

    Raises:
        CameraError: libaravis or libgobject is not installed.
    """

    def __init__(self) -> None:
        try:
            aravis, gobject = ctypes.CDLL("libaravis-0.8.so.0"), ctypes.CDLL("libgobject-2.0.so.0")
        except OSError as error:
            raise CameraError(f"virtual camera: {error}: install Debian's libaravis-0.8-0") from None

        def function(library: ctypes.CDLL, name: str, result: Any, *arguments: Any) -> Any:
            entry = getattr(library, name)
            entry.restype, entry.argtypes = result, arguments
            return entry

        pointer, u32, u64, text = ctypes.c_void_p, ctypes.c_uint32, ctypes.c_uint64, ctypes.c_char_p
        four_ints = [ctypes.POINTER(ctypes.c_int)] * 4
        self.gv_fake_new_full = function(aravis, "arv_gv_fake_camera_new_full", pointer, text, text, text)
        self.gv_fake_get_fake = function(aravis, "arv_gv_fake_camera_get_fake_camera", pointer, pointer)
        self.fake_set_fill_pattern = function(
            aravis, "arv_fake_camera_set_fill_pattern", None, pointer, FILL_PATTERN, pointer
        )
        self.fake_write_register = function(
            aravis, "arv_fake_camera_write_register", ctypes.c_int, pointer, u32, u32
        )
        self.fake_read_register = function(
            aravis, "arv_fake_camera_read_register", ctypes.c_int, pointer, u32, ctypes.POINTER(u32)
        )
        self.fake_write_memory = function(
            aravis, "arv_fake_camera_write_memory", ctypes.c_int, pointer, u32, u32, pointer
        )
        self.buffer_get_data = function(
            aravis, "arv_buffer_get_data", pointer, pointer, ctypes.POINTER(ctypes.c_size_t)
        )
        self.buffer_get_image_region = function(
            aravis, "arv_buffer_get_image_region", None, pointer, *four_ints
        )
        self.buffer_set_timestamp = function(aravis, "arv_buffer_set_timestamp", None, pointer, u64)
        # CDLL calls release the GIL: the unref joins the fake's thread, whose callback may be waiting for
        # it.
        self.object_unref = function(gobject, "g_object_unref", None, pointer)

    def write_register(self, fake: int, address: int, value: int) -> None:
        """Write `value` to the 32-bit register at `address` of the fake camera (an ArvFakeCamera*)."""
        self.fake_write_register(fake, address, value)

    def read_register(self, fake: int, address: int) -> int:
        """Value of the 32-bit register at `address` of the fake camera (an ArvFakeCamera*)."""
        value = ctypes.c_uint32()
        self.fake_read_register(fake, address, ctypes.byref(value))
        return value.value

    def fill(self, buffer: int, image: NDArray[np.uint8]) -> None:
        """Copy a contiguous image (height, width) into a buffer (an ArvBuffer*), row by row.

        Pixels beyond the number in the buffer's image region are cut off. The region's size is used because
        the size that `arv_buffer_get_data` reports is that of the received data, which is 0 here.
        """
        region = [ctypes.c_int() for _ in range(4)]
        self.buffer_get_image_region(buffer, *(ctypes.byref(entry) for entry in region))
        pixels = region[2].value * region[3].value
        data = self.buffer_get_data(buffer, ctypes.byref(ctypes.c_size_t()))
        ctypes.memmove(data, image.ctypes.data, min(pixels, image.size))

    def write_text(self, fake: int, address: int, size: int, text: str) -> None:
        """Write a string into the bootstrap registers of the fake camera (an ArvFakeCamera*).

        Args:
            fake: the fake camera.
            address: first address of the string register.
            size: length of the register [bytes]; the text is cut at `size` - 1 bytes and zero-padded.
            text: the string.
        """
        data = text.encode()[: size - 1].ljust(size, b"\0")
        self.fake_write_memory(fake, address, size, ctypes.c_char_p(data))


@cache
def load() -> AravisLibrary:
    """Load libaravis and libgobject, once in this process, and return their functions.

    Raises:
        CameraError: one of the libraries is not installed.
    """
    return AravisLibrary()
