"""Editing entries of a TOML file keeps comments, layout and all other entries."""

import tomllib

import pytest

from schemas.toml_table import with_entry, with_entry_in_each, with_table

TEXT = """# bench
name = "b"

[camera]
address = "x"  # ours

[camera.calibration]  # of the region
K = [
  [1, 2],
  [3, 4],
]
old = 1

# below
[striker]
kind = "manual"
"""


def test_only_the_named_table_changes():
    new = with_table(TEXT, "camera.calibration", {"K": "[[5, 6], [7, 8]]", "rms_px": "0.1"})
    assert new == TEXT.replace(
        "K = [\n  [1, 2],\n  [3, 4],\n]\nold = 1\n", "K = [[5, 6], [7, 8]]\nrms_px = 0.1\n"
    )


def test_missing_table_is_added_at_the_end():
    new = with_table('[camera]\naddress = "x"', "camera.calibration", {"a": "1"})
    assert new == '[camera]\naddress = "x"\n\n[camera.calibration]\na = 1\n'


@pytest.mark.parametrize(
    "text", ["[camera]\ncalibration = { a = 1 }\n", "camera.calibration.a = 1\n", "camera = 3\n", "not toml"]
)
def test_table_in_another_notation_is_changed_correctly_or_not_at_all(text):
    new = with_table(text, "camera.calibration", {"a": "2"})
    assert new is None or tomllib.loads(new)["camera"]["calibration"] == {"a": 2}


OBJECT = """name = "box"  # mine
[[marker]] # +x side
id = 3
pose = [
    [1, 0],  # in the file
    [0, 1],
]

# the other
[[marker]]
id = 4
"""


def test_an_entry_is_written_into_some_of_the_tables_of_an_array():
    text = with_entry_in_each(OBJECT, "marker", "pose", {0: "[2]", 1: "[5]"})
    assert text is not None
    assert [(m["id"], m["pose"]) for m in tomllib.loads(text)["marker"]] == [(3, [2]), (4, [5])]
    assert "# mine" in text
    assert "# the other\n[[marker]]" in text
    assert "in the file" not in text


def test_array_not_written_as_tables_is_left_alone():
    assert with_entry_in_each("marker = [{ id = 1 }]\n", "marker", "pose", {0: "[2]"}) is None
    assert with_entry_in_each(OBJECT, "marker", "pose", {2: "[2]"}) is None


def test_one_entry_of_a_table_is_written_and_the_others_stay():
    assert with_entry(TEXT, "camera.calibration", "K", "[[5]]") == TEXT.replace(
        "K = [\n  [1, 2],\n  [3, 4],\n]\nold = 1\n", "K = [[5]]\nold = 1\n"
    )
    assert with_entry(TEXT, "camera", "name", '"c"') == TEXT.replace(
        '"x"  # ours\n', '"x"  # ours\nname = "c"\n'
    )
    assert with_entry(TEXT, "level", "a", "1") is None
    assert with_entry("[camera]\ncalibration = { a = 1 }\n", "camera.calibration", "a", "2") is None


def test_added_table_can_be_edited_again():
    first = with_table('[camera]\naddress = "x"\n\n[striker]\nid = 1\n', "camera.calibration", {"a": "1"})
    assert first is not None
    second = with_table(first, "camera.calibration", {"a": "2", "b": "[3, 4]"})
    assert second == first.replace("a = 1\n", "a = 2\nb = [3, 4]\n")
    assert with_entry(second, "camera.calibration", "a", "5") == second.replace("a = 2", "a = 5")
