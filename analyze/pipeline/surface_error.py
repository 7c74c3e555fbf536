"""Error of the shape's faces where the object file does not state it: assumed, and estimated from strikes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from analyze.estimation.face_errors import estimated_face_sd
from analyze.geometry.surface_error import assumed_surface_sd
from analyze.pipeline.equiplanes import equiplanes, systematic_errors
from analyze.planning.corrected import corrected_plan

if TYPE_CHECKING:
    from collections.abc import Sequence

    from analyze.estimation.priors import ComPrior
    from analyze.pipeline.evidence import Evidence
    from analyze.types import TipMotion


@dataclass(frozen=True)
class SurfaceError:
    """Standard deviation of the places of the shape's faces, where the object file does not state it."""

    assumed: float
    """1 sigma of a face's place before any strike [m]"""
    estimated: float
    """1 sigma of a face's place given the strikes [m], which the estimate uses"""


def with_surface_error(
    evidence: Evidence, motions: Sequence[TipMotion], prior: ComPrior, estimator: str | None
) -> tuple[Evidence, SurfaceError | None]:
    """Evidence whose object file states the error of the shape's faces, estimated from the strikes if needed.

    Args:
        evidence: strikes with object file, shape and plan.
        motions: fitted motions of the strikes used.
        prior: prior of the centre of mass.
        estimator: name of the estimator of balance angle and rate constant; None for the fit chosen for each
            motion.

    Returns:
        The evidence, and what was assumed and estimated. Where the object file states `surface_sd_m`, the
        evidence is unchanged and the second is None.
    """
    spec = evidence.spec
    if spec.shape.surface_sd_m is not None:
        return evidence, None
    planes = equiplanes(evidence, motions, estimator)
    found = SurfaceError(
        assumed_surface_sd(spec.shape, evidence.model.noise_sd),
        estimated_face_sd(planes, systematic_errors(evidence), prior),
    )
    shape = spec.shape.model_copy(update={"surface_sd_m": found.estimated})
    stated = spec.model_copy(update={"shape": shape})
    plan = corrected_plan(evidence.plan, spec, stated, evidence.model)
    return replace(evidence, spec=stated, plan=plan), found
