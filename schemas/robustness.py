"""Entry of the robustness table of a result: change of the answer under one alternative."""

from __future__ import annotations

from pydantic import Field

from schemas.document import SparseDocument, Vector3


class AlternativeResult(SparseDocument):
    """Change of centre of mass and moments of inertia if an assumption, a strike or an estimator differed.

    The answer holds under the alternative if it changes by at most 1.5 half widths of its 95 % interval, or,
    where no assumption differed, if the alternative is too uncertain to contradict it.
    """

    left_out = ("strike", "moment_changes")

    what_if: str = Field(description="the alternative in words")
    strike: str | None = Field(default=None, description="id of the strike left out; else not written")
    com_shift_m: Vector3 = Field(description="change of the centre of mass [m], in O")
    moment_changes: list[float] | None = Field(
        default=None,
        description="relative changes of the principal moments, ascending; not written if k is left out",
    )
    com_holds: bool = Field(description="true if the centre of mass stays inside its interval")
    moments_hold: bool = Field(description="true if the measured entries of the tensor stay inside theirs")
