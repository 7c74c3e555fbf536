"""Input files of a session: the object, its shape and the plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from acquire.errors import SessionError
from schemas.document import DocumentError
from schemas.input_file import read_text
from schemas.object_spec import ObjectSpec, object_sha256, read_object_spec
from schemas.strike_plan import StrikePlan, read_strike_plan
from schemas.watch_lines import SeenMarker

POSE_TOLERANCE_RAD = 0.14
"""largest error of a placement [rad]: 8 degrees, far above that of a careful one, far below that of a wrong
face"""


@dataclass
class SessionInput:
    """Object and plan files of a session, read and checked against each other.

    Args:
        object_path: object file (TOML).
        plan_path: plan file (JSON).

    Raises:
        SessionError: a file cannot be read, or the plan was made for another object.
    """

    object_path: Path
    plan_path: Path
    object_toml: str = field(init=False)
    """text of the object file"""
    plan_json: str = field(init=False)
    """text of the plan file"""
    spec: ObjectSpec = field(init=False)
    plan: StrikePlan = field(init=False)
    shape: tuple[str, bytes] | None = field(init=False, default=None)
    """name and content of the object's shape file; None if the shape is given in the object file"""

    def __post_init__(self) -> None:
        try:
            self.spec = read_object_spec(self.object_path)
            self.plan = read_strike_plan(self.plan_path)
        except DocumentError as error:
            raise SessionError(str(error)) from None
        self.object_toml = read_text(self.object_path)
        self.plan_json = read_text(self.plan_path)
        if self.spec.shape.file is not None:
            shape_path = self.object_path.parent / self.spec.shape.file
            try:
                self.shape = (shape_path.name, shape_path.read_bytes())
            except OSError as error:
                problem = f"{shape_path}: the object's shape file cannot be read: {error.strerror}"
                raise SessionError(problem) from None
        digest = object_sha256(self.spec, self.shape[1] if self.shape else None)
        if digest != self.plan.object_sha256:
            raise SessionError(
                f"{self.plan_path}: this plan is for another object ({self.plan.object_name!r}) "
                f"or an older version of {self.object_path}: "
                f"run `analyze plan {self.object_path} -o {self.plan_path}` again"
            )

    @property
    def untagged(self) -> bool:
        """True if the object has no tags: it is followed by its print, which also tells of its placement."""
        return not self.spec.marker

    def is_placed(self, error_rad: float | None, text: str) -> bool:
        """True if the object lies as planned; without tags if outline and print do not contradict.

        Args:
            error_rad: angle to the planned orientation [rad]; None if unknown.
            text: instruction to put it down otherwise; empty if there is none.
        """
        if self.untagged:
            return not text
        return error_rad is not None and error_rad < POSE_TOLERANCE_RAD

    def lacks_places(self, seen: Sequence[SeenMarker]) -> bool:
        """True if markers of the object are in view, all of them without a place in the object file.

        The first strikes serve to find the places (`analyze register`): no placement can be checked yet.

        Args:
            seen: markers in view, also those of other objects.
        """
        placed = {marker.name: marker.T_object_marker is not None for marker in self.spec.marker}
        own = [placed[marker.id] for marker in seen if marker.id in placed]
        return bool(own) and not any(own)

    @property
    def replan_advice(self) -> str:
        """Advice for error messages: the command that plans for the rig at hand."""
        return f"plan for this rig: `analyze plan {self.object_path} --rig RIG.toml -o {self.plan_path}`"
