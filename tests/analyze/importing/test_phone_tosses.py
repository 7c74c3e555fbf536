"""Phone videos of tosses with a rolling shutter, drawn by the independent renderer: from import to tensor."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from analyze.cli import main
from analyze.pipeline.read_evidence import read_evidence, read_head
from schemas.document import canonical_json
from schemas.object_spec import object_sha256, read_object_spec
from schemas.planned_toss import PlannedToss
from schemas.range import Range
from schemas.strike_plan import StrikePlan
from schemas.toss_result import TossVerdict
from tests import make_phone_videos as phone
from tests import phone_tosses
from tests.benchmarks.import_tosses import (
    SAMPLE,
    camera_text,
    film,
    imported_answer,
    run,
    scored,
    write_strike,
    write_toss,
)

OBJECT = SAMPLE / "teabox.toml"


def write_plan(folder: Path) -> Path:
    """Plan of three tosses and no strikes."""
    tosses = [
        PlannedToss(
            id=f"t{number}",
            spin_axis_object=list(np.array(axis) / np.linalg.norm(axis)),
            turns_per_s=Range(min=2, target=2.6, max=4),
            flight_s=Range(min=0.3, target=0.36, max=0.5),
            R_world_object=np.eye(3).tolist(),
            p_world_apex=[0.02, 0.3, 0.2],
        )
        for number, axis in enumerate(phone_tosses.SPINS, 1)
    ]
    spec = read_object_spec(OBJECT)
    plan = StrikePlan(
        object_name=spec.name, object_sha256=object_sha256(spec, None), strikes=[], tosses=tosses
    )
    path = folder / "tosses.json"
    path.write_text(canonical_json(plan), encoding="utf-8")
    return path


def write_camera(folder: Path, line_s: float | None) -> Path:
    """Camera file with the phone's pose, as from a board on the table."""
    R, eye = film().place
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R.T, eye
    path = folder / "placed.toml"
    path.write_text(camera_text(line_s) + f"T_world_camera = {T.tolist()}\n", encoding="utf-8")
    return path


def test_a_toss_alone_is_imported_and_good_though_the_shutter_rolls(tmp_path):
    """120 frames a second, from 30 ms before the release to 20 ms after the landing; no line time stated."""
    random = np.random.default_rng(3)
    motion = phone_tosses.tossed(phone_tosses.SPINS[0], random, air_s=0.34)
    start, end = motion.flight_s
    images = replace(film(), exposure_s=2.5e-4).images(motion.part(start - 0.03, end + 0.02), random, 120)
    phone.write_video(tmp_path / "t1.mp4", images, 120)
    run(
        *("import", "--toss", tmp_path / "t1.mp4", "--object", OBJECT, "--plan", write_plan(tmp_path)),
        *("--camera", write_camera(tmp_path, None), "-o", tmp_path / "tosses.mcap"),
    )
    (toss,) = read_evidence(read_head(tmp_path / "tosses.mcap")).tosses
    assert toss.verdict is TossVerdict.GOOD, toss.reason
    assert (toss.toss_id, toss.plan_toss_id) == ("t1.1", "t1")
    assert toss.flight is not None
    assert toss.flight.residual_px < 0.15


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "no video is named"),
        (("--toss", "a.mp4"), "tosses without strikes need the plan that was tossed"),
    ],
)
def test_tosses_without_strikes_need_a_plan(words, said, tmp_path):
    output = str(tmp_path / "o.mcap")
    done = CliRunner().invoke(main, ["import", *words, "--object", str(OBJECT), "-o", output])
    assert done.exit_code
    assert said in " ".join((done.output + done.stderr).split())


def test_tosses_without_strikes_need_a_placed_camera(tmp_path):
    phone.write_video(tmp_path / "t1.mp4", [np.full((phone.HEIGHT, phone.WIDTH), 90, np.uint8)] * 3)
    lens = tmp_path / "lens.toml"
    lens.write_text(camera_text(None), encoding="utf-8")
    with pytest.raises(RuntimeError, match="states no pose of the camera"):
        run(
            *("import", "--toss", tmp_path / "t1.mp4", "--object", OBJECT, "--plan", write_plan(tmp_path)),
            *("--camera", lens, "-o", tmp_path / "o.mcap"),
        )


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_strikes_and_tosses_of_a_phone_give_the_whole_tensor(tmp_path):
    """At 240 frames a second, with the delay from row to row stated and not; then the tosses alone."""
    strikes = [write_strike(tmp_path, number) for number in range(6)]
    tosses = [write_toss(tmp_path, 1, number) for number in range(3)]
    for line_s in (phone_tosses.LINE_S, None):
        answer = imported_answer(tmp_path, strikes, tosses, line_s)
        score = scored(answer, stated=line_s is not None)
        assert score.verdicts == ("good",) * 3
        assert np.abs(score.tensor).max() < 0.02
        assert np.abs(score.z).max() < 4
        assert np.linalg.norm(score.com) < 2e-4
        assert np.abs(score.com_z).max() < 4
    given = [word for path in tosses for word in ("--toss", path)]
    run(
        *("import", *given, "--object", OBJECT, "--plan", write_plan(tmp_path)),
        *("--camera", write_camera(tmp_path, None), "-o", tmp_path / "tosses.mcap"),
    )
    evidence = read_evidence(read_head(tmp_path / "tosses.mcap"))
    assert [toss.verdict for toss in evidence.tosses] == [TossVerdict.GOOD] * 3
