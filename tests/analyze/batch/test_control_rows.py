"""Control charts of an archive: which rows they hold, what is reported, and what is written."""

from __future__ import annotations

import dataclasses

import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from analyze.batch.control_output import signal_text
from analyze.batch.query import read_recording_rows
from analyze.batch.result_rows import SCHEMA, read_rows, write_rows
from analyze.batch.rig_columns import rig_columns
from analyze.batch.stored_results import GATHERED
from analyze.batch.summary import summarise
from analyze.cli import main
from analyze.pipeline.estimate import EstimateOptions
from analyze.pipeline.read_evidence import read_evidence, read_head
from analyze.result.answer import answer_evidence
from tests.analyze.batch.months_of_sessions import ageing_rig, write_sessions
from tests.places import FIRST_SAMPLE

WEEKS = 40
RIG = "rig bench-a, camera CAM-1"


@pytest.fixture(scope="module")
def steady(tmp_path_factory):
    output = tmp_path_factory.mktemp("steady") / "out"
    write_sessions(output, WEEKS)
    return output


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    output = tmp_path_factory.mktemp("changed") / "out"
    write_sessions(output, WEEKS, ageing_rig)
    return output


def charts_of(output, **options):
    control = summarise(read_recording_rows(output), **options).control
    return control, {(each.subject, each.quantity): each for each in control.charts}


def test_rig_in_control_gives_no_more_signals_than_stated(steady):
    control, charts = charts_of(steady)
    assert {name for name, _ in charts} == {RIG, "salt (bbbbbbbb)", "tea [box] (aaaaaaaa)"}
    assert len(charts) == 5 + 2 * 6
    assert len(charts[RIG, "table tilt towards x"].created) == 2 * WEEKS
    assert len(control.out_of_control) <= control.expected_false_alarms
    assert control.missing == ()


def test_changes_of_the_rig_are_reported(changed):
    control, charts = charts_of(changed)
    tilt = charts[RIG, "table tilt towards x"]
    assert tilt.chart.drifted[-1]
    assert "drift since 2026-0" in signal_text(tilt)
    assert tilt.chart.centre == pytest.approx(0.0688, abs=0.01), "shown in degrees"
    speed = signal_text(charts[RIG, "striker speed over command"])
    assert "outside its limits on 2026-0" in speed
    assert "mean of the last 5 sessions −2.9 %" in speed
    assert "2026-02-02 (+" in signal_text(charts["salt (bbbbbbbb)", "centre of mass z"])
    assert control.out_of_control[0].severity == max(each.severity for each in control.charts)
    assert control.missing == ("1 session without a start time is in no chart",)


