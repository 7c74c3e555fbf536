"""Phone videos of tosses, and of strikes before the same phone, read row by row by a rolling shutter.

The phone, its lens, its noise and the tea box are those of `make_phone_videos`. Every row of an image is
drawn at its own time, as the mean of its exposure, through the lens. A hand holds the box still, swings and
lets go; the box then obeys gravity, Euler's equations and a simple resistance of the air, and ends in a
cushion. Nothing is shared with the virtual rig or with the estimators. The table hides nothing of the swing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from tests import make_phone_videos as phone

LINE_S = 7e-6
"""delay from row to row [s]: 3.2 ms for an image of 450 rows"""
EXPOSURE_S = 1e-3
EYE, LOOK_AT = np.array([0.012, -0.50, 0.17]), np.array([0.018, 0.0, 0.105])
"""places of the phone and of what it looks at [m]: far enough for tosses behind the table"""
THROWN_FROM = np.array([0.02, 0.30, 0.05])
"""place of c where the hand lets go [m]"""
SPINS = ((0.62, 0.55, 0.56), (-0.60, 0.58, 0.55), (0.56, -0.60, 0.57))
"""spin axes in O of three tosses, oblique to the box's axes"""
HOLD_S, SWING_S, SUNK_S, LIES_S = 0.25, 0.08, 0.08, 0.12
"""time for which the hand holds the box and swings it, and for which the box sinks into a cushion and lies"""
FORCE, MOMENT = 0.03, 2e-7
"""resistance of the air: force over mass v^2 [1/m], moment over w^2 [kg m^2]"""
STEP_S = 2.5e-4
FINGER_M, FINGER_GREY = 0.009, 165
Image = np.ndarray


