"""HTML file with one card per strike and toss, each a page when printed; it loads nothing from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from analyze.cards import placing
from analyze.cards.body import PlacedObject
from analyze.cards.by_hand import force_margin, force_words, in_hand_words, picture_in_hand_words
from analyze.cards.drawn_shape import drawn_shape
from analyze.cards.edge_picture import edge_picture
from analyze.cards.measures import plan_picture, side_picture
from analyze.cards.placing import Sides
from analyze.cards.scene import scene_picture
from analyze.cards.setting import Setting, strike_setting
from analyze.cards.toss_card import toss_cards
from analyze.geometry.object_model import ObjectModel
from analyze.planning.footing import IF_IT_FALLS
from schemas.edge_names import edge_names
from schemas.object_spec import ObjectSpec
from schemas.output_file import write_text
from schemas.plain_text import shown_value
from schemas.strike_plan import PlannedStrike, StrikePlan
from schemas.wording import counted

MIN_OFFSET_M = 0.0005
"""Offset [m] of the impact from the mark on the pivot line above which a card states it; plans of `analyze
plan` strike at the mark."""


@dataclass(frozen=True)
class Card:
    """Contents of one placement card: instructions and pictures for setting up one strike."""

    number: int
    """Number of the card, from 1."""
    strike: PlannedStrike
    """Strike as planned."""
    place: Setting
    """Positions of what the pictures show."""
    sides: Sides
    """Names of the object's sides."""
    change: str
    """Instruction for the change from the previous card's placement; empty on the first card and if it is the
    same."""
    repeated: bool
    """True if the placement is that of the previous card."""
    scene: Markup
    """Large picture (an <svg> element) of the object, line, striker and camera."""
    side: Markup
    """Dimensioned picture as seen by the camera, or from opposite it for a turned strike."""
    above: Markup
    """Dimensioned picture as seen from above."""
    by_hand: bool
    """True for a hand and a phone in place of striker and camera: pictures and sentences name these."""
    edge_name: str
    """Name of the pivot edge that a person can point at."""
    edge: Markup
    """Small drawing of the object with the pivot edge marked, as an <svg> element."""

    @property
    def turned(self) -> bool:
        """True if object and striker are turned by 180° on the table, to measure the table's tilt."""
        return self.place.turned

    def _along(self, near: bool) -> str:
        """Direction along the pivot line in words: "towards the camera" or "away from the camera".

        With `near` True it is the direction towards the eye of the pictures, else the opposite one. The eye
        is on the camera's side; for a turned strike (object turned by 180° on the table) it is opposite the
        camera.
        """
        return "towards the camera" if near != self.turned else "away from the camera"

    @property
    def put_down(self) -> str:
        """Sentence with the sides of the object that face the camera and the table, and any tag on top."""
        camera = self.sides.behind if self.turned else self.sides.camera
        facing = f"{_capitalised(camera)} faces the camera, {self.sides.under} is underneath"
        if self.sides.top.startswith("tag"):
            facing += f", {self.sides.top} on top"
        return self._worded(f"{facing}.")

    @property
    def set_striker(self) -> str:
        """Sentence for the position of the striker's tip: its height, and where it touches the object.

        A tag on the side that it touches is named if there is one. The distance from the mark (the point y =
        0 of the pivot line in the world frame) is stated if it is more than `MIN_OFFSET_M`.
        """
        height = 1000 * self.strike.aim.impact_height_m
        words = (
            f"Flick it {height:.0f} mm above the table"
            if self.by_hand
            else f"Set the striker's tip {height:.0f} mm above the table, just touching the object"
        )
        if self.sides.striker.startswith("tag"):
            words += f" on the side of {self.sides.striker}"
        beside = float(self.place.hit[1])
        if abs(beside) > MIN_OFFSET_M:
            words += f", {1000 * abs(beside):.0f} mm from the mark {self._along(near=beside < 0)}"
        return self._worded(f"{words}{self._hand_off if self.by_hand else ''}.")

    @property
    def _hand_off(self) -> str:
        """End of the sentence for a hand: where it goes, and that it must not follow the object."""
        return ", straight towards the line, and take the finger back at once: do not push"

    def _worded(self, sentence: str) -> str:
        """Sentence in the words for a hand and a phone if the card is for these, else unchanged."""
        return in_hand_words(sentence) if self.by_hand else sentence

    @property
    def on_line(self) -> str:
        """Sentence for the position of the pivot edge on the line drawn on the table.

        It has the distance of the edge's near end from the mark, the point y = 0 of the line. Near is towards
        the eye of the pictures, which is on the camera's side, or opposite it for a turned strike. For a rim,
        or if no edge was found, it has the point of contact, and the distance of the object's front.
        """
        front = f"{1000 * self.place.front_to_mark:.0f} mm from the mark {self._along(near=True)}"
        if self.place.edge is None:
            name = "rim" if self.place.rolls else "edge"
            touches = f"The {name} touches the line at the mark, on the striker's side"
            return self._worded(f"{touches}; the object's front is {front}.")
        return self._worded(
            f"The edge under {self.sides.away} lies on the line, the object on the striker's side; "
            f"the edge begins {front}."
        )

    @property
    def how_hard(self) -> tuple[str, str, str]:
        """Force of a strike by hand: an adverb, a familiar motion, and what shows that it was right."""
        return *force_words(self.strike), force_margin(self.strike)

    @property
    def phone_distance_m(self) -> float:
        """Distance [m] of the phone's lens from the mark, the point y = 0 of the pivot line, along it."""
        return abs(float(self.place.camera[1]))

    @property
    def phone_height_m(self) -> float:
        """Height [m] of the phone's lens above the table."""
        return float(self.place.camera[2])


