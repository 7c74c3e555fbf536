"""One HTML file with a card per strike, a card a page when it is printed; nothing is loaded from elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from analyze.cards import placing
from analyze.cards.body import Placed
from analyze.cards.drawn_shape import drawn_shape
from analyze.cards.measures import plan_picture, side_picture
from analyze.cards.placing import Sides
from analyze.cards.scene import scene_picture
from analyze.cards.setting import Setting, setting
from analyze.geometry.object_model import ObjectModel
from analyze.output_file import write_text
from analyze.planning.footing import WHERE_IT_FALLS
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import PlannedStrike, StrikePlan

BESIDE = 0.0005
"""m beside the mark from which a strike's place is said; plans of ours strike at the mark"""


@dataclass(frozen=True)
class Card:
    """What stands on one card."""

    number: int
    strike: PlannedStrike
    place: Setting
    sides: Sides
    change: str
    """from the card before; empty on the first card and where the object lies as before"""
    repeated: bool
    """the object lies as on the card before"""
    scene: Markup
    side: Markup
    above: Markup

    @property
    def turned(self) -> bool:
        """Object and striker stand on the line's other side."""
        return self.place.turned

    def _along(self, near: bool) -> str:
        """A direction along the line; nearness is to the eye of the pictures, which of a turned strike is opposite the camera."""
        return "towards the camera" if near != self.turned else "away from the camera"

    @property
    def put_down(self) -> str:
        """Which side is under, which faces the camera, and on which side of the line the object stands."""
        camera = self.sides.behind if self.turned else self.sides.camera
        facing = f"{_upper(camera)} faces the camera, {self.sides.under} is underneath"
        if self.sides.top.startswith("tag"):
            facing += f", {self.sides.top} on top"
        return f"{facing}."

    @property
    def set_striker(self) -> str:
        """Where the striker's tip hangs."""
        words = f"The striker's tip {1000 * self.strike.impact_height_m:.0f} mm above the table, just touching the object"
        if self.sides.striker.startswith("tag"):
            words += f" on the side of {self.sides.striker}"
        beside = float(self.place.hit[1])
        if abs(beside) > BESIDE:
            words += f", {1000 * abs(beside):.0f} mm from the mark {self._along(near=beside < 0)}"
        return f"{words}."

    @property
    def on_line(self) -> str:
        """Where the edge lies on the line."""
        front = f"{1000 * self.place.front_to_mark:.0f} mm from the mark {self._along(near=True)}"
        if self.place.edge is None:
            what = "rim" if self.place.rolls else "edge"
            return f"Its {what} touches the line at the mark, from the striker's side; its front is {front}."
        return f"Its edge under {self.sides.away} lies on the line, the object on the striker's side; the edge begins {front}."


def write_cards(plan: StrikePlan, model: ObjectModel, spec: ObjectSpec, output: Path) -> None:
    """Write the cards, whole or not at all.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(output, render_cards(plan, model, spec))


def render_cards(plan: StrikePlan, model: ObjectModel, spec: ObjectSpec) -> str:
    """The cards of a plan for an object as HTML text."""
    return _template().render(plan=plan, spec=spec, cards=cards(plan, model, spec), degrees=np.degrees, where_it_falls=WHERE_IT_FALLS)


@cache
def _template() -> Template:
    environment = Environment(loader=PackageLoader("analyze.cards"), autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    return environment.get_template("cards.html")


def cards(plan: StrikePlan, model: ObjectModel, spec: ObjectSpec) -> list[Card]:
    """One card per strike, in the order of the plan; pictures of equal placements are drawn once."""
    shape = drawn_shape(model)
    drawn: dict[str, tuple[Setting, Markup, Markup, Markup]] = {}
    found: list[Card] = []
    for number, strike in enumerate(plan.strikes, start=1):
        key = strike.model_dump_json(
            include={"R_world_object", "p_world_object", "impact", "impact_height_m", "visible_markers", "rolls", "heading_rad"}
        )
        if key not in drawn:
            place = setting(Placed(shape, spec, np.array(strike.R_world_object), np.array(strike.p_world_object)), strike)
            # Our own SVG; words in it are escaped.
            drawn[key] = (place, Markup(scene_picture(place)), Markup(side_picture(place)), Markup(plan_picture(place)))  # noqa: S704
        place, scene, side, above = drawn[key]
        before = found[-1] if found else None
        change = "" if before is None else placing.change_in_words(before.place.body.R, place.body.R)
        if place.turned and not (before is not None and before.turned):
            sides_changed = placing.CHANGE_SIDES
            change = f"{change}; then {sides_changed}" if change else _upper(sides_changed)
        repeated = before is not None and not change
        found.append(Card(number, strike, place, placing.sides(spec, place.body.R), change, repeated, scene, side, above))
    return found


def _upper(words: str) -> str:
    return words[:1].upper() + words[1:]
