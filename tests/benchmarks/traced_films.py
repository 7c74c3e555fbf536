"""Films of tips by a path tracer (Mitsuba 3), with prints, table and lamp that no other test uses.

A near lamp lights the turning faces unevenly, surfaces shine (Disney's principled BSDF), shadows are soft,
and light comes back from table and wall. Images have the tracer's own noise beside the camera's.
"""

# Mitsuba is installed by `make bench-print-traced` alone; cv2 is only partly typed.
# pyright: reportMissingImports=false, reportUnknownMemberType=false, reportUnknownVariableType=false

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import mitsuba
import numpy as np

from analyze.tracking.camera_model import project_ideal, world_to_camera
from analyze.types import CameraModel

STYLES = ("photo", "print", "text", "glossy", "blank")
"""surfaces: mottled print, print, black text on white, shining print, none"""
TEXTURE_M, _TEXTURE_PX = 0.2, 2048
"""edge of a texture, which is then mirrored [m, px]"""
SAMPLES, REST_SAMPLES, PLATE_SAMPLES = 32, 1024, 64
"""paths per pixel of a moving object, an object at rest, and the table without it"""
SUBEXPOSURES = 4
_WHITE, _GREY_NOISE, _GAIN = 0.62 * 255, 1.0, 1 / 60
"""grey value of the brightest parts, variance of the camera's noise [grey^2], and its growth with the grey"""
_AROUND_PX = np.array([14, 14])
_SHADOW_PX = np.array([130, 14])
"""pixels around the object that are traced anew: before it, and where its shadow falls"""
_LETTERS = list("ABCDEFGHKLMNOPRSTabcdeghiklmnoprstu 0123456789")
_TURNED = np.diag([-1.0, -1.0, 1.0, 1.0])
"""from the camera's frame (x right, y down) to Mitsuba's (x left, y up)"""

mitsuba.set_variant("scalar_rgb")
_TRANSFORM = mitsuba.ScalarTransform4f