def write_cards(
    plan: StrikePlan, model: ObjectModel, spec: ObjectSpec, output: Path, by_hand: bool = False
) -> None:
    """Write the placement cards of a plan as an HTML file; it appears complete or not at all.

    Args:
        plan: Plan of the strikes.
        model: Shape of the object.
        spec: Object file, with the tags.
        output: Path of the HTML file, which is replaced if it exists.
        by_hand: True for strikes by hand that a phone films.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(output, render_cards(plan, model, spec, by_hand))


def render_cards(plan: StrikePlan, model: ObjectModel, spec: ObjectSpec, by_hand: bool = False) -> str:
    """HTML page, as text, with the placement cards of a plan.

    Args:
        plan: Plan of the strikes.
        model: Shape of the object.
        spec: Object file, with the tags.
        by_hand: True for strikes by hand that a phone films.
    """
    return _template().render(
        plan=plan,
        spec=spec,
        cards=placement_cards(plan, model, spec, by_hand),
        tosses=toss_cards(plan, model, drawn_shape(model), spec, by_hand),
        by_hand=by_hand,
        degrees=np.degrees,
        where_it_falls=IF_IT_FALLS,
    )


@cache
def _template() -> Template:
    environment = Environment(
        loader=PackageLoader("analyze.cards"), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    environment.finalize = shown_value
    environment.globals["counted"] = counted
    return environment.get_template("cards.html")


def placement_cards(
    plan: StrikePlan, model: ObjectModel, spec: ObjectSpec, by_hand: bool = False
) -> list[Card]:
    """Placement cards in the order of the plan's strikes, one for each.

    Pictures of strikes with equal placement and impact are drawn once.

    Args:
        plan: Plan of the strikes.
        model: Shape of the object.
        spec: Object file, with the tags.
        by_hand: True for strikes by hand that a phone films.
    """
    shape = drawn_shape(model)
    names = edge_names(plan.strikes)
    edges: dict[str, Markup] = {}
    drawn: dict[str, tuple[Setting, Markup, Markup, Markup]] = {}
    found: list[Card] = []
    for number, strike in enumerate(plan.strikes, start=1):
        key = strike.model_dump_json(
            include={
                "R_world_object",
                "p_world_object",
                "impact",
                "impact_height_m",
                "visible_markers",
                "rolls",
                "heading_rad",
            }
        )
        if key not in drawn:
            place = strike_setting(
                PlacedObject(shape, spec, np.array(strike.R_world_object), np.array(strike.p_world_object)),
                strike,
            )
            # The SVG is generated here, with its texts escaped.
            draw = (scene_picture, side_picture, plan_picture)
            drawings = [each(place) for each in draw]
            if by_hand:
                drawings = [picture_in_hand_words(each) for each in drawings]
            scene, side, above = (Markup(each) for each in drawings)  # noqa: S704
            drawn[key] = (place, scene, side, above)
        place, scene, side, above = drawn[key]
        name = names[strike.axis_id]
        if strike.axis_id not in edges:
            edges[strike.axis_id] = Markup(edge_picture(shape, spec, strike, name))  # noqa: S704 - as above
        before = found[-1] if found else None
        change = "" if before is None else placing.placement_change(before.place.body.R, place.body.R)
        if place.turned and not (before is not None and before.turned):
            sides_changed = placing.CHANGE_SIDES
            change = f"{change}; then {sides_changed}" if change else _capitalised(sides_changed)
        repeated = before is not None and not change
        change = in_hand_words(change) if by_hand else change
        found.append(
            Card(
                number,
                strike,
                place,
                placing.side_names(spec, place.body.R),
                change,
                repeated,
                scene,
                side,
                above,
                edge_name=name,
                edge=edges[strike.axis_id],
                by_hand=by_hand,
            )
        )
    return found


def _capitalised(words: str) -> str:
    return words[:1].upper() + words[1:]
