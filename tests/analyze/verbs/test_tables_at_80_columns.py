"""Tables of the terminal can be read at 80 columns: no longer line, no broken or cut heading or number."""

from __future__ import annotations

import ast
import copy
import io
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from click.testing import CliRunner
from rich.table import Table

import schemas.terminal
from acquire.console.strike import _print_swing_ratio
from acquire.striker.calibration import MeasuredSwing, swing_ratio
from analyze.batch.query_output import print_answer
from analyze.cli import main
from analyze.importing.table import render_import
from analyze.predict.document import render_predictions
from analyze.reading.recording import open_recording
from analyze.report.summary import render_summary
from analyze.reproduce.cube_tosses_figure import render_cube
from analyze.reproduce.paper.targets import targets_table
from analyze.reproduce.paper.terminal import render_table
from analyze.reproduce.planar_impacts_table import render_impacts
from analyze.result.answer import answer_evidence
from analyze.result.score import render_score
from analyze.verbs.cache import _render as render_cache
from analyze.verbs.calibrate.table import render_calibration
from analyze.verbs.parts import render_bodies
from analyze.verbs.plan.table import render_plan
from analyze.verbs.rebase.table import render_rebase
from analyze.verbs.register.table import render_registration
from schemas.predictions import (
    AngleErrorResult,
    AssetErrors,
    PredictedStrikeResult,
    PredictionsResult,
    SkippedStrikeResult,
)
from schemas.quantity import Quantity
from schemas.result import Filling, PartResult, Parts
from schemas.terminal import Terminal
from tests.analyze.reproduce.test_planar_impacts import analysed
from tests.analyze.simulated_session import carton, session
from tests.analyze.verbs.archive_tables import ARCHIVE_TABLES
from tests.places import RECORDINGS, ROOT

COLUMNS = 80
NUMBER = re.compile(r"[+\-−±–<>]?\d[\d.,%]*")
SAMPLE = RECORDINGS / "sample-1.0.mcap"
STRIKES = ["s1.1", "s2.1", "s10.2"]


def faults(table: Table) -> list[str]:
    """Faults of a table printed 80 columns wide: longer lines, and words or numbers cut or broken."""
    out = io.StringIO()
    Terminal(file=out, width=COLUMNS).print(copy.deepcopy(table))
    shown = set(re.split(r"[\s│┃]+", out.getvalue()))
    return [line for line in out.getvalue().splitlines() if len(line) > COLUMNS] + [
        f"{word}: broken\n{out.getvalue()}" for word in _words(table) if word not in shown
    ]


def _words(table: Table) -> Iterator[str]:
    """Words of the headings, and numbers of the cells."""
    for column in table.columns:
        yield from str(column.header).split() if table.show_header else ()
        for cell in column.cells:
            yield from (word for word in str(cell).split() if NUMBER.fullmatch(word))


def show_estimate() -> None:
    answer = answer_evidence(session(carton(), np.random.default_rng(3), repeats=1))
    mass = Quantity(value=0.1234, unit="kg", sd=0.01, interval95=[0.1034, 0.1434])
    density = Quantity(value=1234.5, unit="kg/m^3", sd=120.0, interval95=[999.1, 1470.0])
    level = Quantity(value=0.034, unit="m", sd=0.001, interval95=[0.032, 0.036])
    part = PartResult(name="handle", mass=mass, volume_m3=1e-4, density=density)
    parts = Parts(parts=[part, part.model_copy(update={"name": "rest"})], uniform=[0.12, 0.3], misfit=1.0)
    filling = Filling(
        name="sugar",
        along=(0, 0, 1),
        level=level,
        filled_share=level,
        mass=mass,
        density=density,
        shell=mass,
        misfit=1.0,
    )
    result = answer.result.model_copy(update={"parts": parts, "filling": filling})
    render_summary(replace(answer, result=result))


def show_score() -> None:
    numbers = {"phi_true_rad": 0.6, "phi_error_rad": -0.001, "i_edge_relative_error": 0.0123}
    score: dict[str, Any] = {name: [value] * 3 for name, value in numbers.items()}
    score |= {"strike_ids": STRIKES, "region_mass_error_relative": None, "centre_of_mass_error_m": 0.001}
    score |= {"centre_of_mass_true_m": [0.1, 0.0, 0.0], "centre_of_mass_error_vector_m": [0.0, 0.0, 0.001]}
    score |= dict.fromkeys(("centre_of_mass_interval95_m", "centre_of_mass_unobserved_direction"))
    render_score(score | {"centre_of_mass_paper_error_m": 0.01})


def show_plan(by_hand: bool = False) -> None:
    with open_recording(SAMPLE) as recording:
        plan = recording.plan
    assert plan is not None
    strikes = [each.model_copy(update={"id": f"s{number}"}) for number, each in enumerate(plan.strikes, 8)]
    render_plan(plan.model_copy(update={"strikes": strikes}), by_hand=by_hand)


