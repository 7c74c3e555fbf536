"""Record of how `analyze compact` recoded a recording's images: the file's metadata `percuss.compacted`."""

from __future__ import annotations

import math
from collections.abc import Mapping

from pydantic import Field, ValidationError

from schemas.document import Document
from schemas.wording import counted


class StrikeChange(Document):
    """Difference of a strike's motion by recoded images from that by the original ones."""

    strike_id: str
    phi_rad: float | None = Field(description="balance angle by the recoded images minus by the original")
    k_relative: float | None = Field(description="the same of k, over k")
    phi_sd_relative: float | None = Field(
        default=None, description="standard deviation of phi by the recoded images over the original, minus 1"
    )
    k_sd_relative: float | None = Field(default=None, description="the same of k")


class Compaction(Document):
    """Recoding of a file's images, with the file that it was made from."""

    source_content_id: str | None
    """hash of the original file's messages, as in its seal; null if it had none"""
    source_bytes: int = Field(ge=0, description="size of the original file")
    software: str = Field(description="percuss version and git commit that recoded")
    images: int = Field(ge=0, description="number of recoded images")
    exact: bool
    """True if every pixel is the original's"""
    step: int = Field(default=0, ge=0, description="step of the first version's quantisation [grey]; else 0")
    near_lossless: bool = False
    """True if pixels without structure hold local means"""
    information_share: float | None = Field(
        default=None, description="share of the information on motion in exact pixels; null if none changed"
    )
    noise_sd: float | None = Field(default=None, description="1 sigma of a pixel's noise [grey]")
    cropped: bool = False
    """True if the images are kept only where something moves"""
    strikes: list[StrikeChange] = Field(default=[], description="empty if exact")

    @property
    def within_noise(self) -> bool:
        """True if grey values changed within the camera's noise."""
        return self.near_lossless or self.step > 0

    def loss_text(self) -> str:
        """What the images lost, in words."""
        if self.exact:
            return "no pixel changed"
        parts = ["averaged within the noise where they show no structure"] if self.near_lossless else []
        parts += [f"quantised by {self.step} grey levels"] if self.step else []
        parts += ["kept where something moves"] if self.cropped else []
        return ", ".join(parts)

    def change_text(self) -> str:
        """Largest change of a strike's phi and k by the loss, in words."""
        phi = max((abs(math.degrees(each.phi_rad or 0.0)) for each in self.strikes), default=0.0)
        k = max((100.0 * abs(each.k_relative or 0.0) for each in self.strikes), default=0.0)
        return (
            f"{counted(len(self.strikes), 'strike')} compared: phi within {phi:.4f} deg, k within {k:.3f} %"
        )


COMPACTED_NAME = "percuss.compacted"
"""name of the metadata record, whose entry `json` holds a Compaction"""


def parse_compaction(entries: Mapping[str, str]) -> Compaction | None:
    """Compaction in the entries of its metadata record; None if it cannot be read."""
    try:
        return Compaction.model_validate_json(entries.get("json", ""))
    except ValidationError:
        return None