class Tracer:
    """Path tracer of one object before one camera without distortion.

    Args:
        camera: camera with its pose in W; its principal point is the image's centre.
        vertices: (v, 3) vertices of the shape in O [m].
        triangles: (t, 3) their indices.
        style: surface, one of `STYLES`.
        seed: seed of prints and noise.
    """

    def __init__(
        self, camera: CameraModel, vertices: np.ndarray, triangles: np.ndarray, style: str, seed: int
    ) -> None:
        """Draw the textures and load the scene."""
        self._random = np.random.default_rng((seed, STYLES.index(style)))
        self._camera, self._vertices = camera, vertices
        self._corners = vertices[triangles].reshape(-1, 3)
        table = _bitmap(_table(self._random))
        gloss = (
            {"roughness": 0.22, "specular": 0.6} if style == "glossy" else {"roughness": 0.5, "specular": 0.4}
        )
        surface = {"type": "principled", "base_color": _bitmap(_texture(self._random, style)), **gloss}
        surroundings = _surroundings(table)
        self._empty = mitsuba.load_dict(surroundings)
        with TemporaryDirectory() as folder:
            file = Path(folder) / "object.ply"
            _write_mesh(file, self._corners, len(triangles))
            body = {"type": "ply", "filename": str(file), "face_normals": True, "bsdf": surface}
            self._scene = mitsuba.load_dict({**surroundings, "object": body})
        self._parameters = mitsuba.traverse(self._scene)
        self._rest: np.ndarray | None = None

    @cached_property
    def _plate(self) -> np.ndarray:
        """Table and wall without the object (h, w), as radiance."""
        whole = np.array([0, 0]), np.array([self._camera.width, self._camera.height])
        return self._traced(self._empty, *whole, PLATE_SAMPLES)

    @cached_property
    def _exposure(self) -> float:
        return _WHITE / float(np.quantile(self._plate, 0.97))

    def image(self, rotations: np.ndarray, positions: np.ndarray, *, at_rest: bool) -> np.ndarray:
        """Image (h, w) over one exposure.

        Args:
            rotations: (k, 3, 3) rotations from O to W during the exposure.
            positions: (k, 3) places of O in W [m].
            at_rest: True for images before the push, which share one noise of the tracer's, a small one.
        """
        if at_rest and self._rest is None:
            self._rest = self._radiance(rotations[:1], positions[:1], REST_SAMPLES)
        radiance = self._rest if at_rest else self._radiance(rotations, positions, SAMPLES)
        assert radiance is not None
        grey = np.clip(self._exposure * radiance, 0, 255)
        noise = self._random.normal(size=grey.shape) * np.sqrt(_GREY_NOISE + _GAIN * grey)
        return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)

    def _radiance(self, rotations: np.ndarray, positions: np.ndarray, samples: int) -> np.ndarray:
        """Radiance (h, w), mean over poses, by `samples` paths a pixel around the object."""
        pixels = np.concatenate([self._pixels(R, p) for R, p in zip(rotations, positions, strict=True)])
        size = np.array([self._camera.width, self._camera.height])
        low = np.clip(np.floor(pixels.min(axis=0) - _AROUND_PX), 0, size).astype(int)
        high = np.clip(np.ceil(pixels.max(axis=0) + _SHADOW_PX), 0, size).astype(int)
        parts: list[np.ndarray] = []
        for R, p in zip(rotations, positions, strict=True):
            placed = (self._corners @ R.T + p).astype(np.float32).ravel()
            self._parameters["object.vertex_positions"] = placed
            self._parameters.update()
            parts.append(self._traced(self._scene, low, high, samples // len(positions)))
        radiance = self._plate.copy()
        radiance[low[1] : high[1], low[0] : high[0]] = np.mean(parts, axis=0)
        return radiance

    def _pixels(self, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
        R, t = world_to_camera(self._camera)
        return project_ideal(self._camera, (self._vertices @ rotation.T + position) @ R.T + t)

    def _traced(self, scene: Any, low: np.ndarray, high: np.ndarray, samples: int) -> np.ndarray:
        """Radiance of a box of pixels, from `low` to before `high` (x, y)."""
        camera = self._camera
        film = {
            "type": "hdrfilm",
            "width": camera.width,
            "height": camera.height,
            "crop_offset_x": int(low[0]),
            "crop_offset_y": int(low[1]),
            "crop_width": int(high[0] - low[0]),
            "crop_height": int(high[1] - low[1]),
            "rfilter": {"type": "box"},
            "pixel_format": "luminance",
        }
        sensor = mitsuba.load_dict(
            {
                "type": "perspective",
                "fov_axis": "x",
                "fov": math.degrees(2 * math.atan(camera.width / 2 / camera.K[0, 0])),
                "near_clip": 0.01,
                "to_world": _TRANSFORM((camera.T_world_camera @ _TURNED).tolist()),
                "film": film,
            }
        )
        seed = int(self._random.integers(1 << 30))
        return np.array(mitsuba.render(scene, sensor=sensor, spp=samples, seed=seed))[:, :, 0]


def _surroundings(table: dict[str, Any]) -> dict[str, Any]:
    """Scene without the object: lamp to the left before it, even light from all around, table and wall."""
    lamp = _TRANSFORM().look_at([-0.5, -0.7, 0.8], [0, 0, 0.05], [0, 0, 1]) @ _TRANSFORM().scale(
        [0.12, 0.12, 1]
    )
    wall = (
        _TRANSFORM().translate([0, 0.9, 0])
        @ _TRANSFORM().rotate([1, 0, 0], 90)
        @ _TRANSFORM().scale([2, 2, 1])
    )
    grey = {"type": "rgb", "value": 0.5}
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 4},
        "around": {"type": "constant", "radiance": {"type": "rgb", "value": 0.25}},
        "lamp": {
            "type": "rectangle",
            "to_world": lamp,
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 14.0}},
        },
        "table": {
            "type": "rectangle",
            "to_world": _TRANSFORM().scale([1.5, 1.5, 1]),
            "bsdf": {"type": "diffuse", "reflectance": table},
        },
        "wall": {"type": "rectangle", "to_world": wall, "bsdf": {"type": "diffuse", "reflectance": grey}},
    }


def _bitmap(reflectance: np.ndarray) -> dict[str, Any]:
    return {
        "type": "bitmap",
        "bitmap": mitsuba.Bitmap(np.clip(reflectance, 0.02, 0.97).astype(np.float32)),
        "raw": True,
        "wrap_mode": "mirror",
    }


