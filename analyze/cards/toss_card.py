"""Card of one toss: how to hold the object, which way to spin it, where and how high to throw it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from analyze.cards.by_hand import in_hand_words, picture_in_hand_words
from analyze.cards.drawn_shape import DrawnShape
from analyze.cards.toss_picture import hold_picture, side_picture
from analyze.geometry.object_model import ObjectModel
from analyze.planning.followed_squares import FollowedSquare, side_squares, tag_squares
from analyze.planning.hypothesis import hypothesis
from analyze.types import Array
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedToss, StrikePlan

G_M_S2 = 9.81
"""gravity of plans without a hypothesis [m/s^2]"""


@dataclass(frozen=True)
class TossCard:
    """Contents of the card of one toss."""

    number: int
    """number of the card among those of the tosses, from 1"""
    toss: PlannedToss
    rise_m: float
    """rise of the centre of mass [m]"""
    facing: str
    """name of the tag or side that faces the camera"""
    hold: Markup
    """large picture of the object in the hands, as an <svg> element"""
    side: Markup
    """picture of camera, flight and cushion from the side"""
    by_hand: bool
    """true for a phone in place of the camera"""

    @property
    def release_mm(self) -> float:
        """Height of the object's middle at the release above the table [mm], negative below."""
        return 1000 * (self.toss.p_world_apex[2] - self.rise_m)

    @property
    def steps(self) -> tuple[str, ...]:
        """Sentences that state what to do, in order."""
        height = (
            f"{abs(self.release_mm):.0f} mm {'above' if self.release_mm >= 0 else 'below'} the table's top"
        )
        behind = f"{1000 * self.toss.p_world_apex[1]:.0f} mm behind the line"
        turns = self.toss.turns_per_s.target * self.toss.flight_s.target
        sentences = (
            f"Lay a cushion {behind}, away from the camera, and stand behind it, facing the camera.",
            f"Hold the object as in the picture, a finger of each hand on each red dot, its middle {height}.",
            "Answer the prompt, and keep it still until the camera records.",
            f"Throw it straight up by {1000 * self.rise_m:.0f} mm, with a spin of about {turns:.1f} turns.",
            "Take your hands away at once, and let it fall on the cushion.",
        )
        return tuple(in_hand_words(each) for each in sentences) if self.by_hand else sentences


def toss_cards(
    plan: StrikePlan, model: ObjectModel, shape: DrawnShape, spec: ObjectSpec, by_hand: bool
) -> list[TossCard]:
    """Cards of a plan's tosses, in their order.

    Args:
        plan: plan of strikes and tosses.
        model: shape of the object.
        shape: its faces and edges to draw.
        spec: object file, with the tags.
        by_hand: True for strikes by hand that a phone films.
    """
    if not plan.tosses:
        return []
    assumed = plan.hypothesis
    com = hypothesis(model).region.centre if assumed is None else np.array(assumed.com_m)
    gravity = G_M_S2 if assumed is None else assumed.g_m_s2
    found: list[TossCard] = []
    squares = tag_squares(spec) or side_squares(model)
    for number, toss in enumerate(plan.tosses, start=1):
        rise, facing = gravity * toss.flight_s.target**2 / 8, _facing(squares, np.array(toss.R_world_object))
        drawings = [
            hold_picture(shape, spec, toss, com, facing),
            side_picture(shape, spec, toss, com, rise),
        ]
        if by_hand:
            drawings = [picture_in_hand_words(each) for each in drawings]
        # The SVG is generated here, with its texts escaped.
        hold, side = (Markup(each) for each in drawings)  # noqa: S704
        found.append(TossCard(number, toss, rise, facing, hold, side, by_hand))
    return found


def _facing(squares: Sequence[FollowedSquare], R_world_object: Array) -> str:
    """Name of the tag or side that faces the camera most."""
    towards = [-(R_world_object @ square.T_object_square[:3, 2])[1] for square in squares]
    return squares[int(np.argmax(towards))].name
