"""Queries and summaries of rows that are generated here, without recordings."""

from __future__ import annotations

import io
import json

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pytest
from scipy.special import stdtrit

from analyze.batch.ledger import Entry, Ledger
from analyze.batch.query import read_recording_rows, run_query
from analyze.batch.query_output import print_answer, save_answer
from analyze.batch.result_rows import SCHEMA, read_rows, write_row, write_rows
from analyze.batch.summary import summarise
from analyze.batch.summary_output import render_summary, save_summary
from analyze.errors import ArchiveError
from schemas.terminal import Terminal

DAYS, SCATTER_M, DRIFT_M = 12, 2e-4, 1.5e-4


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Twelve daily sessions of one object whose centre of mass drifts, and a recording without a result."""
    output = tmp_path_factory.mktemp("results")
    rng = np.random.default_rng(3)
    for name in ("recordings", "failures"):
        (output / name).mkdir()
    with Ledger(output, (1, 1), 1) as ledger:
        for day in range(DAYS):
            numbers = {f"com_{axis}_m": 0.01 + rng.normal(0, SCATTER_M) for axis in "xy"} | {
                "com_z_m": 0.02 + DRIFT_M * day
            }
            row = numbers | {
                "status": "ok",
                "key": f"k{day}",
                "url": f"/runs[a]/{day}.mcap",
                "object": "tea [box]",
                "object_sha256": "a" * 64,
                "created": f"2026-01-{1 + day:02d}T08:00:00+00:00",
                "com_observed": True,
                "strikes_recorded": 4,
                "strikes_used": 3,
                **{f"com_sd_{axis}_m": SCATTER_M for axis in "xyz"},
                "ixx_kg_m2": 2e-4,
                "ixx_sd_kg_m2": 1e-6,
                "ixx_measured": True,
                "iyy_kg_m2": 2e-4,
                "iyy_sd_kg_m2": 1e-6,
                "iyy_measured": False,
            }
            write_row(row, output / "recordings" / f"k{day}.parquet")
            ledger.add([Entry(row["url"], f"s{day}", "", "", f"k{day}", "", "", [])])
        failure = {
            "url": "/x.mcap",
            "source_id": "sx",
            "status": "failed",
            "failure": "cut",
            "reason": "/runs[a]/x.mcap: ends early",
        }
        write_row(failure, output / "failures" / "sx.parquet")
        ledger.add([Entry("/x.mcap", "sx", "", "", "", "cut", failure["reason"], [])])
    return output


def test_summary_reports_scatter_and_drift_of_results(results):
    found = summarise(read_recording_rows(results))
    assert found.recordings == DAYS
    assert found.objects == (("tea [box]", "a" * 64, DAYS, 4 * DAYS, 3 * DAYS, 0),)
    assert found.failures == (("cut", 1, "/runs[a]/x.mcap: ends early"),)
    by_name = {each.quantity: each for each in found.repeated}
    assert set(by_name) == {"centre of mass x", "centre of mass y", "centre of mass z", "Ixx"}, (
        "what came from the shape repeats for nothing"
    )
    assert by_name["centre of mass z"].drift == pytest.approx(1e3 * DRIFT_M)
    assert by_name["centre of mass x"].scatter == pytest.approx(1e3 * SCATTER_M, rel=0.6)
    assert by_name["centre of mass x"].mean == pytest.approx(10.0, abs=0.2)
    assert by_name["Ixx"].mean == pytest.approx(200.0)
    assert by_name["Ixx"].stated == pytest.approx(1.0)
    (outlier,) = found.standing_out
    assert (outlier.quantity, outlier.stands_out) == (
        "centre of mass z",
        "scatters 2.7 times as much as stated, drifts",
    )


def test_interval_of_the_drift_counts_only_sessions_with_a_start_time(results):
    rows = read_recording_rows(results)
    created = [text if i < 4 else None for i, text in enumerate(rows["created"].to_pylist())]
    dated = rows.set_column(rows.schema.get_field_index("created"), "created", pa.array(created, pa.string()))
    (found,) = (each for each in summarise(dated).repeated if each.quantity == "centre of mass z")
    assert found.sessions == DAYS
    assert found.drift_half / found.drift_sd == pytest.approx(stdtrit(4 - 2, 0.975))


@pytest.mark.parametrize("suffix", [".csv", ".html", ".parquet"])
def test_summary_is_saved_in_each_format(results, tmp_path, suffix):
    for path in save_summary(summarise(read_recording_rows(results)), tmp_path / f"s{suffix}"):
        assert path.stat().st_size


def test_printed_summary_contains_all_rows(results, capsys):
    render_summary(summarise(read_recording_rows(results)))
    printed = capsys.readouterr().out
    assert "tea [box]" in printed
    assert "/runs[a]/x.mcap: ends early" in printed
    assert "centre of mass z" in printed
    assert "no clock of a rig" not in printed
    rows, sources = read_recording_rows(results), ["device_mapped"] * (DAYS - 1) + ["container_pts", None]
    render_summary(
        summarise(
            rows.set_column(rows.schema.get_field_index("time_source"), "time_source", pa.array(sources))
        )
    )
    assert f"in 1 of {DAYS} sessions the frame times come from no rig's clock" in " ".join(
        capsys.readouterr().out.split()
    )
    assert max(len(line) for line in printed.splitlines() if "centre of mass" in line) <= 80
    print_answer(run_query(results, "select '[red]:smile:' as x"), "table")
    assert "[red]:smile:" in capsys.readouterr().out


def test_query_that_fails_while_it_runs_is_one_line(results):
    with pytest.raises(ArchiveError, match="Conversion Error") as caught:
        run_query(results, "select cast(object as int) from recordings where status = 'ok'")
    assert "\n" not in str(caught.value)


def test_equal_column_names_are_made_unique(results):
    answer = run_query(
        results, "select a.key, b.key from recordings a join recordings b using (key) order by 1 limit 1"
    )
    assert answer.to_pylist() == [{"key": "k0", "key_1": "k0"}]


def test_query_answer_as_json_and_csv(results, tmp_path, capsys):
    sql = (
        "select sum(strikes_used) as n, 'nan'::double as x, [1, 2] as l, interval 3 days as i, "
        "'\\xAA'::blob as b from recordings"
    )
    answer = run_query(results, sql)
    print_answer(answer, "json")
    row = json.loads(capsys.readouterr().out, parse_constant=pytest.fail)
    assert (row["n"], row["x"], row["l"]) == (3 * DAYS, None, [1, 2])
    save_answer(answer, tmp_path / "a.csv")
    row = pc.read_csv(tmp_path / "a.csv").to_pylist()[0]
    assert row["n"] == 3 * DAYS
    assert row["l"] == "[1, 2]"


WIDE = pa.table(
    {f"column_{i}": ["s3://archive/2026-11-23/carton-17.mcap", "[level]"] for i in range(12)} | {"n": [1, 2]}
)


@pytest.mark.parametrize(("columns", "width"), [(2, 80), (4, 80), (4, 70), (12, 80), (12, 40), (12, 300)])
def test_query_answer_fits_the_terminal_and_nothing_is_cut(columns, width):
    out = io.StringIO()
    names = [f"column_{i}" for i in range(columns)] + ["n"]
    print_answer(WIDE.select(names), "table", Terminal(file=out, width=width))
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    assert "…" not in out.getvalue()
    assert lines[-1] == "2 rows"
    by_row = columns == 12 and width < 300
    assert ("row 2" in out.getvalue()) == by_row
    for name in names:
        assert (
            sum(line.split()[:1] == [name] for line in lines) == 2
            if by_row
            else any(name in line for line in lines)
        )


@pytest.mark.parametrize("damage", ["cut", "zeros", "text"])
def test_damaged_row_file_is_named(tmp_path, damage):
    path = tmp_path / "row.parquet"
    write_rows(pa.Table.from_pylist([{"key": "a", "url": "b.mcap"}], schema=SCHEMA), path)
    data = path.read_bytes()
    damaged = {
        "cut": data[:20],
        "zeros": data[:4] + bytes(400) + data[404:],
        "text": data.replace(b"b.mcap", b"\xff.mcap"),
    }
    path.write_bytes(damaged[damage])
    with pytest.raises(ArchiveError, match=r"row\.parquet: damaged: remove it"):
        read_rows([path])
