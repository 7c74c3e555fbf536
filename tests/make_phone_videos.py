"""Maker of the sample phone videos in docs/examples/phone: a tea box, flicked by hand, and a board.

`python tests/make_phone_videos.py docs/examples/phone`

It reads `teabox.toml` and `plan.json` there, and draws what a phone would film of them: the box with its
printed sides and tags as textured planes, in perspective, through a lens with distortion, with noise, placed
and glued by a careless hand, tipping as a rigid body that rolls on its rounded edge. Nothing of it is shared
with the virtual rig or with the estimators. It writes the hidden centre of mass and inertia tensor to
`expected.toml`. Tests draw further videos with its functions.
"""

from __future__ import annotations

import json
import math
import sys
import tomllib
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime, timedelta
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np

WIDTH, HEIGHT, FOCAL, K1 = 800, 450, 775.0, 0.06
CAPTURE_HZ, PLAYED_HZ = 240, 30
REST_S, AFTER_S = 0.32, 0.03
EYE, LOOK_AT = np.array([0.012, -0.36, 0.115]), np.array([0.018, 0.0, 0.07])
GRAVITY, MASS = 9.81, 0.182
COM = np.array([0.0042, -0.0031, -0.0128])
INERTIA = np.array([[3.05e-4, 4e-6, -6e-6], [4e-6, 3.25e-4, 3e-6], [-6e-6, 3e-6, 1.72e-4]])
"""about the centre of mass, in the object's frame [kg m^2]"""
ENERGY = 1.12
"""kinetic energy after the flick, over that needed to reach balance"""
NOISE = 1.2
TEXTURE_PX_PER_M = 3000
BOARD_SQUARES, SQUARE_M, MARKER_M = (7, 9), 0.022, 0.0154
VIEWS, HELD = 26, 48
"""number of the board's views, and of frames in each"""
WHITE, BLACK = 225, 25
GLUE_M, GLUE_RAD = 3e-4, 0.005
"""standard deviations of a tag's place and turn, glued by hand"""
HAND_M, HAND_RAD = 0.002, 0.02
"""standard deviations of the box's place and heading, put down by hand"""
BOARD_M, BOARD_RAD = 5e-4, 0.002
"""standard deviations of the board's place and heading, stood on the table by hand"""
FIRST_VIDEO, BETWEEN_VIDEOS = datetime(2026, 4, 12, 10, 15, tzinfo=UTC), timedelta(seconds=37)
Image = np.ndarray
Side = tuple[np.ndarray, Image]
"""corners (4, 3) in O [m], clockwise from the upper left, and texture of a side or tag"""


def main(folder: Path) -> None:
    """Write the videos and expected.toml; videos are named by time, in another order than the plan's."""
    spec = tomllib.loads((folder / "teabox.toml").read_text(encoding="utf-8"))
    plan = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    random = np.random.default_rng(7)
    sides = box_sides(spec, random)
    for strike, number in zip(plan["strikes"], random.permutation(len(plan["strikes"])), strict=True):
        taken = FIRST_VIDEO + int(number) * BETWEEN_VIDEOS
        write_video(folder / f"VID_{taken:%Y%m%d_%H%M%S}.mp4", strike_images(sides, strike, random))
    write_video(folder / "board.mp4", board_images(random))
    rows = ", ".join(str([float(each) for each in row]) for row in INERTIA)
    (folder / "expected.toml").write_text(
        "# with which the videos were drawn, in the object's frame\n"
        f"com_m = {[float(each) for each in COM]}\n"
        f"inertia_kg_m2 = [{rows}] # about the centre of mass\n",
        encoding="utf-8",
    )


