"""Files made to harm: bombs, forged sizes and times, names that lie, and what is no file at all."""

from __future__ import annotations

import io
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import lz4.frame
import zstandard
from mcap.writer import CompressionType, Writer

from schemas import topics
from schemas.mcap import records as container
from schemas.mcap.chunks import MessagePlaces
from schemas.mcap.record_writer import RecordWriter
from schemas.session_manifest import MANIFEST_NAME, manifest_entries
from tests import small_recording as small
from tests.attack.targets import Target
from tests.mcap_writer import McapWriter

BOMB_BYTES = 2_300_000_000
HUGE = (1 << 64) - 1
NAMES = (
    "=cmd|' /C calc'!A0",
    "\x1b]0;owned\x07\x1b[2J",
    "a\x00b",
    "\u202egpj.exe",
    "<script>alert(1)</script>",
    "@x",
    "+1",
    "-1",
)


@dataclass(frozen=True)
class Hostile:
    """A hostile file: its name, the kind of target whose commands read it, and how it is written."""

    name: str
    like: str
    write: Callable[[Path], None]
    slow: bool = False
    """True if the short form of the attack leaves it out"""


def _chunk(compression: str, stored: bytes, size: int, crc: int = 0) -> bytes:
    body = struct.pack("<QQQI", 1, 2, size, crc) + container.pack_string(compression)
    return container.pack_record(container.CHUNK, body + struct.pack("<Q", len(stored)) + stored)


def _with_chunk(chunk: bytes) -> Callable[[Path], None]:
    """Write a recording with a head, to which a chunk is added that no recorder wrote, and no end."""

    def write(path: Path) -> None:
        part = path.with_name("made.mcap")
        writer = McapWriter(part)
        small.write_head(writer)
        writer.flush()
        writer.abort()
        path.write_bytes(part.with_name("made.mcap.part").read_bytes() + chunk)
        part.with_name("made.mcap.part").unlink()

    return write


def _finished(compression: str, stored: bytes, size: int) -> Callable[[Path], None]:
    """Write a whole recording whose index points at a forged chunk."""

    def write(path: Path) -> None:
        with path.open("wb") as file:
            records = RecordWriter(file.writelines)
            records.begin()
            records.write_metadata(MANIFEST_NAME, manifest_entries(_manifest()))
            records.add_topic(topics.STRIKER_SAMPLE, 1)
            places: MessagePlaces = {1: [(1, 0)]}
            records.write_chunk([b""], 0, 0, places)
            records.end()
        data = path.read_bytes()
        at = data.index(struct.pack("<B", container.CHUNK) + struct.pack("<Q", 40))
        chunk = _chunk(compression, stored, size)
        path.write_bytes(data[:at] + chunk + data[at + 49 :])

    return write


def _manifest() -> str:
    from schemas.document import canonical_json

    return canonical_json(small.manifest(hashes={}))


def lz4_declares(size: int) -> bytes:
    """LZ4 frame whose head declares a content of `size` bytes."""
    frame = bytearray(lz4.frame.compress(bytes(1000), content_checksum=False, store_size=True))
    struct.pack_into("<Q", frame, 6, size)
    frame[14] = _xxh32_byte(bytes(frame[4:14]))
    return bytes(frame)


