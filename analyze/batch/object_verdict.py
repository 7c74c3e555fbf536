"""Sentences on the estimate of one object over its sessions: what to trust, doubt and repeat."""

# scipy is only partly typed.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false
# pyright: reportUnknownArgumentType=false, reportUnknownMemberType=false

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import chdtr

from analyze.batch.object_sessions import ObjectOverSessions, QuantityOverSessions
from analyze.result.digits import decimals, number, signed
from schemas.wording import counted

CENTRE = "centre of mass "
"""start of the names of the components of the centre of mass"""
MAX_CHANCE = 1e-3
"""p-value below which a scatter larger or smaller than stated is reported"""
DISAGREEMENT = 1.5
"""ratio of two estimates of the between-session sd from which on they count as different"""
SATURATED = 1.1
"""ratio of the mean's interval to its shared part below which more sessions hardly help"""


def verdict_sentences(found: ObjectOverSessions) -> list[tuple[str, str]]:
    """Sentences on what to trust, doubt and repeat, each with its word: trust, doubt or repeat."""
    if not found.quantities:
        return [("repeat", "no session measured a quantity of this object: strike it on more axes")]
    count = max(each.estimate.sessions for each in found.quantities)
    if count == 1:
        return [
            (
                "doubt",
                "one session: nothing is known of what varies between sessions; its own interval stands",
            ),
            (
                "repeat",
                "record a second and a third session, best on another day or with the table levelled anew",
            ),
        ]
    said: list[tuple[str, str]] = []
    if count == 2:
        said.append(("doubt", "two sessions show the scatter to a factor of about ten: record a third"))
    said += _scatter_sentences(found)
    said += _odd_sentences(found)
    said += _shared_sentences(found)
    if not any(word == "doubt" for word, _ in said):
        said.insert(0, ("trust", f"{counted(count, 'session')} agree within what they state"))
    return said


def _scatter_sentences(found: ObjectOverSessions) -> Iterator[tuple[str, str]]:
    beyond = [each for each in found.quantities if each.stated_p_value < MAX_CHANCE]
    within = [
        each
        for each in found.quantities
        if each not in beyond and each.shared_known and each.estimate.p_value < MAX_CHANCE
    ]
    if beyond:
        worst = max(beyond, key=_over_stated)
        text = (
            f"sessions scatter {_over_stated(worst):.1f} times what they state ({_names(beyond)}): something "
            "varies between sessions that no session's interval holds. Look for what changed (rig, level, "
            "filling, tags), and trust the interval over sessions, not a session's own"
        )
        yield "doubt", text
    if not beyond and found.joint is not None and not found.joint_own and found.joint[2] < MAX_CHANCE:
        text = (
            "the sessions' centres of mass differ by more than they state, all three components taken "
            "together: look for what changed between sessions"
        )
        yield "doubt", text
    if within:
        worst = max(within, key=lambda each: each.estimate.scatter_ratio)
        text = (
            f"sessions scatter {worst.estimate.scatter_ratio:.1f} times the noise of their strikes "
            f"({_names(within)}), but within what they state: table tilt, camera or placement differ between "
            "them"
        )
        yield "trust", text
    apart = [each for each in found.quantities if _estimators_differ(each)]
    if apart:
        text = f"two estimates of the sd between sessions differ ({_names(apart)}): few sessions set it"
        yield "doubt", text


def _names(quantities: Sequence[QuantityOverSessions]) -> str:
    """Names of quantities; those of the centre of mass are drawn together."""
    axes = [each.name[-1] for each in quantities if each.name.startswith(CENTRE)]
    others = [each.name for each in quantities if not each.name.startswith(CENTRE)]
    return ", ".join([*([f"{CENTRE}{', '.join(axes)}"] if axes else []), *others])


def _over_stated(each: QuantityOverSessions) -> float:
    """Scatter from session to session over the median of the whole stated sds."""
    return each.estimate.scatter / float(np.median(each.sd))


def _estimators_differ(each: QuantityOverSessions) -> bool:
    found = each.estimate
    low, high = sorted((found.between_sd, found.between_sd_reml))
    return found.sessions > 2 and high > 0.5 * found.stated_sd and high > DISAGREEMENT * low


def _odd_sentences(found: ObjectOverSessions) -> Iterator[tuple[str, str]]:
    odd: dict[int, list[str]] = {}
    for each in found.quantities:
        for i in each.estimate.odd:
            shift = each.estimate.left_out[i].shift
            moved = f"{each.name} by {signed(shift, decimals(abs(shift)))} {each.unit}"
            odd.setdefault(each.sessions[i], []).append(moved)
    for index, moved in odd.items():
        session = found.sessions[index]
        text = (
            f"the session of {session.day} ({session.url.rsplit('/', 1)[-1]}) stands out; it moves the mean "
            f"of {', '.join(moved)}. Look at its replay, and record it again"
        )
        yield "repeat", text


def _shared_sentences(found: ObjectOverSessions) -> Iterator[tuple[str, str]]:
    several = [each for each in found.quantities if each.estimate.sessions > 1]
    closer = [
        each
        for each in several
        if float(chdtr(each.estimate.sessions - 1, each.estimate.chi_square)) < MAX_CHANCE
    ]
    if closer:
        text = (
            f"sessions agree better than they state ({_names(closer)}): most of what they state is the same "
            "in all of them (shape, edges, mass)"
        )
        yield "trust", text
    at_end = [each for each in several if each.half < SATURATED * each.shared_half and each.shared_known]
    if at_end:
        worst = max(at_end, key=lambda each: each.half)
        digits = decimals(worst.half)
        text = (
            f"more sessions hardly narrow {_names(at_end)}: of ± {number(worst.half, digits)} {worst.unit} "
            f"all sessions share ± {number(worst.shared_half, digits)}. A better shape, edge or mass would"
        )
        yield "trust", text
