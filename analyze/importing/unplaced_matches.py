"""Placements of tips whose tags have no known place on the object.

Where the images leave several, the import is refused, and the strikes are listed that are to be named.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from analyze.errors import ImportRefused
from analyze.importing.matching import Match, Placement, TipInView, placements_of
from analyze.importing.tag_place import TaggedBody
from analyze.importing.tip_view import TagView
from analyze.importing.unplaced_tags import Group, Reading, TagTip, compatible, groups_of, tags_together
from analyze.importing.windows import BY_IMAGES, SKIPPED
from schemas.object_spec import ObjectSpec
from schemas.strike_plan import StrikePlan

MAX_NAMED_CHOICES = 4
"""most strikes that are listed as possible for one video"""


def match_unplaced(
    seen: Sequence[TipInView],
    tags: Sequence[Sequence[TagView]],
    matches: Sequence[Match],
    stated: Sequence[str | None],
    plan: StrikePlan,
    spec: ObjectSpec,
    body: TaggedBody,
) -> tuple[list[Match], ObjectSpec]:
    """Add the placements of tips that show only tags of unknown place.

    Args:
        seen: tips found in the videos.
        tags: for each tip the views of its tags.
        matches: placement of each tip, as tags of known place show it.
        stated: planned id of each tip, `SKIPPED` for one left out; None where it is not stated.
        plan: strike plan.
        spec: object file.
        body: the object, its tags and the camera.

    Returns:
        The placement of each tip; and the object file with the tags' places that follow, for names of sides.

    Raises:
        ImportRefused: a strike that is not stated may be one of several, or tags of several videos would lie
            on one side of the object.
    """
    placements = placements_of(plan)
    index_of = {strike.id: n for n, each in enumerate(placements) for strike in each.strikes}
    tips = [
        TagTip(
            tip.name,
            () if name == SKIPPED else tuple(view for view in views if view.line is not None),
            None if match.placement is None else index_of[match.placement.strikes[0].id],
        )
        for tip, views, match, name in zip(seen, tags, matches, stated, strict=True)
    ]
    named = {n: index_of[name] for n, name in enumerate(stated) if name is not None and name != SKIPPED}
    groups = groups_of(tips, placements, body)
    found, contradicted = list(matches), False
    read: list[Group] = []
    for group in groups:
        agreeing = _stated(group, named)
        if not agreeing.readings and group.is_whole:
            # The contradiction is named by comparison with this reading.
            agreeing, contradicted = (
                replace(group, readings=(_nearest(group, named, tips, placements),)),
                True,
            )
        read.append(agreeing)
        for tip in group.odd_ones():
            found[tip] = Match(None, misfit=_misfit(tip, group, tips))
    is_odd = any(found[tip].misfit and tip not in named for group in groups for tip in group.tips)
    if not contradicted and not is_odd:
        read = _without_alternatives(read, tips, named, placements)
    places: dict[int | str, list[list[float]]] = {}
    for group in read:
        if not group.readings:
            continue
        for tip, number in group.readings[0].placements.items():
            if number is not None and matches[tip].placement is None:
                found[tip] = Match(placements[number])
        places |= {name: T.tolist() for name, T in group.readings[0].places.items()}
    markers = [
        marker.model_copy(update={"T_object_marker": places.get(marker.name, marker.T_object_marker)})
        if marker.T_object_marker is None
        else marker
        for marker in spec.marker
    ]
    return found, spec.model_copy(update={"marker": markers})


def _stated(group: Group, named: Mapping[int, int]) -> Group:
    """Group with those readings that agree with the stated placements; a tip that fits none agrees with all.

    Args:
        group: the group.
        named: stated placement's index by tip's index.
    """
    return replace(
        group,
        readings=tuple(
            reading
            for reading in group.readings
            if all(at is None or named.get(tip, at) == at for tip, at in reading.placements.items())
        ),
    )


def _nearest(
    group: Group, named: Mapping[int, int], tips: Sequence[TagTip], placements: Sequence[Placement]
) -> Reading:
    """Reading of a group that agrees with most stated placements, and then shows most of the stated strikes.

    Args:
        group: the group, of which no reading agrees with all stated placements.
        named: stated placement's index by tip's index.
        tips: all tips.
        placements: placements of the plan.

    Raises:
        ImportRefused: several readings agree equally, and with different statements.
    """
    stated = set(named.values())

    def wrong(reading: Reading) -> frozenset[int]:
        return frozenset(tip for tip, at in reading.placements.items() if named.get(tip, at) != at)

    def disagreement(reading: Reading) -> tuple[int, int]:
        return len(wrong(reading)), len(set(reading.placements.values()) - stated)

    ranked = sorted(group.readings, key=disagreement)
    best = [reading for reading in ranked if disagreement(reading) == disagreement(ranked[0])]
    doubtful = [wrong(reading) for reading in best]
    if not frozenset.intersection(*doubtful):
        said = ", ".join(
            f"{tips[tip].name} as {placements[named[tip]].names}"
            for tip in sorted(frozenset.union(*doubtful))
        )
        raise ImportRefused(
            f"{said}: the tag in these videos cannot show all of these strikes: one of the files is named "
            "after another strike, or shows none of the plan: correct its name, or leave it out "
            f"(--strike {SKIPPED})"
        )
    return best[0]


def _misfit(tip: int, group: Group, tips: Sequence[TagTip]) -> str:
    """Sentence: why a tip of a group fits no planned strike.

    Args:
        tip: index of the tip.
        group: its group.
        tips: all tips.
    """
    tag, odd = tips[tip].views[0].marker, group.odd_ones()
    others = [tips[other].name for other in group.tips if other not in odd]
    if not group.readings:
        return (
            f"{tips[tip].name}: in no strike of the plan would tag {tag} lie on the object: put the object "
            "down as its card shows, and do not touch the phone after the board was filmed (`--table`)"
        )
    if len(odd) > len(group.readings[0].unexplained):
        return (
            f"{', '.join(tips[each].name for each in sorted(odd))}: no place of tag {tag} explains all of "
            "these videos by strikes of the plan: one of them shows another edge, or an object that slides"
        )
    return (
        f"{tips[tip].name}: with tag {tag} as in {', '.join(others)}, the object tips over an edge "
        "of no planned strike, or slides: put the object down as its card shows"
    )


def _without_alternatives(
    groups: Sequence[Group], tips: Sequence[TagTip], named: Mapping[int, int], placements: Sequence[Placement]
) -> list[Group]:
    """Groups with the readings that agree with each other, if these show one strike for every tip.

    Args:
        groups: groups with the readings that agree with what is stated.
        tips: all tips.
        named: stated placement's index by tip's index.
        placements: placements of the plan.

    Raises:
        ImportRefused: tips may show one of several strikes, or tags of two groups would lie on one side.
    """
    together = tags_together(tips)
    left = compatible(groups, together)
    for one, before in zip(left, groups, strict=True):
        if before.readings and not one.readings:
            raise ImportRefused(_same_side(groups, tips, together))
    choices = _choices(left)
    if all(len(each) == 1 or tip in named for tip, each in choices.items()):
        return left
    asked: list[int] = []
    rest, assumed = left, dict(named)
    while open_ := {
        tip: each for tip, each in _choices(rest).items() if len(each) > 1 and tip not in assumed
    }:
        tip = max(open_, key=lambda each: len(open_[each]))
        asked.append(tip)
        assumed[tip] = next(iter(open_[tip]))
        rest = compatible([_stated(group, assumed) for group in rest], together)
    raise ImportRefused(_question(sorted(asked), choices, tips, placements))


def _choices(groups: Sequence[Group]) -> dict[int, dict[int, None]]:
    """Placements' indices that the readings of the groups have for each tip, in the readings' order."""
    found: dict[int, dict[int, None]] = {}
    for group in groups:
        for reading in group.readings:
            for tip, at in reading.placements.items():
                if at is not None:
                    found.setdefault(tip, {})[at] = None
    return found


def _question(
    asked: Sequence[int],
    choices: Mapping[int, Mapping[int, None]],
    tips: Sequence[TagTip],
    placements: Sequence[Placement],
) -> str:
    """Sentence: some strikes are not determined, and which are to be named so that all others follow.

    Args:
        asked: indices of the tips to be named.
        choices: indices of the placements that each tip may show.
        tips: all tips.
        placements: placements of the plan.
    """

    def words(tip: int) -> str:
        ids = [placements[at].names for at in sorted(choices[tip])]
        more = "" if len(ids) <= MAX_NAMED_CHOICES else f" or {len(ids) - MAX_NAMED_CHOICES} others"
        return f"{tips[tip].name} may be {' or '.join(ids[:MAX_NAMED_CHOICES])}{more}"

    example = placements[min(choices[asked[0]])].strikes[0].id
    tags, files, them = "their tags", "these after their strikes", "them"
    if len(asked) == 1:
        tags, files, them = "its tag", "it after its strike", "it"
    return (
        f"{', '.join(words(tip) for tip in asked)}: the object file has no place of {tags} "
        f"(T_object_marker), and the shape looks the same from several sides: rename {files}, as "
        f"{example}.mp4, or name {them} with --strike ID (--strike {BY_IMAGES} for the others, in order): "
        "the others follow"
    )


def _same_side(groups: Sequence[Group], tips: Sequence[TagTip], together: set[tuple[int | str, ...]]) -> str:
    """Sentence: as stated or planned, tags of two groups would lie on one side, though no tip shows both.

    Args:
        groups: groups that have no readings which agree with each other.
        tips: all tips.
        together: pairs of tags that a tip shows together.
    """
    doubtful = [
        group
        for group in groups
        if all(
            left.readings or not other.readings
            for other in groups
            for left in compatible([each for each in groups if each is not group], together)
            if left.tips == other.tips
        )
    ]
    names = " or ".join(", ".join(tips[tip].name for tip in group.tips) for group in doubtful or groups)
    return (
        f"{names}: in all videos together, two tags would lie on one side of the object, but none shows both"
        ": in one of these the object was not put down as its card shows, or the file is named after another "
        f"strike: correct the name, or leave it out (--strike {SKIPPED})"
    )