def _xxh32_byte(data: bytes) -> int:
    """Checksum of a frame's head: second byte of xxHash-32 (Collet, 2012) of fewer than 16 bytes."""
    mask, primes = 0xFFFFFFFF, (2654435761, 2246822519, 3266489917, 668265263, 374761393)

    def turned(value: int, bits: int) -> int:
        value &= mask
        return (value << bits | value >> (32 - bits)) & mask

    found = (primes[4] + len(data)) & mask
    for at in range(0, len(data) - 3, 4):
        found = turned(found + struct.unpack_from("<I", data, at)[0] * primes[2], 17) * primes[3] & mask
    for byte in data[len(data) // 4 * 4 :]:
        found = turned(found + byte * primes[4], 11) * primes[0] & mask
    for shift, prime in ((15, primes[1]), (13, primes[2]), (16, 1)):
        found = (found ^ found >> shift) * prime & mask
    return found >> 8 & 0xFF


def zstd_declares(size: int) -> bytes:
    """Zstandard frame whose head declares a content of `size` bytes."""
    return b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", size) + b"\x01\x00\x00"


def _bomb(compress: Callable[[bytes], bytes]) -> bytes:
    return compress(bytes(BOMB_BYTES))


def _lz4_bomb(path: Path) -> None:
    _with_chunk(_chunk("lz4", _bomb(lambda data: lz4.frame.compress(data, store_size=False)), BOMB_BYTES))(
        path
    )


def _packed_file_bomb(path: Path) -> None:
    path.write_bytes(_bomb(zstandard.ZstdCompressor().compress))


def _zstd_bomb(path: Path) -> None:
    _with_chunk(_chunk("zstd", _bomb(zstandard.ZstdCompressor().compress), BOMB_BYTES))(path)


def _foreign_bomb(path: Path) -> None:
    """MCAP of another program with a chunk that is much larger than the file."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 31, compression=CompressionType.LZ4)
        writer.start()
        schema = writer.register_schema("T", "jsonschema", b"{}")
        channel = writer.register_channel("/a", "json", schema)
        for number in range(18):
            writer.add_message(channel, number, bytes(1 << 27), number, number)
        writer.finish()


def _times(sequence: int, time_ns: int) -> Callable[[Path], None]:
    """Recording with a message whose sequence number and log time are at the end of their type."""

    def write(path: Path) -> None:
        with McapWriter(path) as writer:
            small.write_head(writer)
            small.write_body(writer)
            log = writer.add_topic(topics.SESSION_STATE)
            writer.write(log, time_ns, b"", sequence=sequence)

    return write


def _named(name: str) -> Callable[[Path], None]:
    """Recording whose attachment, object and strike are called so."""

    def write(path: Path) -> None:
        from schemas.document import canonical_json

        manifest = small.manifest(hashes={})
        spec = manifest.object.model_copy(update={"name": name})
        text = canonical_json(
            manifest.model_copy(update={"object": spec, "software": name, "recording_id": name})
        )
        with McapWriter(path) as writer:
            writer.metadata(MANIFEST_NAME, manifest_entries(text))
            writer.metadata(name, {name: name})
            writer.attachment(name, name, b"x")
            small.write_body(writer)

    return write


def _png(width: int, height: int) -> bytes:
    """PNG file whose head states a size; its pixels are zeros, as many as fit."""

    def part(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = part(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + head + part(b"IDAT", zlib.compress(bytes(1 << 20))) + part(b"IEND", b"")


def _zip(files: dict[str, bytes]) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return buffer.getvalue()


_LAUGHS = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10}">' for i in range(1, 12))
_ENTITIES = (
    f'<?xml version="1.0"?><!DOCTYPE m [<!ENTITY l0 "lol">{_LAUGHS}]><model unit="millimeter">&l11;</model>'
)
_EXTERNAL = '<?xml version="1.0"?><!DOCTYPE m [<!ENTITY x SYSTEM "file:///etc/passwd">]><model>&x;</model>'
_RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">'
    '<Relationship Id="r" Target="/3D/3dmodel.model" '
    'Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)


def _3mf(model: str) -> bytes:
    return _zip({"3D/3dmodel.model": model.encode(), "_rels/.rels": _RELATIONS.encode()})


def _3mf_bomb(path: Path) -> None:
    path.write_bytes(_3mf(" " * (1 << 30)))


def _bytes(data: bytes) -> Callable[[Path], None]:
    return lambda path: void(path.write_bytes(data))


def void(_: object) -> None:
    """Nothing, of anything."""


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _hole(path: Path) -> None:
    """File of 1 TB that takes no room on the disk."""
    with path.open("wb") as file:
        file.truncate(1 << 40)


def _link(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(target)


def hostile_files() -> Iterator[Hostile]:
    """Yield every hostile file, the large ones too."""
    like = "recording (small)"
    for name, compression, stored in (
        ("LZ4 of 1 TB", "lz4", lz4_declares(1 << 40)),
        ("zstd of 1 TB", "zstd", zstd_declares(1 << 40)),
    ):
        for size in (1 << 40, 1000):
            yield Hostile(f"{name}, chunk of {size}", like, _with_chunk(_chunk(compression, stored, size)))
            yield Hostile(f"{name}, chunk of {size}, whole file", like, _finished(compression, stored, size))
    yield Hostile("LZ4 bomb", like, _lz4_bomb, slow=True)
    yield Hostile("zstd bomb", like, _zstd_bomb, slow=True)
    yield Hostile("bomb of another program", "MCAP of others", _foreign_bomb, slow=True)
    yield Hostile("chunk without content that states 1 EB", like, _with_chunk(_chunk("", b"", 1 << 60)))
    for sequence, time_ns in ((0xFFFFFFFF, 1 << 62), (0, HUGE), (1, 1 << 63), (1, (1 << 63) - 1)):
        yield Hostile(f"sequence {sequence}, time {time_ns}", like, _times(sequence, time_ns))
    for name in NAMES:
        yield Hostile(f"named {name!r}", like, _named(name))
    yield Hostile("zstd bomb", "bag (SQLite, packed file)", _packed_file_bomb, slow=True)
    yield Hostile("PNG of 2.2 GB", "image", _bytes(_png(46_000, 48_000)))
    yield Hostile("PNG of 4 G x 4 G pixels", "image", _bytes(_png(0x7FFFFFFF, 0x7FFFFFFF)))
    yield Hostile(
        "OBJ with short lines", "shape obj", _bytes(b"v 1 2\nv\nf 1\nf\nv 0 0 0\nf 1 2 3\nvn\nvt\n")
    )
    yield Hostile(
        "OBJ with far indices", "shape obj", _bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 999999999999\n")
    )
    yield Hostile(
        "ASCII STL of words", "shape ascii.stl", _bytes(b"solid x\nfacet normal a b c\nouter loop\n")
    )
    yield Hostile(
        "ASCII STL cut", "shape ascii.stl", _bytes(b"solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0")
    )
    yield Hostile(
        "STL of 4 G faces", "shape stl", _bytes(bytes(80) + struct.pack("<I", 0xFFFFFFFF) + bytes(50))
    )
    yield Hostile("PLY of 1 T vertices", "shape ply", _bytes(_PLY))
    yield Hostile("3MF with entities", "shape 3mf", _bytes(_3mf(_ENTITIES)))
    yield Hostile("3MF with an outer entity", "shape 3mf", _bytes(_3mf(_EXTERNAL)))
    yield Hostile("3MF bomb", "shape 3mf", _3mf_bomb, slow=True)
    yield Hostile(
        "GLB of 4 GB",
        "shape glb",
        _bytes(b"glTF" + struct.pack("<III4s", 2, 0xFFFFFFFF, 0xFFFFFFF0, b"JSON")),
    )
    for kind in (
        "recording (small)",
        "object file",
        "plan",
        "result",
        "image",
        "shape stl",
        "video",
        "times",
        "bag (SQLite)",
        "bag's metadata",
    ):
        slow = kind in {
            "plan",
            "result",
            "times",
            "bag (SQLite)",
            "bag's metadata",
        }  # read as the object file is
        yield Hostile("a pipe that nobody writes", kind, _fifo, slow)
        yield Hostile("a hole of 1 TB", kind, _hole, slow)
        for device in (
            "/dev/zero",
            "/dev/full",
            "/dev/tty",
            "/proc/self/mem",
            "/proc/self/environ",
            "/proc/kmsg",
            "/",
        ):
            yield Hostile(f"a link to {device}", kind, _link(device), slow or device != "/dev/zero")


_PLY = (
    b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000000\n"
    b"property float x\nproperty float y\nproperty float z\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n\0\0"
)


def fitting(target: Target, hostile: Hostile) -> bool:
    """True if the target's commands read files like this one."""
    return target.kind == hostile.like
