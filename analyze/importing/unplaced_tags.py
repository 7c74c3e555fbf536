"""Matches tips in videos with planned strikes where the tags' places on the object are unknown.

A tip shows in a tag's frame M which way is up, and the line about which the object turned. If the planned
strike is known, this is the tag's place on the object: the line is the planned edge, up is up, and the tag
lies on the surface. A tag that is seen in several tips must have one place. So one tip of a group that shares
tags decides the strikes of all others, and each strike tried for it gives one reading of the group. Of the
readings those remain in which the tags lie on the body, every tip is a planned strike, and tags that were
never seen together do not face the same way. The board on the table gives the camera's pose.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from analyze.importing.matching import MAX_UP_ANGLE, Placement
from analyze.importing.tag_place import TaggedBody, tag_place
from analyze.importing.tip_view import TagView
from analyze.types import Array

MAX_SAME_SIDE = math.radians(30.0)
"""largest angle between the normals of two tags on one side of the object [rad]"""
MAX_COMBINATIONS = 20_000
"""most combinations of groups' readings that are tried"""


@dataclass(frozen=True)
class TagTip:
    """Tip as its tags show it; only tags of which a turning line is known."""

    name: str
    """name of the clip's file, with the time in it if it shows several strikes"""
    views: tuple[TagView, ...]
    """views of the tags, the best first"""
    placement: int | None = None
    """index of the placement that the tip is known to show; None if it is unknown"""

    @property
    def tags(self) -> frozenset[int | str]:
        """Names of the tags."""
        return frozenset(view.marker for view in self.views)


@dataclass(frozen=True)
class Reading:
    """One way to read a group of tips: the placement of each, and the tags' places that follow."""

    placements: Mapping[int, int | None]
    """placement's index by tip's index; None for a tip that fits no placement"""
    places: Mapping[int | str, Array]
    """(4, 4) T_object_marker by tag [m]"""

    @property
    def unexplained(self) -> frozenset[int]:
        """Indices of the tips that fit no placement."""
        return frozenset(tip for tip, placement in self.placements.items() if placement is None)


@dataclass(frozen=True)
class Group:
    """Tips that share tags, and the ways to read them."""

    tips: tuple[int, ...]
    """indices of the tips"""
    readings: tuple[Reading, ...]
    """readings that leave equally many tips unexplained, mostly none; none if no tag would lie on the body"""

    @property
    def is_whole(self) -> bool:
        """True if the readings explain all tips."""
        return bool(self.readings) and not self.readings[0].unexplained

    def odd_ones(self) -> frozenset[int]:
        """Indices of the tips that do not fit the others: unexplained in all readings, else in any."""
        unexplained = [reading.unexplained for reading in self.readings]
        if not unexplained:
            return frozenset(self.tips)
        return frozenset.intersection(*unexplained) or frozenset.union(*unexplained)


def groups_of(tips: Sequence[TagTip], placements: Sequence[Placement], body: TaggedBody) -> list[Group]:
    """Groups of tips that share tags, with their readings; tips without a view belong to none.

    Args:
        tips: the tips.
        placements: placements of the plan.
        body: the object, its tags and the camera.
    """
    return [
        Group(tuple(members), tuple(_readings_of_group(members, tips, placements, body)))
        for members in _members(tips)
    ]


def tags_together(tips: Sequence[TagTip]) -> set[tuple[int | str, ...]]:
    """Pairs of tags that a tip shows together, which may lie on one side of the object; sorted as text."""
    return {pair for tip in tips for pair in combinations(sorted(tip.tags, key=str), 2)}


def compatible(groups: Sequence[Group], together: set[tuple[int | str, ...]]) -> list[Group]:
    """Groups with those of their readings that agree with a reading of every other group.

    Tags that no tip shows together lie on different sides of the object. Where there are more than
    `MAX_COMBINATIONS` agreeing combinations, all readings are kept.

    Args:
        groups: the groups; those without a reading agree with all others.
        together: pairs of tags that a tip shows together.
    """
    sides = [_by_sides(group, together) for group in groups]
    used: list[set[tuple[float, ...]]] = [set() for _ in groups]
    keys = [list(each) if each else [()] for each in sides]
    for count, chosen in enumerate(_combinations(keys, sides, together)):
        for number, each in enumerate(chosen):
            used[number].add(each)
        if count > MAX_COMBINATIONS:
            return list(groups)
    return [
        Group(group.tips, tuple(reading for each in sorted(kept) for reading in side.get(each, ())))
        for group, side, kept in zip(groups, sides, used, strict=True)
    ]


def _by_sides(group: Group, together: set[tuple[int | str, ...]]) -> dict[tuple[float, ...], list[Reading]]:
    """Readings of a group by the sides (rounded normals) on which its tags lie, if those are compatible."""
    found: dict[tuple[float, ...], list[Reading]] = {}
    for reading in group.readings:
        if _on_different_sides(reading.places, reading.places, together):
            normals = [
                np.round(reading.places[tag][:3, 2], 1) + 0.0 for tag in sorted(reading.places, key=str)
            ]
            found.setdefault(tuple(np.ravel(normals).tolist()), []).append(reading)
    return found


def _combinations(
    keys: Sequence[Sequence[tuple[float, ...]]],
    sides: Sequence[Mapping[tuple[float, ...], Sequence[Reading]]],
    together: set[tuple[int | str, ...]],
    chosen: tuple[tuple[float, ...], ...] = (),
) -> Iterator[tuple[tuple[float, ...], ...]]:
    """Yield one key per group, for all combinations in which the tags lie on different sides.

    Args:
        keys: sides on which each group's tags may lie.
        sides: readings of each group by these sides; none for a group without readings.
        together: pairs of tags that a tip shows together.
        chosen: keys of the first groups.
    """
    if len(chosen) == len(keys):
        yield chosen
        return
    before = [sides[number][key][0].places for number, key in enumerate(chosen) if sides[number]]
    mine = sides[len(chosen)]
    for key in keys[len(chosen)]:
        if not mine or all(_on_different_sides(other, mine[key][0].places, together) for other in before):
            yield from _combinations(keys, sides, together, (*chosen, key))


