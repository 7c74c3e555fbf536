"""Read meshes from STL, OBJ, PLY, GLB, GLTF and 3MF files in their unit; the only user of trimesh.

Counts in a header are compared with the file's size before parsing: a corrupt count must not exhaust the
memory.
"""

# trimesh is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

import json
import re
import struct
import warnings
from io import BytesIO
from zipfile import ZipFile

import numpy as np

from analyze.errors import ShapeError
from analyze.geometry.polyhedron import directed_edges, without_degenerate
from analyze.types import Array, IntArray
from schemas.object_spec import LengthUnit

FORMATS = ("stl", "obj", "ply", "glb", "gltf", "3mf")
"""Suffixes of the formats that are read."""
MAX_UNPACKED_RATIO = 200
"""Largest unpacked over packed size of a file; XML compresses 10 to 20 times."""
ALWAYS_ACCEPTED_BYTES = 50_000_000
"""Unpacked size [bytes] that is always accepted."""
SAME_VERTEX = 1e-7
"""Distance, over the mesh's extent, within which vertices are merged: STL repeats every vertex per face, OBJ
per texture seam."""
_OBJ_CONTINUED = re.compile(rb"\\\r?\n")
_OBJ_EXTRAS = re.compile(rb"^[ \t]*(?:usemtl|mtllib|vt|vn|o|g|s)\b[^\r\n]*", re.MULTILINE)
_OBJ_FACE = re.compile(rb"^[ \t]*f\b[^\r\n]*", re.MULTILINE)
_OBJ_CORNER_EXTRAS = re.compile(rb"/-?\d*")
PLY_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
} | {f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint", "float") for size in (1, 2, 4, 8)}
"""Kind (i, u or f: integer, unsigned, float) and size [bytes], such as i2, of a PLY file's types by name."""
UNITS_3MF = {
    "millimeter": LengthUnit.MILLIMETRE,
    "centimeter": LengthUnit.CENTIMETRE,
    "inch": LengthUnit.INCH,
    "meter": LengthUnit.METRE,
}


def read_mesh(data: bytes, name: str, suffix: str, unit: LengthUnit) -> tuple[Array, IntArray]:
    """Read the triangles of a mesh file, in its unit, with the parts of a scene at their places.

    Vertices within `SAME_VERTEX` of the mesh's extent are merged, unless that leaves more edges without just
    two faces than the file's own numbers do: bodies that touch then stay apart.

    Args:
        data: Content of the file.
        name: Name of the file, for messages.
        suffix: Format, one of `FORMATS`.
        unit: Unit declared by the object file, compared with the unit stated in a 3MF file.

    Returns:
        Finite vertices (n, 3), each used by a face, in the file's unit; and faces (f, 3), none with a vertex
        twice.

    Raises:
        ShapeError: the file is not readable, has fewer than 4 faces, infinite coordinates or only coinciding
            vertices, or states another unit.
    """
    vertices, faces, _ = read_numbered_mesh(data, name, suffix, unit)
    own = without_degenerate(faces)
    merged = _merged(vertices, faces)
    return (vertices, own) if _odd_edges(own) < _odd_edges(merged[1]) else merged


def _odd_edges(faces: IntArray) -> int:
    """Number of edges that are not shared by just two of `faces` (f, 3)."""
    edges = directed_edges(faces)
    key = edges.min(axis=1) * (int(faces.max(initial=0)) + 1) + edges.max(axis=1)
    return int(np.count_nonzero(np.unique(key, return_counts=True)[1] != 2))


def read_numbered_mesh(
    data: bytes, name: str, suffix: str, unit: LengthUnit
) -> tuple[Array, IntArray, IntArray]:
    """Read the triangles of a mesh file, in its unit, with its own numbers of vertices: none are merged.

    Args:
        data: Content of the file.
        name: Name of the file, for messages.
        suffix: Format, one of `FORMATS`.
        unit: Unit declared by the object file, compared with the unit stated in a 3MF file.

    Returns:
        Finite vertices (n, 3), each used by a face, in the file's unit; faces (f, 3); and for each vertex
        the number (n,), from 0, of the piece of the file (node of a scene) that it belongs to.

    Raises:
        ShapeError: the file is not readable, has fewer than 4 faces, infinite coordinates or only coinciding
            vertices, or states another unit.
    """
    # Imported here: loading takes a second, which point clouds and primitives do not need.
    import trimesh

    log = trimesh.util.log
    spoke, log.disabled = log.disabled, True  # its notes, tracebacks among them, would reach the user
    try:
        _refuse_false_counts(data, suffix)
        with warnings.catch_warnings():
            # numpy's warning for a text that ends within a number.
            warnings.filterwarnings("error", message="string or file could not be read to its end")
            warnings.filterwarnings("ignore", category=RuntimeWarning)
            plain = BytesIO(_without_extras(data, suffix))
            scene = trimesh.load_scene(plain, file_type=suffix, process=False, skip_materials=True)
        pieces = [each for each in scene.dump() if isinstance(each, trimesh.Trimesh)]
        sizes = [len(each.vertices) for each in pieces]
        before = np.cumsum([0, *sizes[:-1]])
        vertices = np.concatenate(
            [np.zeros((0, 3)), *(np.asarray(each.vertices, dtype=np.float64) for each in pieces)]
        )
        numbered = [
            np.asarray(each.faces, dtype=np.int64) + start
            for each, start in zip(pieces, before[: len(pieces)], strict=True)
        ]
        faces = np.concatenate([np.zeros((0, 3), dtype=np.int64), *numbered])
    except _Contradiction as doubt:
        raise ShapeError(f"{name}: {doubt}") from None
    except Exception:  # trimesh's readers raise whatever the damaged byte leads to
        raise ShapeError(
            f"{name}: cannot be read as {suffix.upper()}: it is damaged or of another format: export it anew"
        ) from None
    finally:
        log.disabled = spoke
    if faces.ndim != 2 or len(faces) < 4 or faces.min() < 0 or faces.max() >= len(vertices):
        raise ShapeError(
            f"{name}: has no faces of a closed body: export the solid's exterior as {suffix.upper()} again"
        )
    if suffix == "3mf":
        _refuse_other_unit(data, name, unit)
    used, faces = np.unique(faces, return_inverse=True)
    vertices = vertices[used]
    _refuse_useless_coordinates(vertices, name)
    return vertices, faces.reshape(-1, 3).astype(np.int64), np.repeat(np.arange(len(sizes)), sizes)[used]


def _without_extras(data: bytes, suffix: str) -> bytes:
    """Content of a mesh file, reduced to what its shape needs, with text as UTF-8.

    Guessing an encoding takes longer than reading the numbers. The header of a binary STL is blanked. Of an
    OBJ, materials, textures and normals are left out: a face keeps the numbers of its vertices alone, which
    trimesh would otherwise renumber at each seam of a texture. Other formats are returned as they are.
    """
    if suffix == "stl" and len(data) == _binary_stl_size(data):
        return bytes(80) + data[80:]
    if suffix not in {"stl", "obj"}:
        return data
    plain = data.decode(errors="replace").encode()
    if suffix == "obj":
        plain = _OBJ_CONTINUED.sub(b"", plain)
        plain = _OBJ_EXTRAS.sub(b"", plain)
        plain = _OBJ_FACE.sub(lambda face: _OBJ_CORNER_EXTRAS.sub(b"", face[0]), plain)
    return plain


def is_mesh(data: bytes, suffix: str) -> bool:
    """True if a file is a mesh, not a point cloud, by its suffix; a PLY file, by its header.

    Args:
        data: Content of the file, examined only if the suffix is "ply".
        suffix: Suffix in lower case, without the dot; any other than "ply" is a mesh's if it is in `FORMATS`.
    """
    return suffix in FORMATS and (suffix != "ply" or ply_has_faces(data))


def ply_has_faces(data: bytes) -> bool:
    """True if a PLY file's header announces faces or triangle strips; else it is a point cloud."""
    header = data[:10_000].split(b"end_header")[0].decode("ascii", errors="replace")
    words = [line.split() for line in header.splitlines()]
    return any(
        word[:1] == ["element"] and word[1:2] in (["face"], ["tristrips"]) and word[2:3] != ["0"]
        for word in words
    )


class _Contradiction(Exception):
    """Error: a mesh file must not, or cannot, be read as it is; the message has the remedy.

    The file unpacks to an implausible size, keeps its numbers in another file, or is compressed by Draco.
    """


def _refuse_false_counts(data: bytes, suffix: str) -> None:
    """Raise an exception if a file announces more than it can hold, or is of another format.

    Raises:
        _Contradiction: a 3MF unpacks to an implausible size, or a GLB or glTF needs another file or Draco.
        ValueError: a count contradicts the file's size; on a damaged header other exceptions too.
    """
    if suffix == "ply":
        refuse_false_ply_counts(data)
    elif suffix == "stl":
        # trimesh would guess an encoding and read anything as text.
        if len(data) != _binary_stl_size(data) and b"\0" in data:
            raise ValueError("neither binary nor text")
    elif suffix == "3mf":
        with ZipFile(BytesIO(data)) as archive:
            unpacked = sum(item.file_size for item in archive.infolist())
        if unpacked > max(ALWAYS_ACCEPTED_BYTES, MAX_UNPACKED_RATIO * len(data)):
            raise _Contradiction(
                f"unpacks to {unpacked / 1e6:.0f} MB from {len(data) / 1e6:.1f} MB: no mesh packs so well: "
                "export it anew"
            )
    elif suffix in ("glb", "gltf"):
        _refuse_false_accessors(data, suffix)


def _binary_stl_size(data: bytes) -> int:
    """Size [bytes] that the STL file `data` should have if it is binary, by its count of triangles."""
    return 84 + 50 * int.from_bytes(data[80:84], "little")


def refuse_false_ply_counts(data: bytes) -> None:
    """Raise ValueError if the header of the PLY file `data` announces more than the file can hold.

    A header that does not end, or has a negative count, raises it too; an unknown type of number raises
    KeyError, a cut line IndexError.
    """
    head, found, _ = data[:1_000_000].partition(b"end_header")
    if not found:
        raise ValueError("no end of header")
    ascii_text = b"format ascii" in head
    least, count = 0, 0
    for line in head.decode("ascii", errors="replace").splitlines():
        words = line.split()
        if words[:1] == ["element"]:
            count = int(words[2])
            if count < 0:
                raise ValueError("negative count")
        elif words[:1] == ["property"]:
            # A number with its separator takes at least two characters; a list at least its length.
            kind = PLY_TYPES[words[2] if words[1] == "list" else words[1]]
            least += count * (2 if ascii_text else int(kind[1]))
    if least > len(data) + count:
        raise ValueError("counts larger than the file")


def _refuse_false_accessors(data: bytes, suffix: str) -> None:
    text = data
    if suffix == "glb":
        magic, _, length, json_length, kind = struct.unpack_from("<4sIII4s", data)
        if magic != b"glTF" or kind != b"JSON" or length > len(data) or 20 + json_length > len(data):
            raise ValueError("not a GLB, or cut")
        text = data[20 : 20 + json_length]
    tree = json.loads(text)
    if any(
        "uri" in buffer and not str(buffer["uri"]).startswith("data:") for buffer in tree.get("buffers", [])
    ):
        raise _Contradiction("keeps its numbers in another file: export it as GLB, which is one file")
    if any("KHR_draco_mesh_compression" in str(primitive) for primitive in tree.get("meshes", [])):
        raise _Contradiction("is compressed by Draco: export it without compression")
    for accessor in tree.get("accessors", []):
        if not 0 <= int(accessor["count"]) <= len(data):
            raise ValueError("counts larger than the file")


def _refuse_other_unit(data: bytes, name: str, unit: LengthUnit) -> None:
    with ZipFile(BytesIO(data)) as archive:
        model = next(item for item in archive.namelist() if item.lower().endswith("3dmodel.model"))
        head = archive.read(model)[:10_000].decode("utf-8", errors="replace")
    own_name = (
        head.partition("<model")[2].partition(">")[0].partition('unit="')[2].partition('"')[0] or "millimeter"
    )
    own = UNITS_3MF.get(own_name)
    if own is None:
        raise ShapeError(f"{name}: its unit, {own_name}, is not supported: export it in millimetres")
    if own is not unit:
        raise ShapeError(
            f'{name}: its own unit is {own_name}, the object file declares unit = "{unit.value}": '
            f'correct shape.unit to "{own.value}"'
        )


def _refuse_useless_coordinates(vertices: Array, name: str) -> None:
    """Raise `ShapeError` if `vertices` (n, 3) are infinite, all coincide, or lie too far from the origin."""
    if not np.isfinite(vertices).all():
        raise ShapeError(f"{name}: has infinite or missing coordinates (no numbers): export it anew")
    largest = float(np.abs(vertices).max())
    step = float(np.ptp(vertices, axis=0).max()) * SAME_VERTEX
    if step == 0 or largest > 1e15 or largest / step > 1e15:
        raise ShapeError(f"{name}: all vertices coincide, or lie too far from the origin: export it anew")


def _merged(vertices: Array, faces: IntArray) -> tuple[Array, IntArray]:
    """Vertices (k, 3) and faces (g, 3) with vertices merged within `SAME_VERTEX` of the mesh's extent."""
    step = float(np.ptp(vertices, axis=0).max()) * SAME_VERTEX
    _, first, inverse = np.unique(np.round(vertices / step), axis=0, return_index=True, return_inverse=True)
    return vertices[first], without_degenerate(inverse.ravel()[faces].astype(np.int64))