def _mottled(random: np.random.Generator, px: float) -> np.ndarray:
    """Random field (n, n) of unit variance, about `px` wide spots."""
    field = cv2.GaussianBlur(random.normal(size=(_TEXTURE_PX, _TEXTURE_PX)), (0, 0), px)
    return field / field.std()


def _table(random: np.random.Generator) -> np.ndarray:
    """Reflectance (n, n, 3) of a grained table."""
    along = np.sin(180 * np.linspace(0, 1, _TEXTURE_PX)[:, None] + _mottled(random, 60))
    grain = 0.42 + 0.06 * along + 0.02 * _mottled(random, 2)
    return np.repeat(grain[:, :, None], 3, axis=2)


def _texture(random: np.random.Generator, style: str) -> np.ndarray:
    """Reflectance (n, n, 3) of a printed surface."""
    paper = np.full((_TEXTURE_PX, _TEXTURE_PX, 3), 0.72)
    if style == "blank":
        return paper
    if style == "text":
        drawn = np.ascontiguousarray((255 * paper).astype(np.uint8))
        for row in range(0, _TEXTURE_PX, 90):
            words = "".join(random.choice(_LETTERS[17:36], 60))
            place = int(random.integers(0, 60)), row
            cv2.putText(drawn, words, place, cv2.FONT_HERSHEY_SIMPLEX, 1.3, (25, 25, 30), 2, cv2.LINE_AA)
        return drawn / 255.0
    field = _mottled(random, 50)
    fine = 0.12 * _mottled(random, 4) + 0.12 * _mottled(random, 16) if style == "photo" else 0.0
    for channel, sign in enumerate((1.0, -0.5, 1.0)):
        paper[:, :, channel] = 0.45 + 0.25 * np.tanh(0.6 * sign * field) + fine
    drawn = np.ascontiguousarray(np.clip(255 * paper, 0, 255).astype(np.uint8))
    for _ in range(160):
        words = "".join(random.choice(_LETTERS, 8))
        place = tuple(random.integers(-100, _TEXTURE_PX, 2).tolist())
        font, width = int(random.choice([0, 1, 2, 3, 4, 6])), int(random.integers(1, 6))
        colour = tuple(random.uniform(13, 242, 3).tolist())
        cv2.putText(drawn, words, place, font, float(random.uniform(0.8, 4)), colour, width, cv2.LINE_AA)
    for _ in range(40):
        place = tuple(random.integers(0, _TEXTURE_PX, 2).tolist())
        axes, turn = tuple(random.integers(10, 120, 2).tolist()), float(random.uniform(0, 180))
        colour = tuple(random.uniform(13, 242, 3).tolist())
        cv2.ellipse(drawn, place, axes, turn, 0, 360, colour, -1, cv2.LINE_AA)
    return drawn / 255.0


def _write_mesh(file: Path, corners: np.ndarray, triangles: int) -> None:
    """Write a mesh whose triangles do not share corners (3 t, 3), with a place in the texture for each.

    Upright triangles of round objects take the arc around z, all others the plane that they are nearest to.
    """
    places = np.zeros((len(corners), 2))
    round_ = triangles > 60
    for number in range(triangles):
        own = corners[3 * number : 3 * number + 3]
        normal = np.cross(own[1] - own[0], own[2] - own[0])
        normal = np.abs(normal) / np.linalg.norm(normal)
        if round_ and normal[2] < 0.7:
            middle = math.atan2(*own.mean(axis=0)[[1, 0]])
            arc = (np.arctan2(own[:, 1], own[:, 0]) - middle + math.pi) % (2 * math.pi) - math.pi + middle
            flat = np.column_stack([arc * np.hypot(own[:, 0], own[:, 1]).max(), own[:, 2]])
        else:
            along = int(np.argmax(normal))
            flat = np.delete(own, along, axis=1) + 0.05 * along
        places[3 * number : 3 * number + 3] = flat / TEXTURE_M
    mesh = mitsuba.Mesh("object", len(corners), triangles, has_vertex_texcoords=True)
    parameters = mitsuba.traverse(mesh)
    parameters["vertex_positions"] = corners.astype(np.float32).ravel()
    parameters["faces"] = np.arange(len(corners), dtype=np.uint32)
    parameters["vertex_texcoords"] = places.astype(np.float32).ravel()
    parameters.update()
    mesh.write_ply(str(file))
