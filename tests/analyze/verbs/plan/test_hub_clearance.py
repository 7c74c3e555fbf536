"""Note on strikes at which the hub of the printed arm would touch a tall object."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from analyze.rig_parts.arm_part import HUB
from analyze.verbs.plan.hub_clearance import HUB_CLEARANCE_M, note_on_hub
from schemas.strike_plan import PlannedStrike

BOX = np.array(list(product((-0.03, 0.03), (-0.02, 0.02), (-0.1, 0.1))))
"""box of 60 x 40 x 200 mm about its middle"""


def strike(name: str, impact_height_m: float | None, *, lying: bool = False) -> PlannedStrike:
    """Strike at the box, which stands upright, or lies on its broad side."""
    turn = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] if lying else np.eye(3).tolist()
    return PlannedStrike.model_construct(
        id=name,
        R_world_object=turn,
        p_world_object=[0.0, 0.0, 0.02 if lying else 0.1],
        impact_height_m=impact_height_m,
    )


def test_strikes_below_the_reach_of_the_arm_are_named_with_an_arm_that_clears_them() -> None:
    # 200 mm high: the hinge must be at 225 mm, an arm of 120 mm is at 225 mm if it strikes at 105 mm.
    strikes = [strike("s1", 0.11), strike("s2", 0.06), strike("s3", 0.1), strike("s4", 0.03, lying=True)]
    note = note_on_hub(strikes, BOX, 0.12)
    assert note is not None
    assert note.startswith("s2, s3: ")
    assert "arm_length_m = 0.17 clears it" in note
    assert note_on_hub(strikes, BOX, 0.17) is None


@pytest.mark.parametrize("heights", [(0.11, 0.19), (None,)])
def test_strikes_that_are_clear_or_have_no_aim_give_no_note(heights: tuple[float | None, ...]) -> None:
    assert note_on_hub([strike(f"s{i}", each) for i, each in enumerate(heights)], BOX, 0.12) is None


def test_the_clearance_is_the_printed_hubs_radius_and_5_mm() -> None:
    assert pytest.approx(HUB / 2 + 5.0) == 1000 * HUB_CLEARANCE_M