def test_new_camera_or_striker_starts_a_new_chart(changed, steady):
    _, charts = charts_of(changed)
    assert len(charts[RIG, "table tilt towards x"].created) == 2 * 30 - 1
    assert len(charts["rig bench-a, camera CAM-2", "table tilt towards x"].created) == 2 * 10
    rows = read_recording_rows(steady).to_pylist()
    for row in rows[: len(rows) // 2]:
        row["striker"] = "manual"
    other = pa.Table.from_pylist(rows, schema=SCHEMA)
    subjects = {each.subject for each in summarise(other).control.charts if each.of_rig}
    assert subjects == {f"{RIG}, striker manual", f"{RIG}, striker {rows[-1]['striker']}"}


def test_few_sessions_give_no_chart_and_say_so(tmp_path):
    write_sessions(tmp_path / "out", 3)
    control, _ = charts_of(tmp_path / "out")
    assert control.charts == ()
    assert control.missing == (
        f"{RIG} has no chart: 6 sessions of at least 8",
        "salt (bbbbbbbb) has no chart: 3 sessions of at least 8",
        "tea [box] (aaaaaaaa) has no chart: 3 sessions of at least 8",
    )


def test_baseline_may_be_chosen(steady):
    _, charts = charts_of(steady, baseline=30)
    assert charts[RIG, "table tilt towards x"].chart.baseline == 30


def test_versions_of_one_session_count_once(steady):
    rows = read_recording_rows(steady).to_pylist()
    copy = rows[3] | {"url": "/copy.mcap", "tilt_x_rad": 0.5, "analysed_at": "2026-12-01T00:00:00+00:00"}
    older = rows[3] | {"url": "/older.mcap", "tilt_x_rad": 0.7, "analysed_at": "2025-01-01T00:00:00+00:00"}
    cut = copy | {"url": "/cut.mcap", "strikes_recorded": 2, "analysed_at": "2027-01-01T00:00:00+00:00"}
    summary = summarise(pa.Table.from_pylist([copy, *rows, older, cut], schema=SCHEMA))
    (tilt,) = (each for each in summary.control.charts if each.quantity == "table tilt towards x")
    assert len(tilt.created) == 2 * WEEKS
    assert tilt.urls.count("/copy.mcap") == 1
    assert not {"/older.mcap", "/cut.mcap"} & {*tilt.urls}
    assert summary.objects[0][2] == WEEKS


def test_sessions_of_the_same_second_are_in_one_order(steady):
    rows = [row | {"created": "2026-01-01T00:00:00Z"} for row in read_recording_rows(steady).to_pylist()]
    forward, backward = (
        summarise(pa.Table.from_pylist(each, schema=SCHEMA)).control.charts for each in (rows, rows[::-1])
    )
    assert [each.urls for each in forward] == [each.urls for each in backward]


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_table_of_the_charts_holds_every_session(changed, tmp_path, suffix):
    done = CliRunner().invoke(
        main, ["batch", "--summary", "--out", str(changed), "--save", str(tmp_path / f"s{suffix}")]
    )
    assert done.exit_code == 0, done.output
    path = tmp_path / f"s-control{suffix}"
    table = pc.read_csv(path) if suffix == ".csv" else pq.read_table(path)
    control, _ = charts_of(changed)
    assert table.num_rows == sum(len(each.created) for each in control.charts)
    row = table.filter(pa.compute.field("outside")).to_pylist()[0]
    assert not row["low"] <= row["value"] <= row["high"]


def test_summary_on_the_terminal_and_as_a_page(changed, tmp_path):
    done = CliRunner().invoke(main, ["batch", "--summary", "--out", str(changed)])
    assert f"Out of control: {RIG}" in done.output
    assert "chance alone gives at most" in done.output
    assert "1 session without a start time is in no chart." in done.output
    page = tmp_path / "s.html"
    CliRunner().invoke(main, ["batch", "--summary", "--out", str(changed), "--save", str(page)])
    text = page.read_text(encoding="utf-8")
    assert "Control charts" in text
    assert text.count("<figure>") > 10


def test_baseline_without_summary_or_too_small_is_wrong_usage():
    for arguments, message in (
        (["--baseline", "12"], "--baseline needs --summary: add it"),
        (["--summary", "--baseline", "7"], "7 is not in the range x>=8"),
    ):
        done = CliRunner().invoke(main, ["batch", "a", *arguments])
        assert done.exit_code == 2
        assert message in done.output


def test_rows_of_older_versions_are_read_with_null_in_new_columns(steady, tmp_path):
    new = {"rig", "camera_serial", "striker", "range_ratio", "com_shared_sd_x_m", "com_own_covariance_m2"}
    rows = read_recording_rows(steady)
    old = rows.drop_columns(sorted(new))
    pq.write_table(old.slice(0, 3), tmp_path / "row.parquet")
    read = read_rows([tmp_path / "row.parquet"])
    assert read.schema.equals(SCHEMA)
    assert read["com_x_m"].equals(rows["com_x_m"].slice(0, 3))
    assert read["rig"].null_count == 3
    # Gathered rows of an older version count too, where the single files are gone.
    part = steady / GATHERED / "000000.parquet"
    part.parent.mkdir(exist_ok=True)
    pq.write_table(old, part)
    moved = (steady / "recordings").rename(steady / "gone")
    try:
        found = read_recording_rows(steady)
        assert found.num_rows == 2 * WEEKS
        assert found.schema.equals(SCHEMA)
        assert found["rig"].null_count == 2 * WEEKS
        assert found["com_x_m"].equals(rows["com_x_m"])
        control = summarise(found).control
        assert not any(each.of_rig for each in control.charts)
        assert len(control.charts) == 2 * 6
    finally:
        moved.rename(steady / "recordings")
        part.unlink()
    write_rows(rows.slice(0, 1), tmp_path / "row.parquet")
    assert read_rows([tmp_path / "row.parquet"]).equals(rows.slice(0, 1))


@pytest.fixture(scope="module")
def sample():
    return answer_evidence(read_evidence(read_head(FIRST_SAMPLE), None), EstimateOptions())


def test_columns_of_a_recording_of_the_virtual_rig(sample):
    """The virtual rig's camera, striker and clocks are as calibrated, commanded and nominal."""
    found = rig_columns(sample.estimate.evidence, sample.result)
    assert (found["rig"], found["camera_serial"]) == ("virtual", "VIRTUAL-1")
    assert found["striker"].startswith("dynamixel, ")
    assert found["range_ratio"] == pytest.approx(1.0, abs=0.003)
    assert 0 < found["range_ratio_sd"] < 0.003
    assert abs(found["rest_turn_rad"]) < 5e-4
    assert found["striker_speed_ratio"] == pytest.approx(1.0, abs=0.01)
    assert found["frame_rate_ratio"] == pytest.approx(1.0, abs=3e-4)
    assert found["tilt_x_rad"] is None, "assumed, not measured"
    assert set(found) <= set(SCHEMA.names)


def test_camera_farther_than_calibrated_shows_in_the_length_scale(sample):
    evidence = sample.estimate.evidence
    tracking = {
        name: dataclasses.replace(
            report,
            tracks=tuple(
                dataclasses.replace(track, p_camera_marker=1.01 * track.p_camera_marker)
                for track in report.tracks
            ),
        )
        for name, report in evidence.tracking.items()
    }
    moved = rig_columns(dataclasses.replace(evidence, tracking=tracking), sample.result)
    assert moved["range_ratio"] == pytest.approx(
        1.01 * rig_columns(evidence, sample.result)["range_ratio"], rel=1e-9
    )