def show_registration() -> None:
    place = SimpleNamespace(
        marker_id=123,
        strikes=STRIKES * 2,
        undetermined=(),
        on_surface=True,
        place_sd=1e-4,
        turn_sd=1e-3,
        rms_px=0.123,
        T_object_marker=np.diag([1.0, 1, 1, 1]) + 0.1234 * np.eye(4, k=3),
    )
    answer = SimpleNamespace(
        registration=SimpleNamespace(markers=[place, place], tables=[]),
        given={123: np.eye(4)},
        evidence=SimpleNamespace(spec=SimpleNamespace(name="tea box")),
        unused=[],
    )
    render_registration(answer)


def show_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    corners = np.array([[0.0, 0, 0], [0.2, 0, 0], [0, 0.1, 0], [0, 0, 0.3]])
    body = SimpleNamespace(
        vertices=corners,
        faces=np.array([[0, 1, 2], [0, 1, 3]]),
        open_edges=12,
        filled_edges=0,
        properties=SimpleNamespace(volume=1.2345e-3, centroid=np.array([0.1234, -0.0567, 0.1])),
    )
    monkeypatch.setattr("analyze.geometry.bodies.overlaps_of", lambda _: [])
    label = SimpleNamespace(name="long handle of wood", bodies=[1, 2])
    files = SimpleNamespace(shape_name="hammer.glb", spec=SimpleNamespace(labels=[label]))
    render_bodies(files, [body, body])


def show_cache() -> None:
    entry = SimpleNamespace(
        path=Path("a"),
        label="estimate of my-long-session-name-2026-01-01.mcap, 12 strikes",
        size_bytes=123456,
        used=1.7e9,
    )
    render_cache([entry])


def show_import(found: bool = False) -> None:
    onset = SimpleNamespace(markers=(0, 12), time_ns=12_340_000_000)
    clip = SimpleNamespace(
        path=Path("VID_20260101_123456789_slowmotion.mp4"), onsets=[onset, onset], last_ns=15_000_000_000
    )
    windows = [
        SimpleNamespace(
            strike_id=name, plan_strike_id="s1", clip=0, onset=onset, start_ns=0, end_ns=14 * 10**9
        )
        for name in STRIKES
    ]
    planned = SimpleNamespace(id="s1", visible_markers=(3,))
    if found:
        with open_recording(SAMPLE) as recording:
            assert recording.plan is not None
            planned, spec = recording.plan.strikes[0], recording.manifest.object
        axis = SimpleNamespace(id=planned.axis_id, plane=SimpleNamespace(up=np.array([0.0, 0.0, 1.0])))
        fit = SimpleNamespace(tip=SimpleNamespace(axis=axis), angle=0.2, lean=0.01, offset=0.012)
        match = SimpleNamespace(best=fit, following=fit)
    render_import(
        SimpleNamespace(
            sources=[clip],
            windows=windows,
            clips=[clip],
            was_split=False,
            plan=SimpleNamespace(strikes=[planned]),
            assignment=SimpleNamespace(value="by the tags"),
            rate_hz=120.0,
            formats="H.264",
            place=SimpleNamespace(deviation_rad=0.01, deviation_m=0.001, views=3),
            mat=SimpleNamespace(turn_sd=0.001, place_sd=0.001, paper="A4x3", views=3),
            tosses=[SimpleNamespace(name="a long name of a video of the first toss.mp4")] * 3,
            remarks=list,
            found=[SimpleNamespace(strike_id=name, match=match, heading=-3.1) for name in STRIKES]
            if found
            else None,
            object=SimpleNamespace(spec=spec if found else None),
        )
    )


def show_rebase() -> None:
    change = SimpleNamespace(
        entry="marker.3.T_object_marker", before="0.1234 kg", after="0.2345 kg", effect="places of tags"
    )
    shift = SimpleNamespace(
        strike_id="s10.2", axis_id="p12e10", shift_m=1e-3, allowed_m=3.4e-4, turn_rad=0.01, allowed_rad=0.002
    )
    spec = SimpleNamespace(name="tea box")
    render_rebase(
        SimpleNamespace(changes=(change, change), shifts=(shift, shift), files=SimpleNamespace(spec=spec))
    )


def show_calibration() -> None:
    names = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
    lens = SimpleNamespace(
        model=SimpleNamespace(value="pinhole"),
        width=1920,
        height=1080,
        names=names,
        numbers=np.full(9, 1430.123),
    )
    found = SimpleNamespace(
        lens=lens,
        shots=[SimpleNamespace(view=SimpleNamespace(place=[0] * 40))] * 15,
        sd=np.full(9, 0.123),
        rms_px=0.1,
        covered=SimpleNamespace(share=0.8),
        tilts=[0.2, 0.7],
        pixels=SimpleNamespace(median=0.1, worst=0.9, worst_at=(0.0, 0.0)),
    )
    place = SimpleNamespace(T_world_camera=np.eye(4), position_sd=np.full(3, 1e-3), turn_sd=np.full(3, 1e-3))
    board = SimpleNamespace(square_mm=30.0)
    render_calibration(
        SimpleNamespace(
            calibration=found,
            place=place,
            alike=0,
            surplus=0,
            without_board=[],
            dropped=[],
            doubts=[],
            options=SimpleNamespace(board=board, mat=None),
            rig=None,
            rig_place=None,
            looked_at=15,
        )
    )


