"""`analyze archive object`: one object over its sessions, against the values from which rows were drawn."""

from __future__ import annotations

import json

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pytest
from click.testing import CliRunner

from analyze.batch.object_output import object_document, verdict_sentences
from analyze.batch.object_sessions import object_over_sessions
from analyze.batch.query import read_recording_rows
from analyze.batch.result_rows import SCHEMA
from analyze.cli import main
from analyze.errors import ArchiveError
from tests.analyze.batch.months_of_sessions import BETWEEN_SD_M, SHARED_SD_M, TRUE_COM_M, write_sessions

WEEKS = 12


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    output = tmp_path_factory.mktemp("results") / "out"
    write_sessions(output, WEEKS)
    return output


@pytest.fixture(scope="module")
def rows(results):
    return read_recording_rows(results).to_pylist()


def over_sessions(rows, name="salt"):
    texts = {row["key"]: row["result_json"] for row in rows if row.get("result_json")}
    return object_over_sessions(pa.Table.from_pylist(rows, schema=SCHEMA), name, lambda _: texts)


def quantity(found, name):
    return next(each for each in found.quantities if each.name == name)


def test_estimate_holds_what_sessions_were_drawn_from(rows):
    found = over_sessions(rows)
    assert len(found.sessions) == WEEKS
    for axis, true in zip("xyz", 1e3 * TRUE_COM_M, strict=True):
        each = quantity(found, f"centre of mass {axis}")
        assert each.shared_known
        assert each.shared_sd == pytest.approx(1e3 * SHARED_SD_M)
        assert abs(each.estimate.mean - true) < each.half
        low, high = each.estimate.between_interval
        assert low < 1e3 * BETWEEN_SD_M < high == each.between_high
        # 12 sessions share an error that no scatter shows.
        assert each.half > 2.5 * each.estimate.mean_half
    moment = quantity(found, "Ixx")
    assert not moment.shared_known
    assert moment.between_high > moment.estimate.between_interval[1]


def test_intervals_hold_with_an_error_that_all_sessions_share(rows):
    """Without the shared part, the mean of twelve sessions would be wrong by five of its sds."""
    rng = np.random.default_rng(8)
    own = [row for row in rows if row["object"] == "salt"]
    held, scatter_held, runs = 0, 0, 300
    for _ in range(runs):
        shared = SHARED_SD_M * rng.normal()
        drawn = [
            row
            | {"com_x_m": TRUE_COM_M[0] + shared + rng.normal(0, np.hypot(BETWEEN_SD_M, 8e-5))}
            | {"com_y_m": None, "com_z_m": None, "ixx_kg_m2": None, "iyy_kg_m2": None, "izz_kg_m2": None}
            for row in own
        ]
        (each,) = over_sessions(drawn).quantities
        away = abs(each.estimate.mean - 1e3 * TRUE_COM_M[0])
        held += away < each.half
        scatter_held += away < each.estimate.mean_half
    assert held / runs >= 0.93
    assert scatter_held / runs < 0.6


def test_sessions_that_agree_too_well_leave_an_upper_end_of_the_sd_between_them(rows):
    own = [row for row in rows if row["object"] == "salt"]
    alike = [row | {"com_x_m": 0.012 + 1e-6 * i} for i, row in enumerate(own)]
    each = quantity(over_sessions(alike), "centre of mass x")
    assert each.estimate.between_interval == (0.0, 0.0)
    assert each.estimate.scatter < each.between_high < 2 * each.estimate.scatter


def test_rows_without_the_shared_part_take_the_least_stated_sd_for_it(rows):
    older = [
        row | {f"com_shared_sd_{axis}_m": None for axis in "xyz"} | {"com_own_covariance_m2": None}
        for row in rows
    ]
    found = over_sessions(older)
    each = quantity(found, "centre of mass x")
    assert not each.shared_known
    assert each.shared_sd == pytest.approx(min(each.sd))
    assert found.joint is None
    covariance = (1e-8 * np.eye(3)).tolist()
    stored = [
        row | {"result_json": json.dumps({"centre_of_mass": {"covariance": covariance}})} for row in older
    ]
    joint = over_sessions(stored)
    assert joint.joint is not None
    assert joint.joint[1] == 3 * (WEEKS - 1)
    assert not joint.joint_own
    assert any("three components" in text for _, text in verdict_sentences(joint))


