"""`analyze print-tags`: printed tags and boards are to scale and can be detected."""

import cv2
import numpy as np
import pytest
from click.testing import CliRunner

from analyze.calibration.board import corner_points
from analyze.cli import main
from analyze.errors import TagError
from analyze.tags.families import FAMILIES, cells, count
from analyze.tags.sheet import Board, Tag, board_page, parse_ids, tag_pages
from tests.analyze.tags.painted import PX_PER_MM, painted
from tests.places import OBJECTS

WITHIN_MM = 0.1


def run(*arguments):
    return CliRunner().invoke(main, ["print-tags", *map(str, arguments)])


def found_tags(image, family, height_mm=0.0):
    """Corners (4, 2) [mm from the lower left corner] by id."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(FAMILIES[family]), parameters)
    corners, ids, _ = detector.detectMarkers(image)
    return {
        int(tag_id): (square[0] + 0.5) / PX_PER_MM * [1, -1] + [0, height_mm]
        for tag_id, square in zip(ids.ravel(), corners, strict=True)
    }


def corners_of(placed):
    size = placed.tag.size_mm
    return np.array([placed.x, placed.y]) + size * np.array([[0, 1], [1, 1], [1, 0], [0, 0]])


@pytest.mark.parametrize(("paper", "width", "height"), [("A4", 210.0, 297.0), ("Letter", 215.9, 279.4)])
def test_tags_in_the_pdf_have_the_planned_position_and_size(tmp_path, paper, width, height):
    out = run("--ids", "0-11", "--size-mm", "40", "--paper", paper, "-o", tmp_path / "t.pdf")
    assert out.exit_code == 0, out.output
    pages = painted((tmp_path / "t.pdf").read_bytes())
    expected = tag_pages([Tag("36h11", i, 40.0) for i in range(12)], paper, "")
    assert len(pages) == len(expected)
    for (image, size), page in zip(pages, expected, strict=True):
        assert size == pytest.approx([width, height], abs=0.01)
        seen = found_tags(image, "36h11", height)
        assert sorted(seen) == [placed.tag.id for placed in page.tags]
        for placed in page.tags:
            assert np.abs(seen[placed.tag.id] - corners_of(placed)).max() < WITHIN_MM


def test_tags_of_an_object_file(tmp_path):
    assert run("--object", OBJECTS / "salt.toml", "-o", tmp_path / "t.pdf").exit_code == 0
    ((image, _),) = painted((tmp_path / "t.pdf").read_bytes())
    seen = found_tags(image, "36h11")
    assert sorted(seen) == list(range(30, 40))
    for corners in seen.values():
        assert np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) == pytest.approx(
            [30.0] * 4, abs=WITHIN_MM
        )


def test_tags_can_be_printed_before_the_shape_file_exists(tmp_path):
    head = 'name = "mug"\nmass_kg = 0.3\nmass_sd_kg = 0.001\n[shape]\nfile = "mug.stl"\nunit = "mm"\n'
    text = f"{head}[[marker]]\nid = 5\nsize_m = 0.025\n"
    (tmp_path / "mug.toml").write_text(text)
    out = run("--object", tmp_path / "mug.toml", "-o", tmp_path / "t.pdf")
    assert out.exit_code == 0
    assert "1 tag of 25 mm" in out.output


def test_tags_of_an_untagged_object_are_refused(tmp_path):
    head = 'name = "mug"\nmass_kg = 0.3\nmass_sd_kg = 0.001\n[shape]\nfile = "mug.stl"\nunit = "mm"\n'
    (tmp_path / "mug.toml").write_text(head)
    out = run("--object", tmp_path / "mug.toml", "-o", tmp_path / "t.pdf")
    assert out.exit_code == 1
    assert "mug.toml: has no tags: add a [[marker]] for each, or print the mat (--mat)" in out.output


def test_board_is_detected_by_opencv(tmp_path):
    assert run("--board", "charuco", "-o", tmp_path / "b.pdf").exit_code == 0
    ((image, _),) = painted((tmp_path / "b.pdf").read_bytes())
    board = cv2.aruco.CharucoBoard(
        (7, 9), 22.0, 15.4, cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_100)
    )
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(image)
    assert len(ids) == 6 * 8
    ideal = board.getChessboardCorners()[ids.ravel(), :2]
    seen = corners.reshape(-1, 2) / PX_PER_MM
    off = (seen - seen.mean(axis=0)) - (ideal - ideal.mean(axis=0))
    assert np.abs(off).max() < WITHIN_MM


@pytest.mark.parametrize("family", FAMILIES)
def test_codes_equal_opencvs(family):
    last = count(family) - 1
    code = cells(family, last)
    assert not code[[0, -1]].any()
    assert not code[:, [0, -1]].any()
    drawn = np.kron(np.pad(code, 1, constant_values=True), np.ones((12, 12))).astype(np.uint8) * 255
    assert list(found_tags(drawn, family)) == [last]


def test_file_is_the_same_on_every_run(tmp_path):
    for name in ("a.pdf", "b.pdf"):
        run("--ids", "1", "-o", tmp_path / name)
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()


def test_many_tags_take_several_pages():
    pages = tag_pages([Tag("36h11", i, 60.0) for i in range(13)], "A4", "x")
    assert [placed.tag.id for page in pages for placed in page.tags] == list(range(13))
    assert len(pages) == 4
    for page in pages:
        for placed in page.tags:
            assert placed.x - placed.quiet_zone >= 26
            assert placed.x + 60 + placed.quiet_zone <= page.width - 12


def test_tags_of_an_object_have_the_families_it_states(tmp_path):
    text = 'name = "mug"\nmass_kg = 0.3\nmass_sd_kg = 0.001\n[shape]\nfile = "mug.stl"\nunit = "mm"\n'
    text += "".join(
        f'[[marker]]\nfamily = "{family}"\nid = 5\nsize_m = 0.025\n'
        for family in ("36h11", "25h9", "4x4_100")
    )
    (tmp_path / "mug.toml").write_text(text)
    assert run("--object", tmp_path / "mug.toml", "-o", tmp_path / "t.pdf").exit_code == 0
    ((image, _),) = painted((tmp_path / "t.pdf").read_bytes())
    for family in ("36h11", "25h9", "4x4_100"):
        ((tag_id, corners),) = found_tags(image, family).items()
        assert tag_id == 5
        assert np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1) == pytest.approx(
            [25.0] * 4, abs=WITHIN_MM
        )


def test_ids_are_parsed():
    assert parse_ids("0-3, 7,2") == [0, 1, 2, 3, 7]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--size-mm", "200"), "too large for A4: choose at most 137 mm"),
        (("--size-mm", "0.04"), "too small to be printed"),
        (("--size-mm", "nan"), "too small to be printed"),
        (("--family", "41h12"), "unknown tag family: choose 36h11"),
        (("--ids", "580-590"), "36h11 has no tag 587: its ids are 0 to 586"),
        (("--ids", "4-x"), "not understood: write ids such as 0-11"),
        (("--ids", "7-3"), "runs backwards: write 3-7"),
        (("--paper", "A9"), "unknown paper: choose A4 or Letter"),
        (("--object", "gone.toml"), "gone.toml"),
        (("--board", "charuco", "--squares", "7"), "write columns x rows"),
        (("--board", "charuco", "--squares", "2x9"), "too few corners"),
        (("--board", "charuco", "--squares", "20x20"), "needs 200 tags, 5x5_100 has 100"),
        (("--board", "charuco", "--square-mm", "40"), "too large for A4: choose squares of at most 24 mm"),
        (("--board", "charuco", "--square-mm", "4"), "too small to be printed"),
    ],
)
def test_bad_input_gives_a_one_line_error_and_no_file(tmp_path, arguments, message):
    out = run(*arguments, "-o", tmp_path / "t.pdf")
    assert out.exit_code == 1
    assert message in out.output
    assert out.output.startswith("analyze: ")
    assert out.output.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_exclusive_options_are_wrong_usage(tmp_path):
    for arguments in (
        ("--object", "o.toml", "--ids", "3"),
        ("--board", "charuco", "--size-mm", "3"),
        ("--squares", "7x9"),
    ):
        assert run(*arguments, "-o", tmp_path / "t.pdf").exit_code == 2


def test_board_with_narrow_squares_is_refused():
    with pytest.raises(TagError, match="leave no white rim"):
        board_page(Board("5x5_100", 7, 9, 20.0, 18.0), "A4")


def test_boards_printed_origin_is_its_frames_origin():
    board = Board("5x5_100", 7, 9, 22.0, 15.4)
    page = board_page(board, "A4")
    assert page.origin == pytest.approx(
        (min(field.x for field in page.black), min(field.y for field in page.black))
    )
    first = corner_points(board)[0]  # beside the upper left square
    assert first == pytest.approx([0.022, 8 * 0.022, 0.0])
