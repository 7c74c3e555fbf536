"""The tea box of the phone sample without its tags, filmed with a global shutter at 120 Hz."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

import numpy as np

from analyze.geometry.object_model import ObjectModel, load_object_model
from analyze.reading.object_file import read_object_files
from analyze.types import CameraModel, ImageFrame
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedStrike, parse_strike_plan
from tests import make_phone_videos as phone
from tests.places import ROOT

FOLDER = ROOT / "docs" / "examples" / "phone"
RATE_HZ, FIRST_NS = 120, 1_000_000_000


@dataclass(frozen=True)
class Tip:
    """Images of one strike, with the truth."""

    planned: PlannedStrike
    frames: list[ImageFrame]
    theta: np.ndarray
    """(n,) true tipping angle [rad]"""
    contact_ns: int
    phi: float
    """true balance angle [rad]"""
    k: float
    """true rate constant [rad/s^2]"""


def box() -> tuple[ObjectSpec, ObjectModel]:
    """Object file without tags, and shape."""
    files = read_object_files(FOLDER / "teabox.toml")
    spec = files.spec.model_copy(update={"marker": []})
    return spec, load_object_model(spec, files.shape_bytes, files.shape_name)


def camera() -> CameraModel:
    """The phone where it stands."""
    R, eye = phone.camera()
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R.T, eye
    return CameraModel(phone.WIDTH, phone.HEIGHT, phone.K, np.array([phone.K1, 0, 0, 0, 0]), pose)


def tip(number: int, seed: int, *, blank: bool = False) -> Tip:
    """Strike of the sample's plan; a hand puts the box down a degree and two millimetres off (1 sd)."""
    text = (FOLDER / "plan.json").read_text(encoding="utf-8")
    drawn, planned = json.loads(text)["strikes"][number], parse_strike_plan(text, "plan").strikes[number]
    spec = {"shape": {"box": {"size_m": [0.075, 0.065, 0.13]}}, "marker": []}
    random = np.random.default_rng(seed)
    sides = phone.box_sides(spec, random)
    if blank:
        sides = [(corners, np.full_like(texture, 150)) for corners, texture in sides]
    theta = np.array(list(phone.tipping(drawn, RATE_HZ)))
    images = phone.strike_images(sides, drawn, random, 0.0, RATE_HZ)
    frames = [ImageFrame(FIRST_NS + round(i * 1e9 / RATE_HZ), i, image) for i, image in enumerate(images)]
    lever = np.array(planned.R_world_object) @ (phone.COM - np.array(planned.pivot.point))
    arm, line = math.hypot(lever[0], lever[2]), np.array(planned.pivot.direction)
    about = float(line @ phone.INERTIA @ line) + phone.MASS * (arm + planned.pivot.radius_m) ** 2
    rest = round(phone.REST_S * RATE_HZ)
    return Tip(
        planned,
        frames,
        theta,
        frames[rest - 1].time_ns + 4_100_000,
        math.atan2(-lever[0], lever[2]),
        phone.MASS * phone.GRAVITY * arm / about,
    )
