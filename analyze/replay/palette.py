"""Colours of a replay: safe for colour-blind viewers (Okabe & Ito 2008), lightened for dark ground."""

from __future__ import annotations

import colorsys

Colour = tuple[int, int, int]
"""Red, green and blue, 0 to 255."""

BLUE, ORANGE, GREEN, RED, PURPLE, SKY = (
    (86, 160, 230),
    (240, 170, 40),
    (60, 190, 140),
    (230, 100, 40),
    (215, 130, 180),
    (120, 200, 240),
)
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED)
_GOLDEN_TURN = 0.618034
"""share of the circle of hues between successive colours beyond `CYCLE`, which keeps them apart"""
REGIONS = ((250, 240, 165), (150, 135, 205))
"""Pale yellow and violet, which no strike has: dots of the regions above and below the dividing plane."""
BRIGHT = (255, 64, 54)
GREY = (170, 178, 190)
GROUND, INK = (22, 25, 30), (235, 238, 242)
TABLE = (96, 82, 66)
PHASES = {
    "rest": 0x5A6470FF,
    "strike": 0xE6642CFF,
    "stage_one": 0x3D8FDDFF,
    "stage_two": 0x2FA97BFF,
    "landing": 0xC878A8FF,
}
STRIKER = {
    "homed": 0x4A525CFF,
    "armed": 0x5A6470FF,
    "cocked": 0x7A6A3AFF,
    "released": 0xE6642CFF,
    "contact": 0x3D8FDDFF,
    "missed": 0xB03A3AFF,
    "caught": 0x2FA97BFF,
    "verified": 0x2FA97BFF,
    "disarmed": 0x4A525CFF,
    "fault": 0xB03A3AFF,
    "stopped": 0xB03A3AFF,
}
SESSION = {
    "idle": 0x4A525CFF,
    "placing": 0x7A6A3AFF,
    "checking_pose": 0x8A7FD0FF,
    "arming": 0x5A6470FF,
    "striking": 0xE6642CFF,
    "recording": 0x3D8FDDFF,
    "judging": 0xC878A8FF,
    "tossing": 0x56B4E9FF,
    "finished": 0x2FA97BFF,
    "aborted": 0xB03A3AFF,
}


def distinct_colour(number: int) -> Colour:
    """Colour of a strike by its number from 0; no two of the first hundred are the same.

    The first are those of `CYCLE`. From one further number to the next, the hue advances by the golden
    section of the colour circle, and the lightness changes; all are light enough for a dark ground.
    """
    if number < len(CYCLE):
        return CYCLE[number]
    lightness = (0.72, 0.58, 0.82)[number % 3]
    red, green, blue = colorsys.hls_to_rgb((0.05 + _GOLDEN_TURN * number) % 1.0, lightness, 0.65)
    return round(255 * red), round(255 * green), round(255 * blue)
