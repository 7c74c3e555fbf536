"""Inspection reports the counts, rates, gaps and losses that were written."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from analyze.errors import RecordingError
from analyze.verbs.inspect.recording import inspect_recording
from analyze.verbs.inspect.table import render_inspection
from schemas.document import canonical_json
from schemas.strike_plan import StrikePlan
from schemas.terminal import Terminal
from tests import small_recording as small
from tests.analyze.motion.tipping import planned


def test_counts_rates_and_gaps(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap", missing=(10, 11))
    found = inspect_recording(tmp_path / "a.mcap")
    json.dumps(found, allow_nan=False)
    by_name = {topic["name"]: topic for topic in found["topics"]}
    image = by_name["/camera/main/image"]
    assert image["count"] == small.FRAMES - 2
    assert image["longest_gap_s"] == pytest.approx(3 * small.PERIOD_NS * 1e-9)
    assert by_name["/striker/sample"]["rate_hz"] == pytest.approx(1000.0)
    assert by_name["/session/strike"]["rate_hz"] is None
    camera = found["cameras"][0]
    assert (camera["frames"], camera["lost"], camera["images"], camera["meta_missing"]) == (
        small.FRAMES,
        0,
        small.FRAMES - 2,
        0,
    )
    assert camera["rate_hz"] == pytest.approx(120.0, abs=0.01)
    assert camera["arrival_delay_s"] == pytest.approx(0.002)
    assert found["strikes"][0]["images_missing"] == 2
    assert found["strikes"][0]["verdict"] == "good"
    clock = found["clocks"][0]
    assert (clock["clock"], clock["samples"]) == ("camera/main", 2)
    assert clock["drift_ppm"] == pytest.approx(0.0, abs=1e-6)
    assert clock["round_trip_s"] == pytest.approx(100e-6)
    assert found["complete"] is True
    assert found["duration_s"] == pytest.approx(small.FRAMES * small.PERIOD_NS * 1e-9)


def test_cut_recording_is_inspected_and_called_cut(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    data = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(data[:-3000])
    found = inspect_recording(tmp_path / "a.mcap")
    json.dumps(found, allow_nan=False)
    assert found["complete"] is False
    text = io.StringIO()
    render_inspection(found, Terminal(file=text, width=160))
    assert "cut short" in text.getvalue()
    assert "/camera/main/image" in text.getvalue()


def test_reasons_of_verdicts_wrap_and_are_complete(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    found = inspect_recording(tmp_path / "a.mcap")
    reason = "tipped over at 36.97 deg, energy ratio 1.19: the next strike may be softer"
    found["strikes"] = [{**each, "verdict_text": reason} for each in found["strikes"]]
    assert found["strikes"]
    text = io.StringIO()
    render_inspection(found, Terminal(file=text, width=80))
    assert all(word in text.getvalue() for word in reason.split())
    assert "…" not in text.getvalue()


def test_topic_names_are_complete_on_80_columns(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    found = inspect_recording(tmp_path / "a.mcap")
    text = io.StringIO()
    render_inspection(found, Terminal(file=text, width=80))
    for topic in found["topics"]:
        assert f"\n{topic['name']} " in text.getvalue()
    assert "…" not in text.getvalue()


def test_an_empty_session_is_inspected(tmp_path: Path) -> None:
    from tests.mcap_writer import McapWriter

    with McapWriter(tmp_path / "a.mcap") as writer:
        small.write_head(writer)
    found = inspect_recording(tmp_path / "a.mcap")
    json.dumps(found, allow_nan=False)
    assert found["topics"] == []
    render_inspection(found, Terminal(file=io.StringIO()))
    with pytest.raises(RecordingError):
        inspect_recording(tmp_path / "missing.mcap")


def _planned(*names: str) -> bytes:
    strikes = [planned().model_copy(update={"id": name}) for name in names]
    return canonical_json(StrikePlan(object_name="box", object_sha256="0", strikes=strikes)).encode()


def _rendered(path: Path) -> str:
    text = io.StringIO()
    render_inspection(inspect_recording(path), Terminal(file=text, width=400))
    return text.getvalue()


def test_interrupted_session_is_not_called_complete(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap", plan=_planned("s1", "s2", "s3"))
    found = inspect_recording(tmp_path / "a.mcap")
    assert found["complete"] is True  # the file
    assert found["plan"] == {"planned": ["s1", "s2", "s3"], "missing": ["s2", "s3"]}
    text = _rendered(tmp_path / "a.mcap")
    assert "intact file" in text
    assert " complete" not in text
    assert (
        "1 of 3 planned strikes were struck; missing: s2, s3: `analyze plan OBJECT.toml --given a.mcap`"
        in text
    )


def test_finished_session_is_called_complete(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap", plan=_planned("s1"))
    text = _rendered(tmp_path / "a.mcap")
    assert ", complete" in text
    assert "1 of 1 planned strike was struck\n" in text


def test_recording_without_a_readable_plan_is_inspected(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap")
    assert inspect_recording(tmp_path / "a.mcap")["plan"] is None
    assert "planned strikes" not in _rendered(tmp_path / "a.mcap")


def test_many_missing_strikes_are_counted(tmp_path: Path) -> None:
    small.write_recording(tmp_path / "a.mcap", plan=_planned(*(f"s{number}" for number in range(1, 31))))
    assert "missing: s2, s3, s4, s5, s6, s7, s8, s9, s10, s11, s12, s13 and 17 more" in _rendered(
        tmp_path / "a.mcap"
    )
