"""`analyze print-tags --mat`: the printed mat is the layout, and its tags are nobody else's."""

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main
from analyze.errors import TagError
from analyze.tags.families import FAMILIES, cells
from analyze.tags.mat import MAT_FAMILY, MAT_PAPERS, mat, mat_of_tag
from tests.analyze.tags.painted import PX_PER_MM, painted

WITHIN_MM = 0.1


def run(*arguments):
    return CliRunner().invoke(main, ["print-tags", *map(str, arguments)])


@pytest.mark.parametrize("paper", MAT_PAPERS)
def test_tags_in_the_pdf_have_the_place_and_size_of_the_layout(tmp_path, paper):
    out = run("--mat", "--paper", paper, "-o", tmp_path / "mat.pdf")
    assert out.exit_code == 0, out.output
    layout, seen = mat(paper), {}
    assert f"{layout.ruler_mm:g} mm" in out.output
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(FAMILIES[MAT_FAMILY.value]))
    pages = painted((tmp_path / "mat.pdf").read_bytes())
    for (image, size), middle in zip(pages, layout.middles, strict=True):
        assert size == pytest.approx([layout.width, layout.height], abs=0.01)
        corners, ids, _ = detector.detectMarkers(image)
        for quad, number in zip(corners, ids.ravel().tolist(), strict=True):
            page = (quad[0] + 0.5) / PX_PER_MM - size / 2
            seen[number] = page * [1, -1] + [middle, 0]
    assert sorted(seen) == sorted(tag.id for tag in layout.tags)
    for tag in layout.tags:
        assert np.abs(seen[tag.id] - 1000 * tag.corners[:, :2]).max() < WITHIN_MM


def test_tags_differ_from_each_other_and_between_papers():
    codes = [cells(MAT_FAMILY.value, tag.id)[1:-1, 1:-1] for paper in MAT_PAPERS for tag in mat(paper).tags]
    for number, code in enumerate(codes):
        others = [(other, turn) for other in codes[:number] for turn in range(4)]
        least = min((int(np.sum(code != np.rot90(other, turn))) for other, turn in others), default=25)
        assert least >= 8
    assert mat_of_tag(mat("A3").tags[0].name) == mat("A3")
    assert mat_of_tag(0) is None
    assert mat_of_tag("5x5_100-3") is None


@pytest.mark.parametrize("paper", MAT_PAPERS)
def test_tags_have_their_white_rims_and_leave_the_free_area(paper):
    layout = mat(paper)
    areas = np.array([[tag.x, tag.y, 9 / 14 * tag.width, 9 / 14 * tag.height] for tag in layout.tags])
    for number, (x, y, wide, high) in enumerate(areas):
        apart = np.abs(areas[:number, :2] - [x, y]) - areas[:number, 2:] - [wide, high]
        assert np.all(apart.max(axis=1) > -1e-9)
        inside = np.array(layout.free) - (np.abs([x, y]) - [wide, high])
        assert inside.min() < 1e-9


def test_other_options_and_papers_are_refused(tmp_path):
    for wrong in (("--ids", "3"), ("--size-mm", "20"), ("--board", "charuco"), ("--family", "25h9")):
        assert "the mat has tags of its own" in run("--mat", *wrong, "-o", tmp_path / "m.pdf").output
    assert "choose A4, A3, A4x3" in run("--mat", "--paper", "Letter", "-o", tmp_path / "m.pdf").output
    with pytest.raises(TagError, match="unknown paper of a mat"):
        mat("A5")
    said = run("--family", "5x5_1000", "--ids", "500", "-o", tmp_path / "t.pdf").output
    assert "belongs to the mat" in said
    assert not list(tmp_path.iterdir())
