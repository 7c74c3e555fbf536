"""Names of tag families: ours, AprilTag's and OpenCV's."""

from __future__ import annotations

import pytest

from schemas.tags import TagFamily


@pytest.mark.parametrize("family", TagFamily)
def test_opencv_names_are_understood(family: TagFamily) -> None:
    assert TagFamily(family.opencv) is family


@pytest.mark.parametrize("name", ["tag36h11", "36H11", "apriltag_36h11"])
def test_apriltag_names_are_understood(name: str) -> None:
    assert TagFamily(name) is TagFamily.APRILTAG_36H11


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(ValueError, match="tag36h12"):
        TagFamily("tag36h12")