def write_video(path: Path, frames: Iterable[Image], captured_hz: int = CAPTURE_HZ) -> None:
    """Write slow motion as Android phones do: played at 30 frames a second, with the capture rate stated."""
    options = {"movflags": "use_metadata_tags", "video_track_timescale": "90000"}
    with av.open(str(path), "w", options=options) as file:
        file.metadata["com.android.capture.fps"] = str(captured_hz)
        # x264's macroblock tree codes the same images otherwise in every run.
        coding = {"crf": "22", "preset": "fast", "x264-params": "mbtree=0"}
        stream = file.add_stream("libx264", rate=PLAYED_HZ, options=coding)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.time_base = Fraction(1, PLAYED_HZ)
        for number, image in enumerate(frames):
            frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, PLAYED_HZ)
            file.mux(stream.encode(frame))
        file.mux(stream.encode(None))


# --- the motion


def tipping(strike: dict, rate_hz: int) -> Iterator[float]:
    """Tipping angle [rad] per frame, by the equation of motion of a body that rolls on a rounded edge."""
    pivot = strike["pivot"]
    axis, radius = np.array(pivot["direction"]), float(pivot["radius_m"])
    R_wo = np.array(strike["R_world_object"])
    lever = R_wo @ (COM - np.array(pivot["point"]))
    across, phi = math.hypot(lever[0], lever[2]), math.atan2(-lever[0], lever[2])
    about_c = float(axis @ INERTIA @ axis)

    def mass_at(theta: float) -> float:
        """Moment of inertia about the contact line [kg m^2] at the angle `theta` [rad]."""
        rolling = radius**2 + 2 * radius * across * math.cos(phi - theta)
        return about_c + MASS * (across**2 + rolling)

    theta, turn = 0.0, math.sqrt(2 * ENERGY * MASS * GRAVITY * across * (1 - math.cos(phi)) / mass_at(0.0))
    for _ in range(round(REST_S * rate_hz)):
        yield 0.0
    steps = 16
    while theta < math.pi / 2:
        for _ in range(steps):
            sine = math.sin(phi - theta)
            rate = -MASS * across * sine * (GRAVITY + radius * turn**2) / mass_at(theta)
            turn += rate / rate_hz / steps
            theta += turn / rate_hz / steps
        yield min(theta, math.pi / 2)
    for _ in range(round(AFTER_S * rate_hz)):
        yield math.pi / 2


# --- the picture


def camera() -> tuple[np.ndarray, np.ndarray]:
    """Pose of the phone, aligned by eye: rotation (3, 3) from world to camera, position in the world [m]."""
    forward = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
    right = np.cross(forward, [0.02, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(forward, right), forward]), EYE


K = np.array([[FOCAL, 0.0, 402.0], [0.0, FOCAL, 222.0], [0.0, 0.0, 1.0]])


def distorting_map() -> tuple[np.ndarray, np.ndarray]:
    """Pixels of the undistorted picture, drawn at twice the size, for each pixel of the phone's image."""
    grid = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(grid.astype(np.float64), K, np.array([K1, 0, 0, 0, 0]), P=K)
    large = (2 * ideal + 0.5).reshape(HEIGHT, WIDTH, 2).astype(np.float32)
    return large[..., 0], large[..., 1]


MAP = distorting_map()


def filmed(large: Image, random: np.random.Generator) -> Image:
    """Phone's image of a picture drawn at twice the size: lens, blur of the optics, noise."""
    soft = cv2.GaussianBlur(large, (0, 0), 1.0)
    image = cv2.remap(soft, *MAP, interpolation=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    noise = random.standard_normal(image.shape, np.float32) * NOISE
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def draw(large: Image, texture: Image, corners: np.ndarray) -> None:
    """Draw a texture over the quadrilateral `corners` (4, 3) [m] in the camera's frame, clockwise."""
    pixels = corners @ K.T
    pixels = 2 * pixels[:, :2] / pixels[:, 2:] + 0.5
    rows, columns = texture.shape
    edge = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]]) - 0.5
    H = cv2.getPerspectiveTransform(edge.astype(np.float32), pixels.astype(np.float32))
    low = np.clip(np.floor(pixels.min(axis=0)).astype(int) - 1, 0, [2 * WIDTH, 2 * HEIGHT])
    high = np.clip(np.ceil(pixels.max(axis=0)).astype(int) + 2, 0, [2 * WIDTH, 2 * HEIGHT])
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    if min(size) <= 0:
        return
    H = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1.0]]) @ H
    part = large[low[1] : high[1], low[0] : high[0]]
    mask = np.zeros(part.shape, np.uint8)
    cv2.fillConvexPoly(mask, np.rint((pixels - low) * 16).astype(np.int32), 255, shift=4)
    drawn = cv2.warpPerspective(texture, H, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE)
    np.copyto(part, drawn, where=mask > 0)


