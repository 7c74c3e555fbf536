"""Marks by which a tossed object is followed: its markers, or its print as strikes showed it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from analyze.tracking.printed_view import printed_views

if TYPE_CHECKING:
    from collections.abc import Mapping

    from analyze.geometry.object_model import ObjectModel
    from analyze.tracking.print_likeness import RestView
    from analyze.tracking.printed_view import PrintedView
    from analyze.types import Marker


@dataclass(frozen=True)
class TossMarks:
    """Markers of a tossed object, or views of its print if it has none."""

    markers: list[Marker]
    """markers of the object; those without a place on it are not used"""
    views: tuple[PrintedView, ...] = ()
    """views of its print; used without markers"""


def toss_marks(markers: list[Marker], rest_views: Mapping[str, RestView], model: ObjectModel) -> TossMarks:
    """Marks by which a tossed object is followed: its markers, or its print as usable strikes showed it.

    Args:
        markers: markers of the object.
        rest_views: the object at rest by strike id, before usable strikes of the same recording.
        model: exterior shape.
    """
    if markers:
        return TossMarks(markers)
    return TossMarks([], printed_views(rest_views, model.vertices, model.faces))
