"""The benchmark reads reasons and remedy from a refusal's message, and keeps rows that are not made anew."""

from dataclasses import replace

from tests.benchmarks.world import Row, read_rows, reasons, remedy, write_rows

REFUSAL = """analyze: mug: no axis can be used; 8 axes rejected: 5 with a neighbour that may land before \
balance (at 4 to 22 deg), 3 slipping (friction needed 0.62 to 1.30): use a mat with more friction
note: several bodies: they are taken as one rigid object"""


def test_reasons_and_remedy_come_from_the_refusals_own_line():
    assert reasons(REFUSAL) == {"next_edge": 5, "slips": 3}
    assert remedy(REFUSAL) == "use a mat with more friction"
    assert reasons("analyze: x.stl: not a closed body (51 open edges): close the holes") == {"open_mesh": 0}


def test_rows_that_are_not_made_anew_are_kept(tmp_path):
    row = Row("mug", "kitchen", True, "cad", 10, 1.0, 2.0, "planned", 9, 0.3, "", "", "", "", 1.0, 1.0, 90.0)
    write_rows([row, replace(row, kind="scan")], tmp_path / "t.csv")
    newer = replace(row, outcome="refused", remedy="a, b")
    assert write_rows([newer], tmp_path / "t.csv") == [newer, replace(row, kind="scan")]
    assert read_rows(tmp_path / "t.csv") == [newer, replace(row, kind="scan")]
