"""Entry of the Result document on contents that move: is the struck body rigid?"""

from __future__ import annotations

import enum
from typing import ClassVar

from pydantic import Field

from schemas.document import Document, SparseDocument, Vector3
from schemas.quantity import Quantity


class ContentsAnswer(enum.Enum):
    """Answer to the question whether the struck body is rigid; none claims that it is."""

    NOT_RIGID = "not_rigid"
    NOTHING_MOVES = "nothing_moves"
    NOT_TESTED = "not_tested"


class ContentsTest(Document):
    """Statistic of one test of a rigid body."""

    chi_squared: float = Field(description="misfit of a rigid body, in the variances of the strikes")
    freedom: int = Field(ge=1, description="degrees of freedom of chi_squared")
    limit: float = Field(description="chi_squared that chance exceeds at the false-alarm probability")
    moves: bool
    """true if the test shows that something moves"""


class EdgeScatterResult(Document):
    """Strikes over one edge: do they share balance angle phi and rate constant k?"""

    axis_id: str
    """name of the pivot edge"""
    strikes: list[str] = Field(description="ids of the strikes, from the least energy to the greatest")
    energy_ratios: list[float] = Field(
        description="energy of each strike over the energy needed to reach balance"
    )
    phi_change_rad: float = Field(
        description="rise of phi from the least energy to the greatest, by its slope"
    )
    k_change_relative: float = Field(description="relative change of k from the least energy to the greatest")
    chi_squared: float = Field(description="scatter of phi and ln k about their mean, in their variances")
    freedom: int = Field(description="degrees of freedom of chi_squared")


class PoseCentreResult(Document):
    """Centre of mass of the struck body, markers included, as it rests on one face."""

    face: str
    """name of the face on the table"""
    up: Vector3 = Field(description="direction that points upwards, in O")
    centre_of_mass: Quantity
    """centre of mass by the strikes of this pose [m, in O]"""
    residual_m: float = Field(
        description="rms distance of the centre of mass of all poses together from the planes of this pose"
    )


class ContentsResult(SparseDocument):
    """Tests whether the struck body is rigid, with the centre of mass of each pose.

    The body is that which tipped: with its markers, and its fixture if it has one.
    """

    left_out: ClassVar[tuple[str, ...]] = ("filled_share", "mass", "detectable_share")

    answer: ContentsAnswer
    """answer in short"""
    text: str = Field(description="the answer in words, with its evidence")
    detectable_share: float | None = Field(
        default=None,
        description="smallest share of a liquid in the mass that would have been found; not written if none",
    )
    energies: ContentsTest | None = Field(
        description="test of strikes over one edge at several energies; null if no edge was struck twice"
    )
    edges: list[EdgeScatterResult] = Field(description="one per edge that was struck more than once")
    poses_agree: ContentsTest | None = Field(
        description="test of one centre of mass for all poses; null if the strikes do not compare poses"
    )
    pose_shift_m: float = Field(
        description="largest shift of the centre of mass between poses, as determined"
    )
    poses: list[PoseCentreResult] = Field(description="one per face rested on")
    filled_share: Quantity | None = Field(
        default=None, description="filled share of a stated container; not written unless something moves"
    )
    mass: Quantity | None = Field(
        default=None, description="mass of its contents; not written unless something moves"
    )