@dataclass(frozen=True)
class Motion:
    """Poses of the object frame O in W at equal steps of `STEP_S`."""

    R: np.ndarray
    """(n, 3, 3) rotations from O to W"""
    p: np.ndarray
    """(n, 3) places of O's origin [m]"""
    fingers: np.ndarray | None = None
    """(n, 2, 3) places of two finger tips in W [m]; None if no hand is in view"""
    flight_s: tuple[float, float] = (0.0, 0.0)
    """times at which the hand lets go and the cushion is touched [s]"""

    @property
    def length_s(self) -> float:
        """Length [s]."""
        return STEP_S * (len(self.R) - 1)

    def at(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (k, 3, 3) and places (k, 3) at times (k,) [s], interpolated."""
        place = np.clip(times / STEP_S, 0, len(self.R) - 1.001)
        first = place.astype(int)
        share = (place - first)[:, None]
        mixed = self.R[first] + share[..., None] * (self.R[first + 1] - self.R[first])
        # A half step of Newton's towards the next rotation.
        mixed = 1.5 * mixed - 0.5 * mixed @ np.swapaxes(mixed, 1, 2) @ mixed
        return mixed, self.p[first] + share * (self.p[first + 1] - self.p[first])

    def part(self, start_s: float, end_s: float) -> Motion:
        """Motion between two times [s]."""
        some = slice(round(start_s / STEP_S), round(end_s / STEP_S))
        fingers = None if self.fingers is None else self.fingers[some]
        flight = self.flight_s[0] - start_s, self.flight_s[1] - start_s
        return Motion(self.R[some], self.p[some], fingers, flight)


# --- motions


def struck(strike: dict, random: np.random.Generator) -> Motion:
    """Motion of the box in a strike of a plan file, put down and flicked by hand."""
    hand = _turn(np.array([0, 0, strike["heading_rad"] + random.normal(0, phone.HAND_RAD)]))
    shift = np.array([*random.normal(0, phone.HAND_M, 2), 0.0])
    radius = strike["pivot"]["radius_m"]
    centre = np.array([0.0, 0.0, radius])
    R_wo, p_wo = np.array(strike["R_world_object"]), np.array(strike["p_world_object"])
    turns, places = [], []
    for theta in phone.tipping(strike, round(1 / STEP_S)):
        turn = hand @ _turn(np.array([0.0, theta, 0.0]))
        turns.append(turn @ R_wo)
        places.append(turn @ (p_wo - centre) + hand @ (centre + np.array([radius * theta, 0, 0])) + shift)
    return Motion(np.array(turns), np.array(places))


def tossed(
    spin_axis: Sequence[float],
    random: np.random.Generator,
    turns_per_s: float = 2.6,
    air_s: float = 0.36,
    carried_s: tuple[float, float] = (0.0, 0.0),
) -> Motion:
    """Motion of the box in a toss by hand.

    Args:
        spin_axis: axis of the spin in O.
        random: draws a person's scatter: 15 % of the spin, 6 degrees of the axis, 20 mm, 0.1 m/s sideways.
        turns_per_s: spin [turns/s].
        air_s: time in the air [s].
        carried_s: times for which the hand carries the box about before the toss, and after it [s].
    """
    axis = _turn(random.normal(0, 0.1, 3)) @ np.array(spin_axis) / np.linalg.norm(spin_axis)
    rate = 2 * math.pi * turns_per_s * random.uniform(0.85, 1.15) * axis
    velocity = np.array([*random.normal(0, 0.1, 2), 0.5 * phone.GRAVITY * air_s])
    place = THROWN_FROM + random.uniform(-0.02, 0.02, 3)
    attitude = _turn(random.normal(0, 3, 3))
    # The hand's swing backwards in time from the release: rate and velocity go to zero smoothly.
    turned, moved = attitude.copy(), place.copy()
    swing = [(turned, moved)]
    for share in np.arange(1, 0, -STEP_S / SWING_S):
        speed = math.sin(0.5 * math.pi * share) ** 2
        turned, moved = turned @ _turn(-STEP_S * speed * rate), moved - STEP_S * speed * velocity
        swing.append((turned, moved))
    still = [swing[-1]] * round(HOLD_S / STEP_S)
    flight = _flight(attitude, rate, place, velocity, air_s)
    before = _carried(*swing[-1], carried_s[0])[::-1]
    after = _carried(*flight[-1], carried_s[1])
    path = [*before, *still, *swing[:0:-1], *flight, *after]
    R, c = np.array([each[0] for each in path]), np.array([each[1] for each in path])
    released = len(before) + len(still) + len(swing) - 1
    times = STEP_S * released, STEP_S * released + air_s
    return Motion(R, c - R @ phone.COM, _fingers(R, c, axis, released, len(path) - len(after)), times)


def _flight(R: np.ndarray, w: np.ndarray, c: np.ndarray, v: np.ndarray, air_s: float) -> list:
    """Attitudes and places of c from the release until the box lies in the cushion."""
    weight, about = np.array([0.0, 0.0, -phone.GRAVITY]), np.linalg.inv(phone.INERTIA)

    def change(w: np.ndarray) -> np.ndarray:
        drag = MOMENT * np.linalg.norm(w) * w
        return about @ (-np.cross(w, phone.INERTIA @ w) - drag)

    path = []
    for step in range(round((air_s + SUNK_S + LIES_S) / STEP_S)):
        path.append((R, c))
        if step * STEP_S < air_s:
            middle = w + 0.5 * STEP_S * change(w)
            a = weight - FORCE * np.linalg.norm(v) * v
            R, w = R @ _turn(STEP_S * middle), w + STEP_S * change(middle)
            c, v = c + STEP_S * v + 0.5 * STEP_S**2 * a, v + STEP_S * a
        else:
            slowed = math.exp(-STEP_S / 0.02)
            w, v = w * slowed, v * slowed
            R, c = R @ _turn(STEP_S * w), c + STEP_S * v
    return path


def _carried(R: np.ndarray, c: np.ndarray, length_s: float) -> list:
    """Attitudes and places of a box that is carried about by hand from a pose on."""
    path = []
    for time in np.arange(0, length_s, STEP_S):
        grown = min(1.0, time / 0.3) ** 2
        turn = grown * np.array([0.9 * math.sin(5 * time), 1.3 * math.sin(3.3 * time), math.sin(4 * time)])
        waves = math.sin(4 * time), math.sin(6 * time), math.sin(7 * time)
        shift = grown * np.array([0.09, 0.03, 0.04]) * waves
        path.append((_turn(turn) @ R, c + shift))
    return path


def _fingers(R: np.ndarray, c: np.ndarray, axis: np.ndarray, released: int, taken: int) -> np.ndarray:
    """Two finger tips at the ends of the spin axis, which stay behind from the release on and come back."""
    arms = np.array([axis, -axis]) * 0.06
    held = c[:, None] + np.einsum("nij,fj->nfi", R, arms)
    gone = STEP_S * np.arange(taken - released)[:, None, None]
    outward = np.einsum("ij,fj->fi", R[released], arms) / 0.06
    held[released:taken] = held[released] + np.minimum(1.2 * gone, 0.4) * outward
    return held


def _turn(vector: np.ndarray) -> np.ndarray:
    return cv2.Rodrigues(np.asarray(vector, dtype=np.float64))[0]


# --- pictures


@dataclass(frozen=True)
class Film:
    """Phone at its place, whose images are read row by row."""

    sides: list[phone.Side]
    """sides of the box, and after them its tags"""
    line_s: float = LINE_S
    """delay from row to row [s]"""
    exposure_s: float = EXPOSURE_S
    """exposure of each row [s]"""

    @cached_property
    def place(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotation (3, 3) from W to the camera, and place of the phone in W [m]."""
        forward = (LOOK_AT - EYE) / np.linalg.norm(LOOK_AT - EYE)
        right = np.cross(forward, [0.02, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return np.array([right, np.cross(forward, right), forward]), EYE

    @cached_property
    def ideal(self) -> np.ndarray:
        """Undistorted pixels (900, 1600, 2) of the pixels of an image of twice the size."""
        x, y = (np.arange(2 * size) / 2 - 0.25 for size in (phone.WIDTH, phone.HEIGHT))
        grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 1, 2)
        lens = np.array([phone.K1, 0, 0, 0, 0])
        ideal = cv2.undistortPoints(grid, phone.K, lens, P=phone.K)
        return ideal.reshape(2 * phone.HEIGHT, 2 * phone.WIDTH, 2).astype(np.float32)

    @cached_property
    def scenery(self) -> Image:
        """Image of table and wall, at twice the size, through the lens."""
        large = phone.background(np.random.default_rng(3))
        return cv2.remap(large, 2 * self.ideal + 0.5, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)

    def images(
        self, motion: Motion, random: np.random.Generator, rate_hz: float = phone.CAPTURE_HZ
    ) -> Iterator[Image]:
        """Images of a motion, the middle row of the first one at a random part of the first frame.

        Args:
            motion: the motion, to its end.
            random: draws phase and noise.
            rate_hz: images per second.
        """
        margin = 0.5 * (abs(self.line_s) * phone.HEIGHT + self.exposure_s)
        times = np.arange(margin + random.uniform(0, 1 / rate_hz), motion.length_s - margin, 1 / rate_hz)
        clean, rested = self.scenery.astype(np.float32), False
        for time in times:
            seen = motion.at(time + np.array([-margin, 0.0, margin]))
            rests = np.ptp(seen[0], axis=0).max() + np.ptp(seen[1], axis=0).max() < 1e-9
            if not (rests and rested):
                clean = self._exposed(motion, time)
            rested = rests
            noise = random.standard_normal(clean.shape, np.float32) * phone.NOISE
            yield np.clip(clean + noise, 0, 255).astype(np.uint8)

    def _exposed(self, motion: Motion, time: float) -> Image:
        """Image without noise, its middle row at a time [s] in the middle of the exposure."""
        rows = time + self.line_s * (np.arange(2 * phone.HEIGHT) / 2 - 0.25 - 0.5 * (phone.HEIGHT - 1))
        ends = self._corners(motion, time + 0.5 * self.exposure_s * np.array([-1, 1]))
        moved = float(np.abs(np.diff(ends, axis=0)).max())
        count = max(1, math.ceil(2 * moved))
        total = np.zeros(self.scenery.shape, np.float32)
        for part in (np.arange(count) + 0.5) / count - 0.5:
            total += self._drawn(motion, rows + part * self.exposure_s)
        soft = cv2.GaussianBlur(total / count, (0, 0), 1.0)
        return cv2.resize(soft, (phone.WIDTH, phone.HEIGHT), interpolation=cv2.INTER_AREA)

    def _corners(self, motion: Motion, times: np.ndarray) -> np.ndarray:
        """Undistorted pixels (k, s, 4, 2) of the corners of all sides at times (k,) [s]."""
        R, p = motion.at(times)
        sides = np.array([corners for corners, _ in self.sides])
        world = np.einsum("kij,scj->ksci", R, sides) + p[:, None, None]
        seen = (world - self.place[1]) @ self.place[0].T
        pixels = seen @ phone.K.T
        return pixels[..., :2] / pixels[..., 2:]

    def _drawn(self, motion: Motion, row_times: np.ndarray) -> Image:
        """Image at twice the size, each row of it at its time (900,) [s]."""
        large = self.scenery.copy()
        R, p = motion.at(row_times)
        R_c, eye = self.place
        R, p = R_c @ R, (p - eye) @ R_c.T
        middle = len(row_times) // 2
        for front in (False, True):
            self._draw_fingers(large, motion, row_times[middle], p[middle], front=front)
            if front:
                break
            for corners, texture in self.sides:
                seen = corners @ R[middle].T + p[middle]
                if np.cross(seen[1] - seen[0], seen[3] - seen[0]) @ seen.mean(axis=0) > 0:
                    self._draw(large, texture, corners, R, p)
        return large

    def _draw(self, large: Image, texture: Image, corners: np.ndarray, R: np.ndarray, p: np.ndarray) -> None:
        """Draw a side, with a pose (900, 3, 3), (900, 3) in the camera's frame for each row."""
        seen = np.einsum("rij,cj->rci", R[::30], corners) + p[::30, None]
        pixels = seen @ phone.K.T
        pixels = (2 * pixels[..., :2] / pixels[..., 2:]).reshape(-1, 2)
        limits = [2 * phone.WIDTH, 2 * phone.HEIGHT]
        left, top = np.clip(pixels.min(axis=0).astype(int) - 16, 0, limits)
        right, bottom = np.clip(pixels.max(axis=0).astype(int) + 16, 0, limits)
        if right <= left or bottom <= top:
            return
        rows, columns = texture.shape
        across, down = (corners[1] - corners[0]) / columns, (corners[3] - corners[0]) / rows
        R, p = R[top:bottom], p[top:bottom]
        plane = np.stack([R @ across, R @ down, R @ corners[0] + p], axis=-1)
        m = np.linalg.inv(phone.K @ plane)[:, None].astype(np.float32)
        x, y = self.ideal[top:bottom, left:right, 0], self.ideal[top:bottom, left:right, 1]
        w = m[..., 2, 0] * x + m[..., 2, 1] * y + m[..., 2, 2]
        w[w == 0] = 1e-9
        u = (m[..., 0, 0] * x + m[..., 0, 1] * y + m[..., 0, 2]) / w
        v = (m[..., 1, 0] * x + m[..., 1, 1] * y + m[..., 1, 2]) / w
        drawn = cv2.remap(texture, u - 0.5, v - 0.5, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
        np.copyto(large[top:bottom, left:right], drawn, where=inside)

    def _draw_fingers(self, large: Image, motion: Motion, time: float, p: np.ndarray, *, front: bool) -> None:
        """Draw the finger tips that are nearer than the body's origin `p` (3,), or those that are not."""
        if motion.fingers is None:
            return
        R, eye = self.place
        for tip in motion.fingers[min(round(time / STEP_S), len(motion.fingers) - 1)]:
            seen = R @ (tip - eye)
            if bool(seen[2] < p[2]) is front:
                pixel = phone.K @ seen
                centre = np.rint(32 * pixel[:2] / pixel[2]).astype(int)
                radius = round(32 * phone.FOCAL * FINGER_M / seen[2])
                cv2.circle(large, tuple(centre.tolist()), radius, FINGER_GREY, -1, cv2.LINE_AA, shift=4)
