"""The answer of the planar impacts as JSON values."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from analyze.reproduce.planar_impacts import GYRATION_M, PERCENTILES

if TYPE_CHECKING:
    from analyze.reproduce.planar_impacts import Clustered, PlanarAnswer
    from analyze.types import Array


def answer_json(answer: PlanarAnswer) -> dict[str, Any]:
    """Restitution, friction and the comparison with a rigid body, as JSON values with units.

    Intervals are 95 %, from leaving out blocks of successive impacts. What is not determined is null.
    """

    def quantity(found: Clustered | None, unit: str) -> dict[str, Any] | None:
        if found is None:
            return None
        return {"value": found.value, "sd": found.sd, "unit": unit, "interval95": list(found.interval)}

    def percentiles(values: Array) -> dict[str, float | None]:
        return {str(name): _finite(value) for name, value in zip(PERCENTILES, values.tolist(), strict=True)}

    rigid, friction = answer.rigid, answer.friction
    least, most = rigid.gyration
    return {
        "impacts": answer.impacts,
        "left_out": answer.left_out,
        "approach_m_s": {"5": answer.approach[0], "95": answer.approach[1]},
        "rigid_body": {
            "x_is_mirrored": rigid.mirrored,
            "spin_explained": rigid.explained,
            "spin_explained_as_stated": rigid.explained_as_stated,
            "spin_residual_rad_s": rigid.residual_rad_s,
            "radius_of_gyration": {
                "stated_m": GYRATION_M,
                "lower": quantity(least, "m"),
                "upper": quantity(most, "m"),
            },
            "impulses_that_pull": rigid.pulls,
            "gains_of_energy": rigid.gains,
        },
        "restitution": {
            **(quantity(answer.restitution, "1") or {}),
            "scatter": answer.restitution_scatter,
            "percentiles": percentiles(answer.restitution_percentiles),
            "by_speed": quantity(answer.restitution_by_speed, "s/m"),
        },
        "friction": {
            "mu": quantity(friction.value, "1"),
            "slid": friction.slid,
            "percentiles_slid": percentiles(friction.percentiles),
            "ratio_sd": friction.ratio_sd,
            "share_against_sliding": _finite(friction.opposing),
            "percentiles_others": percentiles(friction.held_percentiles),
            "share_beyond_cone": _finite(friction.beyond),
        },
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
