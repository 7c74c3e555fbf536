"""Words of placement cards for a hand and a phone, in place of a striker and a rig's camera."""

from __future__ import annotations

import re

from schemas.strike_plan import PlannedStrike

FORCES = (
    (0.008, "very gently", "a touch with one fingertip"),
    (0.03, "gently", "a light flick of a finger"),
    (0.1, "firmly", "a flick of the middle finger off the thumb"),
    (0.4, "hard", "a short knock with a knuckle, as on a door"),
    (float("inf"), "very hard", "a short thump with the side of the fist"),
)
"""largest impulse [N s] up to which words apply, how hard in a word, and a motion that gives about as much"""


def force_words(strike: PlannedStrike) -> tuple[str, str]:
    """Words for how hard to strike by hand: an adverb, and a familiar motion of the same impulse.

    Args:
        strike: strike as planned; the impulse [N s] that it aims at counts.
    """
    return next((word, motion) for most, word, motion in FORCES if strike.aim.impulse_n_s.target <= most)


def force_margin(strike: PlannedStrike) -> str:
    """Clause on how exactly the force of a strike by hand must be met, and what shows that it was right."""
    ratio = strike.aim.impulse_n_s.max / max(strike.aim.impulse_n_s.min, 1e-9)
    many = f"up to {ratio:.1f} times that force works" if ratio > 1.15 else "little more is too much"
    return f"right if it slows down, then falls; if it rocks back, a little harder; {many}"


def in_hand_words(text: str) -> str:
    """Sentence of a card with "hand" for the striker and "phone" for the camera."""
    return text.replace("striker", "hand").replace("camera", "phone")


def picture_in_hand_words(svg: str) -> str:
    """SVG picture of a card, with "hand" and "phone" in its visible texts."""
    return re.sub(r">([^<>]+)<", lambda found: f">{in_hand_words(found[1])}<", svg)