def box_sides(spec: dict, random: np.random.Generator) -> list[Side]:
    """Sides of the box in an object file, of printed cardboard, and after them its tags on white cards."""
    half = np.array(spec["shape"]["box"]["size_m"]) / 2
    sides = []
    for axis in range(3):
        for sign in (-1, 1):
            right, up = np.eye(3)[[(axis + 1) % 3, (axis + 2) % 3]]
            right, out = sign * right, sign * np.eye(3)[axis]
            pixels = [round(2 * float(abs(each) @ half) * TEXTURE_PX_PER_M) for each in (up, right)]
            face = np.full(pixels, 140 + 8 * len(sides), np.uint8)
            for _ in range(7):
                x, y = int(random.integers(0, pixels[1])), int(random.integers(0, pixels[0]))
                cv2.rectangle(face, (x, y), (x + 60, y + 18), int(random.integers(90, 200)), -1)
            sides.append((_corners(out * half, right * half, up * half), face))
    return sides + [_tag(marker, random) for marker in spec["marker"]]


def _tag(marker: dict, random: np.random.Generator) -> Side:
    """Tag on its white card, glued on by hand about where the object file states it."""
    T = np.array(marker["T_object_marker"])
    turn = cv2.Rodrigues(random.normal(0, GLUE_RAD) * T[:3, 2])[0]
    right, up = turn @ T[:3, 0], turn @ T[:3, 1]
    middle = T[:3, 3] + right * random.normal(0, GLUE_M) + up * random.normal(0, GLUE_M)
    cells = round(marker["size_m"] * TEXTURE_PX_PER_M)
    rim = round(0.15 * cells)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    tag = cv2.aruco.generateImageMarker(dictionary, marker["id"], cells)
    card = np.pad(np.where(tag > 127, WHITE, BLACK).astype(np.uint8), rim, constant_values=WHITE)
    reach = marker["size_m"] / 2 * len(card) / cells
    return _corners(middle, reach * right, reach * up), card


