"""Estimate of an object alone, from that of the body that was struck: the object held in a fixture."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from analyze.estimation.fixture import FixtureShare, without_fixture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.mass_properties import InertialParameters
    from analyze.estimation.what_ifs import Alternative
    from analyze.geometry.held_object import HeldObject
    from analyze.geometry.object_model import ObjectModel
    from analyze.pipeline.paper import PaperEstimate


@dataclass(frozen=True)
class FixtureEstimate:
    """Body that was struck, object and fixture together, and what subtracting the fixture adds to errors."""

    held: HeldObject
    """object and fixture, as the object file states them"""
    struck: InertialParameters
    """mass, centre of mass and moments of both together, in the object frame O"""
    shares: tuple[FixtureShare, ...]
    """parts of the errors of the object alone, by their cause; the first is that of the strikes"""


def object_alone(
    struck: InertialParameters, model: ObjectModel
) -> tuple[InertialParameters, FixtureEstimate | None]:
    """Inertial parameters of the object without its fixture, and how they were found.

    Args:
        struck: parameters of the body that tipped, without its markers.
        model: its exterior, with the fixture if it has one.

    Returns:
        Parameters in the object frame O, `struck` itself and None if there is no fixture.
    """
    held = model.held
    if held is None:
        return struck, None
    found = without_fixture(struck, held)
    return found.inertial, FixtureEstimate(held, struck, found.shares)


def paper_alone(
    paper: PaperEstimate, struck: InertialParameters, bare: InertialParameters, model: ObjectModel
) -> PaperEstimate:
    """The paper's estimate for the object alone: without its markers, and without its fixture.

    Its region masses are those of one body; they are left out where the object is held in a fixture.

    Args:
        paper: estimate by the paper's method for the body that tipped.
        struck: our parameters of that body.
        bare: those without its markers.
        model: its exterior.
    """
    com = paper.com.position + bare.com.position - struck.com.position
    if model.held is None:
        return replace(paper, com=replace(paper.com, position=com))
    return replace(paper, com=replace(paper.com, position=model.held.com_alone(com)), regions=None)


def alternatives_alone(
    found: Sequence[Alternative],
    bare: InertialParameters,
    fixture: FixtureEstimate | None,
    inertial: InertialParameters,
) -> tuple[Alternative, ...]:
    """What-ifs of the struck body as they change centre of mass and moments of the object alone.

    Its centre moves by more, as the object weighs less; its moments change by the same amount, of less.

    Args:
        found: what-ifs of the body that tipped.
        bare: parameters of that body.
        fixture: how the fixture was subtracted; None if there is none: `found` is returned unchanged.
        inertial: parameters of the object alone.
    """
    if fixture is None:
        return tuple(found)
    by_mass = bare.mass / inertial.mass
    by_moment = float(np.trace(bare.inertia) / np.trace(inertial.inertia))
    return tuple(
        replace(
            each,
            com_shift=by_mass * each.com_shift,
            moment_changes=None if each.moment_changes is None else by_moment * each.moment_changes,
            com_half=by_mass * each.com_half,
        )
        for each in found
    )