def _on_different_sides(
    one: Mapping[int | str, Array], two: Mapping[int | str, Array], together: set[tuple[int | str, ...]]
) -> bool:
    """True if no tag of one reading faces the way of a tag of the other, unless they are seen together.

    Args:
        one: places of tags in a reading.
        two: places of tags in the same reading or in another one.
        together: pairs of tags that are seen together, sorted by their names as text.
    """
    return all(
        a == b
        or tuple(sorted((a, b), key=str)) in together
        or float(one[a][:3, 2] @ two[b][:3, 2]) < math.cos(MAX_SAME_SIDE)
        for a in one
        for b in two
    )


def _members(tips: Sequence[TagTip]) -> list[list[int]]:
    """Indices of the tips in each group; tips that share a tag belong to one group."""
    groups: list[tuple[set[int | str], list[int]]] = []
    for number, tip in enumerate(tips):
        if not tip.views:
            continue
        tags, members = set(tip.tags), [number]
        apart: list[tuple[set[int | str], list[int]]] = []
        for group in groups:
            if group[0] & tags:
                tags, members = tags | group[0], group[1] + members
            else:
                apart.append(group)
        groups = [*apart, (tags, sorted(members))]
    return [members for _, members in sorted(groups, key=lambda group: group[1][0])]


def _readings_of_group(
    group: Sequence[int], tips: Sequence[TagTip], placements: Sequence[Placement], body: TaggedBody
) -> list[Reading]:
    """Readings of one group that leave the fewest tips unexplained; each assignment once.

    Every tip is tried as the first one until all tips are explained, as the first one may be an odd one.

    Args:
        group: indices of the group's tips.
        tips: all tips.
        placements: placements of the plan.
        body: the object, its tags and the camera.
    """
    found: dict[tuple[int | None, ...], Reading] = {}
    for first in group:
        known = tips[first].placement
        for number in range(len(placements)) if known is None else (known,):
            start = Reading({first: number}, {})
            for reading in _extended(start, group, tips, placements, body):
                found.setdefault(tuple(reading.placements[tip] for tip in group), reading)
        if any(not reading.unexplained for reading in found.values()):
            break
    least = min((len(reading.unexplained) for reading in found.values()), default=0)
    return [reading for reading in found.values() if len(reading.unexplained) == least]


def _extended(
    reading: Reading,
    group: Sequence[int],
    tips: Sequence[TagTip],
    placements: Sequence[Placement],
    body: TaggedBody,
) -> Iterator[Reading]:
    """Yield the readings of a whole group that follow from a reading of some of its tips.

    Args:
        reading: placements of some of the group's tips.
        group: indices of the group's tips.
        tips: all tips.
        placements: placements of the plan.
        body: the object, its tags and the camera.
    """
    places = _places(reading.placements, tips, placements, body)
    if places is None:
        return
    following = next(
        (tip for tip in group if tip not in reading.placements and not tips[tip].tags.isdisjoint(places)),
        None,
    )
    if following is None:
        # A tip whose only tags are those of unexplained tips is itself unexplained.
        rest = dict.fromkeys((tip for tip in group if tip not in reading.placements), None)
        yield Reading({**reading.placements, **rest}, places)
        return
    tip, was_extended = tips[following], False
    for number in range(len(placements)) if tip.placement is None else (tip.placement,):
        if all(
            _explains(placements[number], view, places[view.marker], body)
            for view in tip.views
            if view.marker in places
        ):
            more = Reading({**reading.placements, following: number}, places)
            for each in _extended(more, group, tips, placements, body):
                was_extended = True
                yield each
    if not was_extended:
        more = Reading({**reading.placements, following: None}, places)
        yield from _extended(more, group, tips, placements, body)


def _explains(placement: Placement, view: TagView, T_object_marker: Array, body: TaggedBody) -> bool:
    """True if a tag at a known place shows this placement in a tip.

    Args:
        placement: the placement.
        view: the tag's view, with a turning line.
        T_object_marker: (4, 4) pose of the tag on the object [m].
        body: the object, its tags and the camera.
    """
    seen = view.on_object(T_object_marker)
    up = float(placement.up_in_camera(seen) @ body.T_world_camera[2, :3])
    return up > math.cos(MAX_UP_ANGLE) and placement.mismatch(seen) <= 1.0


def _places(
    assigned: Mapping[int, int | None],
    tips: Sequence[TagTip],
    placements: Sequence[Placement],
    body: TaggedBody,
) -> dict[int | str, Array] | None:
    """T_object_marker (4, 4) [m] of all tags in some tips of assumed placements; None if there is none.

    There is none if a tag would not lie on the body, or the tips contradict each other on its place.

    Args:
        assigned: placement's index by tip's index.
        tips: all tips.
        placements: placements of the plan.
        body: the object, its tags and the camera.
    """
    views: dict[int | str, list[tuple[Placement, TagView]]] = {}
    for tip, number in assigned.items():
        for view in tips[tip].views if number is not None else ():
            views.setdefault(view.marker, []).append((placements[number or 0], view))
    places: dict[int | str, Array] = {}
    for name, seen in views.items():
        place = tag_place(seen, body)
        if place is None:
            return None
        places[name] = place
    return places
