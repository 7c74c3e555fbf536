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
    """Body that was struck, object and fixture together, and the errors of the object alone by cause."""

    held: HeldObject
    """bodies of the fixture, mass of the object and errors of its place, as the object file states them"""
    struck: InertialParameters
    """mass, centre of mass and moments of both together, in the object frame O"""
    shares: tuple[FixtureShare, ...]
    """parts of the errors of the object alone, by their cause; the first is that of the strikes"""


def object_alone(
    struck: InertialParameters, model: ObjectModel
) -> tuple[InertialParameters, FixtureEstimate | None]:
    """Inertial parameters of the object without its fixture, with the struck body and errors by cause.

    Args:
        struck: parameters of the body that tipped, without its markers.
        model: its exterior, with the fixture if it has one.

    Returns:
        Parameters in the object frame O, and the estimate of the fixture; `struck` itself and None if there
        is no fixture.
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

    Its region masses divide one body, and are left out where the object is held in a fixture.

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
    """Changes of the object alone under what-ifs (other assumptions), from those of the struck body.

    Shifts of the centre of mass are multiplied by the mass of the struck body over that of the object, and
    relative changes of the moments by the trace of its tensor over that of the object's.

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