def test_sessions_count_once_and_by_their_object_file(rows):
    salt = [row for row in rows if row["object"] == "salt"]
    newer = salt[0] | {"url": "/rebased.mcap", "analysed_at": "2027-01-01T00:00:00Z", "com_x_m": 0.0125}
    other = salt[1] | {"object_sha256": "c" * 64, "url": "/other.mcap"}
    found = over_sessions([*salt, newer, other], "b" * 8)
    assert len(found.sessions) == WEEKS
    assert quantity(found, "centre of mass x").value[0] == 12.5
    assert found.others == (("c" * 64, 1),)
    with pytest.raises(
        ArchiveError, match=r"salt: 2 object files have that name: name one by its hash: bbbbbbbb"
    ):
        over_sessions([*salt, other])


def test_unknown_object_is_refused_with_the_known_ones(rows):
    message = r"^beans: no object of that name has a result; those that have: tea \[box\], salt$"
    with pytest.raises(ArchiveError, match=message):
        over_sessions(rows, "beans")


@pytest.mark.parametrize(("sessions", "words"), [(1, ["doubt", "repeat"]), (2, ["doubt"])])
def test_few_sessions_say_what_is_known(rows, sessions, words):
    found = over_sessions([row for row in rows if row["object"] == "salt"][:sessions])
    verdict = verdict_sentences(found)
    assert [word for word, _ in verdict][: len(words)] == words
    each = found.quantities[0]
    if sessions == 1:
        assert each.half == pytest.approx(1.96 * each.sd[0], rel=1e-3)
        assert found.joint is None
    document = json.loads(json.dumps(object_document(found), allow_nan=False))
    assert (document["quantities"][0]["between_sd"] is None) == (sessions == 1)


def test_sessions_that_scatter_more_than_they_state_are_doubted(rows):
    rng = np.random.default_rng(9)
    wild = [row | {"com_y_m": row["com_y_m"] + rng.normal(0, 8e-4)} for row in rows]
    doubts = [text for word, text in verdict_sentences(over_sessions(wild)) if word == "doubt"]
    assert any("times what they state (centre of mass y)" in text for text in doubts)
    assert not any(word == "doubt" for word, _ in verdict_sentences(over_sessions(rows)))


def test_odd_session_is_named(rows):
    salt = [dict(row) for row in rows if row["object"] == "salt"]
    salt[5]["com_z_m"] += 0.004
    (text,) = (text for word, text in verdict_sentences(over_sessions(salt)) if word == "repeat")
    assert "the session of 2025-10-06 (1-005.mcap) stands out; it moves the mean of centre of mass z" in text


@pytest.mark.parametrize("suffix", [".html", ".json", ".csv"])
def test_answer_is_saved_in_each_format(results, tmp_path, suffix):
    path = tmp_path / f"salt{suffix}"
    done = CliRunner().invoke(main, ["archive", "object", "salt", "--out", str(results), "--save", str(path)])
    assert done.exit_code == 0, done.output
    text = path.read_text(encoding="utf-8")
    if suffix == ".html":
        assert "centre of mass z" in text
        assert "nan" not in text
    elif suffix == ".json":
        assert json.loads(text)["quantities"][0]["n"] == WEEKS
    else:
        assert pc.read_csv(path).num_rows == 6
        assert pc.read_csv(tmp_path / "salt-sessions.csv").num_rows == 6 * WEEKS


def test_answer_on_the_terminal(results):
    done = CliRunner().invoke(main, ["archive", "object", "tea [box]", "--out", str(results)])
    assert done.exit_code == 0
    assert "tea [box] (aaaaaaaa), 12 sessions" in done.output
    assert "sd between sessions" in done.output
    assert "trust: 12 sessions agree within what they state" in done.output


def test_unknown_file_type_is_refused(results):
    done = CliRunner().invoke(main, ["archive", "object", "salt", "--out", str(results), "--save", "a.xlsx"])
    assert done.output == "analyze: a.xlsx: unknown file type '.xlsx': use .html, .json, .csv\n"
