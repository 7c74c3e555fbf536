"""Edges that a user states for strikes without a plan: `--edge s1=+x,bottom` or `--edge s1=p0e1`."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from analyze.errors import ImportRefused
from analyze.planning.possible_tips import PossibleTip
from analyze.planning.rim_tangents import TANGENT_NAME
from schemas.edge_names import signed_axes
from schemas.wording import counted

LEVELS = {"bottom": "-z", "top": "+z"}
"""words for sides of the object, as names of edges have them"""


@dataclass(frozen=True)
class StatedEdge:
    """Edge that the user states for one strike: by its id, or by the sides that meet in it."""

    strike_id: str
    """id of the strike"""
    value: str
    """the edge as the user wrote it"""
    sides: frozenset[str]
    """sides that meet in the edge, such as "+x" and "-z"; empty if the edge is stated by its id"""

    @property
    def text(self) -> str:
        """The statement as the user wrote it: "s1=+x,bottom"."""
        return f"{self.strike_id}={self.value}"

    @property
    def words(self) -> str:
        """The edge in words."""
        return (
            f"the edge {self.value}" if not self.sides else f"an edge of {' and '.join(sorted(self.sides))}"
        )

    def names(self, tip: PossibleTip) -> bool:
        """True if the statement fits the edge of a possible tip."""
        if not self.sides:
            return tip.axis.id == self.value
        return self.sides <= sides_of(tip)


def sides_of(tip: PossibleTip) -> frozenset[str]:
    """Sides of the object that meet in the edge of a tip: those underneath and those ahead, as "+x"."""
    found = [*signed_axes((-tip.axis.plane.up).tolist()), *signed_axes(tip.axis.tip.tolist())]
    return frozenset(name.replace("−", "-") for name in found)


def stated_edges(
    values: Sequence[str], strike_ids: Sequence[str], tips: Sequence[PossibleTip]
) -> list[StatedEdge | None]:
    """Edge that the user states for each strike; None where nothing is stated.

    Args:
        values: values of the option --edge.
        strike_ids: ids of the strikes, in their order.
        tips: all tips that the object can make over straight edges, and over tangents of rims.

    Raises:
        ImportRefused: a value is not of the form ID=EDGE, names no strike or no edge, or a strike twice.
    """
    found: dict[str, StatedEdge] = {}
    for text in values:
        strike_id, _, value = text.partition("=")
        if not value:
            raise ImportRefused(f"--edge {text}: state strike and edge, as s1=+x,bottom or s1=p0e1")
        if strike_id not in strike_ids:
            raise ImportRefused(
                f"--edge {text}: there is no strike {strike_id}, the sources show "
                f"{counted(len(strike_ids), 'strike')}, {strike_ids[0]} to {strike_ids[-1]}"
            )
        if strike_id in found:
            raise ImportRefused(f"--edge {text}: the edge of {strike_id} is stated twice: state it once")
        found[strike_id] = _stated(strike_id, value, tips)
    return [found.get(strike_id) for strike_id in strike_ids]


def _stated(strike_id: str, value: str, tips: Sequence[PossibleTip]) -> StatedEdge:
    """Statement of one edge.

    Raises:
        ImportRefused: the object has no such edge.
    """
    if any(tip.axis.id == value for tip in tips) or TANGENT_NAME.fullmatch(value):
        return StatedEdge(strike_id, value, frozenset())
    words = re.split(r"[,/\s]+", value.lower().replace("−", "-").strip())
    sides = frozenset(LEVELS.get(word, word) for word in words if word not in ("edge", "rim", "side", ""))
    stated = StatedEdge(strike_id, value, sides)
    if sides and any(stated.names(tip) for tip in tips):
        return stated
    ids = ", ".join(tip.axis.id for tip in tips)
    raise ImportRefused(
        f"--edge {strike_id}={value}: the object has no such edge: name the two sides that meet in it (+x, "
        f"-x, +y, -y, top, bottom), as +x,bottom, or one of {ids}"
    )