def _corners(middle: np.ndarray, right: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Corners (4, 3) of a rectangle, clockwise from the upper left, from its middle and half sides."""
    return np.array([middle - right + up, middle + right + up, middle + right - up, middle - right - up])


def background(random: np.random.Generator) -> Image:
    """Image of table and wall, drawn at twice the size of the phone's images."""
    R, eye = camera()
    large = np.full((2 * HEIGHT, 2 * WIDTH), 118, np.uint8)

    def grain(rows: int, columns: int, grey: float, spread: float) -> Image:
        coarse = random.normal(grey, spread, (rows // 12, columns // 12)).clip(0, 255).astype(np.uint8)
        return cv2.resize(coarse, (columns, rows), interpolation=cv2.INTER_CUBIC)

    for texture, corners in (
        (grain(480, 960, 105, 10), [[-0.6, 0.45, 0.5], [0.6, 0.45, 0.5], [0.6, 0.45, 0], [-0.6, 0.45, 0]]),
        (grain(720, 960, 140, 14), [[-0.6, 0.45, 0], [0.6, 0.45, 0], [0.6, -0.2, 0], [-0.6, -0.2, 0]]),
    ):
        draw(large, texture, (np.array(corners) - eye) @ R.T)
    return large


def strike_images(
    sides: list[Side],
    strike: dict,
    random: np.random.Generator,
    turned_rad: float = 0.0,
    rate_hz: int = CAPTURE_HZ,
) -> Iterator[Image]:
    """Images of one strike: the box put down by hand, flicked by a finger, tipping.

    Args:
        sides: sides and tags of the box.
        strike: strike of a plan file.
        random: draws the hand's errors and the noise.
        turned_rad: angle about the vertical by which the box is put down otherwise than planned [rad].
        rate_hz: images per second.
    """
    R, eye = camera()
    hand = cv2.Rodrigues(
        np.array([0.0, 0.0, strike["heading_rad"] + turned_rad + random.normal(0, HAND_RAD)])
    )[0]
    shift = np.array([*random.normal(0, HAND_M, 2), 0.0])
    R_wo, p_wo = np.array(strike["R_world_object"]), np.array(strike["p_world_object"])
    radius = strike["pivot"]["radius_m"]
    centre = np.array([0.0, 0.0, radius])
    scenery = background(np.random.default_rng(3))
    for theta in tipping(strike, rate_hz):
        c, s = math.cos(theta), math.sin(theta)
        turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        large = scenery.copy()
        for corners, texture in sides:
            world = (corners @ R_wo.T + p_wo - centre) @ turn.T + centre + [radius * theta, 0, 0]
            seen = (world @ hand.T + shift - eye) @ R.T
            normal = np.cross(seen[1] - seen[0], seen[3] - seen[0])
            if normal @ seen.mean(axis=0) > 0:
                draw(large, texture, seen)
        yield filmed(large, random)


def _printed_board() -> Side:
    """Calibration board, in a frame with its lower left square's corner as origin, x right, y up [m]."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    board = cv2.aruco.CharucoBoard(BOARD_SQUARES, SQUARE_M, MARKER_M, dictionary)
    print_ = board.generateImage((48 * BOARD_SQUARES[0], 48 * BOARD_SQUARES[1]))
    texture = np.pad(np.where(print_ > 127, WHITE, BLACK).astype(np.uint8), 24, constant_values=WHITE)
    half = np.array([*BOARD_SQUARES, 0]) * SQUARE_M / 2
    right, up = np.diag(half + SQUARE_M / 2)[:2]
    return _corners(half, right, up), texture


def board_images(random: np.random.Generator) -> Iterator[Image]:
    """Images of a calibration board that is held still in many poses."""
    corners, texture = _printed_board()
    flat = (corners - corners.mean(axis=0)) * [1, -1, -1]
    for view in range(VIEWS):
        tilt = math.radians(18 + 22 * random.random())
        about = 2.4 * view
        turn = cv2.Rodrigues(tilt * np.array([math.cos(about), math.sin(about), 0.0]))[0]
        turn = turn @ cv2.Rodrigues(np.array([0.0, 0.0, math.pi / 2 * (view % 2) + random.normal(0, 0.1)]))[0]
        far = 0.26 + 0.1 * random.random()
        aside = np.array([0.26 * math.cos(1.7 * view), 0.17 * math.sin(2.9 * view), 1.0]) * far
        large = np.full((2 * HEIGHT, 2 * WIDTH), 118, np.uint8)
        draw(large, texture, flat @ turn.T + aside)
        still = filmed(large, random)
        for _ in range(HELD):
            yield still


def table_images(random: np.random.Generator) -> Iterator[Image]:
    """Images of the board that stands upright on the table, in the world's plane y = 0, facing the phone.

    Its paper stands on the table; its mark (a corner of a square) is half a square above the world's origin:
    `--upright --mark-mm 0,0,11`.
    """
    corners, texture = _printed_board()
    R, eye = camera()
    standing = corners[:, [0, 2, 1]] * [1, -1, 1] + [0.0, 0.0, SQUARE_M / 2]
    slip = cv2.Rodrigues(np.array([0.0, 0.0, random.normal(0, BOARD_RAD)]))[0]
    large = background(np.random.default_rng(3))
    draw(large, texture, (standing @ slip.T + random.normal(0, BOARD_M, 3) * [1, 1, 0] - eye) @ R.T)
    for _ in range(HELD):
        yield filmed(large, random)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