def show_query() -> None:
    print_answer(
        pa.table({"object": ["tea box"], "count_star()": [12], "stddev(com_z_m)": [0.000123456]}), "table"
    )


def show_cube() -> None:
    body = SimpleNamespace(
        contacts=123,
        com=np.full(3, 1e-4),
        half_width=np.full(10, 1e-4),
        inertia=np.eye(3) * 1.7e-3,
        covariance=1e-10 * np.eye(10),
        freedom=np.full(10, 40.0),
        rounding=1e-3,
        flights=456,
        gravity=9.8,
    )
    render_cube(
        SimpleNamespace(
            tosses=570,
            frames=123456,
            flight=body,
            rotation=SimpleNamespace(
                ratios=np.array([1.02, 1.02, 0.96, 0.0, 0.0, 0.0]),
                covariance=1e-5 * np.eye(6),
                freedom=np.full(6, 40.0),
            ),
            edges=body,
            corners=body,
            scale=1.01,
            slides_m=np.full(3, 0.01),
            edge_minus_flight=(np.array([1e-4, 0, 0]), np.eye(3) * 1e-9),
            edge_minus_flight_freedom=np.full(3, 50.0),
        )
    )


def show_inspection() -> None:
    assert CliRunner().invoke(main, ["inspect", str(SAMPLE)]).exit_code == 0


def show_swings() -> None:
    swings = [MeasuredSwing(command, 1.01 * command, 1e-4) for command in (0.05, 0.4) for _ in range(2)]
    _print_swing_ratio(swings, swing_ratio(swings))


def show_predictions() -> None:
    error = AngleErrorResult(rms_rad=0.012, largest_rad=0.41)
    errors = AssetErrors(estimated=error, uniform=error, shell=error)
    strike = PredictedStrikeResult(
        strike_id="s12.3", frames=138, seconds=0.61, friction=0.35, friction_is_bound=True, errors=errors
    )
    skipped = SkippedStrikeResult(strike_id="s13.1", reason="too few frames of free motion")
    render_predictions(
        PredictionsResult(object="tea box", strikes=[strike], skipped=[skipped], median=errors)
    )


SHOWN: dict[str, Callable[..., None]] = {
    "analyze.predict.document": show_predictions,
    "analyze.report.summary": show_estimate,
    "analyze.result.score": show_score,
    "analyze.verbs.plan.table": show_plan,
    "analyze.verbs.rebase.table": show_rebase,
    "analyze.verbs.register.table": show_registration,
    "analyze.verbs.parts": show_parts,
    "analyze.verbs.cache": show_cache,
    "analyze.importing.table": show_import,
    "analyze.verbs.calibrate.table": show_calibration,
    "analyze.batch.query_output": show_query,
    **ARCHIVE_TABLES,
    "analyze.reproduce.cube_tosses_figure": show_cube,
    "analyze.reproduce.planar_impacts_table": lambda: render_impacts(analysed()),
    "analyze.reproduce.paper.terminal": lambda: render_table(targets_table([])),
    "analyze.verbs.inspect.table": show_inspection,
    "acquire.console.strike": show_swings,
}
"""modules that make tables for the terminal, and what makes them print these"""


@pytest.mark.parametrize("module", SHOWN)
def test_tables(module: str, monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[Table] = []
    fold = schemas.terminal.fold_cells

    def noted(table: Table, console: Terminal) -> None:
        printed.append(copy.deepcopy(table))
        fold(table, console)

    monkeypatch.setattr("schemas.terminal.fold_cells", noted)
    show = SHOWN[module]
    show(*[monkeypatch] * (show is show_parts))
    monkeypatch.setattr("schemas.terminal.fold_cells", fold)
    assert printed
    assert [fault for table in printed for fault in faults(table)] == []


def test_strikes_by_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SHOWN, "by hand", lambda: show_plan(by_hand=True))
    test_tables("by hand", monkeypatch)


def test_strikes_that_nobody_planned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SHOWN, "found", lambda: show_import(found=True))
    test_tables("found", monkeypatch)


def test_a_broken_heading_is_a_fault() -> None:
    table = Table(*(f"heading{number}-that-is-long" for number in range(5)))
    table.add_row(*["12345"] * 5)
    assert faults(table)


def test_every_module_that_makes_tables_is_shown() -> None:
    named = {"Table", "RichTable"}
    makers = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for package in ("analyze", "acquire", "schemas")
        for path in (ROOT / package).rglob("*.py")
        if "rich.table" in (text := path.read_text(encoding="utf-8"))
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in named
    }
    assert makers == set(SHOWN)
