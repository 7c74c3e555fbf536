"""Read point clouds from PLY, PCD, XYZ, LAS and LAZ files, in the file's unit; finite points only.

PCD is read here: its specification is short, and the libraries for it are heavy or need a compiler.
"""

# laspy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import re
import struct
import warnings
from io import BytesIO

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry.mesh_files import PLY_TYPES, refuse_false_ply_counts
from analyze.types import Array

FORMATS = ("ply", "pcd", "xyz", "las", "laz")
"""Suffixes of the formats that are read."""
MIN_POINTS = 200
"""Smallest number of points from which an exterior is made."""
MAX_POINTS = 60_000
"""Largest number of points used; of more, every n-th: further points do not improve the planes."""
MAX_UNPACKED_RATIO = 100
"""Largest unpacked over packed size of a file; LAZ compresses 5 to 20 times."""
PCD_TYPES = {("F", 4): "<f4", ("F", 8): "<f8"} | {
    (kind, size): f"<{letter}{size}" for kind, letter in (("I", "i"), ("U", "u")) for size in (1, 2, 4, 8)
}
"""numpy type of a PCD file's numbers by kind (float, integer, unsigned) and size [bytes]."""


def read_cloud(data: bytes, name: str, suffix: str) -> tuple[Array, tuple[str, ...]]:
    """Read the points of a point cloud file, without repeated ones, in the file's unit.

    If there are more than `MAX_POINTS`, only one in every n is kept, spread over the whole cloud.

    Args:
        data: Content of the file.
        name: Name of the file, for messages.
        suffix: Format, one of `FORMATS`.

    Returns:
        Points (n, 3) in the file's unit, and notes for the user on decimal commas and on what was left out.

    Raises:
        ShapeError: the file is not readable, its decimal separator is ambiguous, or it has fewer than
            `MIN_POINTS` different points.
    """
    readers = {"ply": _ply, "pcd": _pcd, "xyz": _xyz, "las": _las, "laz": _las}
    notes: list[str] = []
    if suffix == "xyz":
        data, commas = _with_decimal_points(data, name)
        if commas:
            notes.append(f"{name}: its commas are read as decimal commas")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            points = np.asarray(readers[suffix](data), dtype=np.float64)
    except Exception:  # the readers raise whatever the damaged byte leads to
        raise ShapeError(
            f"{name}: cannot be read as {suffix.upper()}: it is damaged or of another format: export it anew"
        ) from None
    good = np.isfinite(points).all(axis=1) & (np.abs(points) < 1e12).all(axis=1)
    if not good.all():
        notes.append(f"{name}: {int(np.sum(~good))} points with infinite or missing coordinates are left out")
    points = np.unique(points[good], axis=0)
    if len(points) < MIN_POINTS:
        raise ShapeError(
            f"{name}: {len(points)} different points are too few for an exterior: scan again, with "
            f"{MIN_POINTS} or more"
        )
    if len(points) > MAX_POINTS:
        step = -(-len(points) // MAX_POINTS)
        notes.append(f"{name}: one in {step} of its {len(points)} points is used")
        # Taken in the order of a golden-ratio sequence: in the order of a grid or of coordinates, every n-th
        # would leave rows out.
        points = points[np.argsort((np.arange(len(points)) * 0.6180339887498949) % 1)[::step]]
    return points, tuple(notes)


def _ply(data: bytes) -> Array:
    refuse_false_ply_counts(data)
    head, _, body = data.partition(b"end_header")
    body = body[body.index(b"\n") + 1 :]
    order, count, names, types = "", 0, [], []
    for line in head.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            order = words[1]
        elif words[:1] == ["element"]:
            # The points are the first element; further elements are not read.
            if names:
                break
            count = int(words[2]) if words[1] == "vertex" else 0
        elif words[:1] == ["property"] and count:
            names.append(words[2])
            types.append(PLY_TYPES[words[1]])
    if not count:
        raise ValueError("no vertices")
    if order == "ascii":
        return _table(body.split(b"\n", count)[:count])[:, [names.index(axis) for axis in "xyz"]]
    mark = {"binary_little_endian": "<", "binary_big_endian": ">"}[order]
    table = np.frombuffer(
        body, dtype=[(name, mark + kind) for name, kind in zip(names, types, strict=True)], count=count
    )
    return np.stack([table[axis].astype(np.float64) for axis in "xyz"], axis=1)


def _xyz(data: bytes) -> Array:
    """Points (n, 3) of an XYZ file's text, in the file's unit; columns after x, y and z are ignored.

    Columns are separated by blanks, commas or semicolons. Comments (# or //) and up to two leading lines with
    a count or column names are skipped.

    Raises:
        ValueError: the lines have different lengths, fewer than 3 columns, or something else than numbers.
    """
    text = data.replace(b",", b" ").replace(b";", b" ").replace(b"//", b"#")
    lines = [line for line in (line.split(b"#")[0] for line in text.splitlines()) if line.strip()]
    return _table(lines[sum(not _is_row(line) for line in lines[:2]) :])[:, :3]


def _with_decimal_points(data: bytes, name: str) -> tuple[bytes, bool]:
    """Text of an XYZ file with decimal points for decimal commas, and True if it had decimal commas.

    Without them it is returned as it is. Commas are decimal if semicolons or blanks separate three or more
    columns, each with at most one comma, and no comma stands beside a blank or ends a column. The first two
    lines, which may have column names, are not considered.

    Args:
        data: Content of the file.
        name: Name of the file, for messages.

    Raises:
        ShapeError: numbers with decimal commas contain points too, both commas and semicolons separate
            columns, or the commas may separate either columns or decimals.
    """
    if b"," not in data:
        return data, False
    lines = [
        line
        for line in (line.split(b"#")[0].strip() for line in data.replace(b"//", b"#").splitlines())
        if line
    ]
    text = b"\n".join(lines[2:])
    unclear = "write numbers with decimal points, and blanks between the columns"
    if b"," not in text or re.search(rb",[ \t]|[ \t],|,[;\n]|,,", text):
        return data, False
    columns = [line.replace(b";", b" ").split() for line in lines[2:]]
    fewest = min(len(row) for row in columns)
    single = all(word.count(b",") <= 1 for row in columns for word in row)
    if fewest >= 3 and single:
        if b"." in text:
            raise ShapeError(f"{name}: its numbers contain both points and commas: {unclear}")
        return data.replace(b",", b"."), True
    if b";" in text:
        raise ShapeError(f"{name}: both commas and semicolons separate its columns: {unclear}")
    # Pairs of whole numbers may be decimals; a sign at every second place excludes that.
    many = len(lines[-1].split(b","))
    if b"." not in text and fewest == 1 and many >= 6 and many % 2 == 0:
        signed = any(word.startswith(b"-") for line in lines[2:] for word in line.split(b",")[1::2])
        if not signed:
            raise ShapeError(f"{name}: its commas may separate columns or decimals: {unclear}")
    return data, False


def _is_row(line: bytes) -> bool:
    try:
        return len([float(word) for word in line.split()]) >= 3
    except ValueError:
        return False


def _table(lines: list[bytes]) -> Array:
    """Numbers (n, k) of n text lines with k numbers each, separated by blanks.

    Raises:
        ValueError: the lines have different lengths, fewer than 3 numbers, or something else than numbers.
    """
    width = len(lines[0].split())
    values = np.array(b" ".join(lines).split(), dtype=np.float64)
    if width < 3 or values.size != len(lines) * width:
        raise ValueError("lines of different lengths")
    return values.reshape(-1, width)


def _las(data: bytes) -> Array:
    import laspy

    if data[:4] != b"LASF" or len(data) < 227:
        raise ValueError("not LAS")
    minor, packed = data[25], bool(data[104] & 0x80)
    size = struct.unpack_from("<H", data, 105)[0]
    count = struct.unpack_from("<Q", data, 247)[0] if minor >= 4 else struct.unpack_from("<I", data, 107)[0]
    records = struct.unpack_from("<I", data, 100)[0] * 54 + (
        struct.unpack_from("<I", data, 243)[0] * 60 if minor >= 4 else 0
    )
    if records > len(data) or count * size > len(data) * (MAX_UNPACKED_RATIO if packed else 1):
        raise ValueError("counts larger than the file")
    try:
        return np.asarray(laspy.read(BytesIO(data), laz_backend=laspy.LazBackend.Lazrs).xyz)
    except BaseException as error:  # lazrs panics on damaged bytes with an exception that is no Exception
        raise ValueError(str(error)) from None


def _pcd(data: bytes) -> Array:
    """Points (n, 3) of a PCD 0.7 file: ascii, binary (records) or binary_compressed (LZF, columns).

    Raises:
        ValueError: there are no points, or sizes contradict each other; on a damaged header other exceptions
            too.
    """
    fields: dict[str, list[str]] = {}
    offset = 0
    while "DATA" not in fields:
        end = data.index(b"\n", offset)
        words = data[offset:end].decode("ascii", errors="replace").split("#")[0].split()
        offset = end + 1
        if words:
            fields[words[0].upper()] = words[1:]
    names, sizes, kinds = fields["FIELDS"], [int(size) for size in fields["SIZE"]], fields["TYPE"]
    repeats = [int(many) for many in fields.get("COUNT", ["1"] * len(names))]
    count = (
        int(fields["POINTS"][0]) if "POINTS" in fields else int(fields["WIDTH"][0]) * int(fields["HEIGHT"][0])
    )
    columns = [sum(repeats[: names.index(axis)]) for axis in "xyz"]
    stored = fields["DATA"][0]
    if min(sizes) < 1 or min(repeats) < 1 or count < 1:
        raise ValueError("no points")
    if stored == "ascii":
        return _table(data[offset:].split(b"\n", count)[:count])[:, columns]
    width = sum(size * many for size, many in zip(sizes, repeats, strict=True))
    axes = [names.index(axis) for axis in "xyz"]
    kept = [PCD_TYPES[kinds[axis], sizes[axis]] for axis in axes]
    starts = [
        sum(size * many for size, many in zip(sizes[:axis], repeats[:axis], strict=True)) for axis in axes
    ]
    if stored == "binary":
        record = np.dtype({"names": list("xyz"), "formats": kept, "offsets": starts, "itemsize": width})
        table = np.frombuffer(data, dtype=record, count=count, offset=offset)
        return np.stack([table[axis] for axis in "xyz"], axis=1)
    packed, unpacked = struct.unpack_from("<II", data, offset)
    if (
        stored != "binary_compressed"
        or unpacked != count * width
        or unpacked > MAX_UNPACKED_RATIO * len(data)
    ):
        raise ValueError("sizes contradict each other")
    block = _lzf(data[offset + 8 : offset + 8 + packed], unpacked)
    return np.stack(
        [
            np.frombuffer(block, dtype=kind, count=count, offset=start * count)
            for kind, start in zip(kept, starts, strict=True)
        ],
        axis=1,
    )


def _lzf(packed: bytes, size: int) -> bytes:
    """Bytes decompressed from LibLZF data (Lehmann 2000).

    The data are runs of literals, and copies from the output so far.

    Args:
        packed: Compressed data.
        size: Size of the result [bytes].

    Raises:
        ValueError: the result has another size, or a copy starts before the beginning; cut data raise
            IndexError too.
    """
    out = bytearray()
    at = 0
    while at < len(packed):
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
        else:
            length = control >> 5
            if length == 7:
                length += packed[at]
                at += 1
            start = len(out) - ((control & 0x1F) << 8) - packed[at] - 1
            at += 1
            if start < 0:
                raise ValueError("copies from before the start")
            length += 2
            # A copy that runs into itself repeats what is there.
            piece = out[start : start + length]
            out += (piece * -(-length // len(piece)))[:length]
        if len(out) > size:
            raise ValueError("longer than announced")
    if len(out) != size:
        raise ValueError("shorter than announced")
    return bytes(out)
