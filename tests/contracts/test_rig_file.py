"""`analyze plan` and `acquire` interpret one rig file alike.

The striker accepts every planned strike, and `analyze plan` refuses each rig file that `acquire` refuses.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from acquire.config import read_rig
from acquire.errors import ConfigError
from analyze.errors import PlanError
from analyze.geometry.object_model import load_object_model
from analyze.planning import view
from analyze.planning.examine import Bench
from analyze.planning.impact import StrikerModel
from analyze.planning.paper_strikes import paper_strike_plan
from analyze.planning.plan import PlanRequest, plan_strikes
from analyze.planning.prepared import PreparedObject, prepare_object
from analyze.verbs.plan.rig import planned_rig, striker_model
from schemas.rig import StrikerConfig
from schemas.servo_models import UNMEASURED_MASS_SD_KG
from tests.analyze.geometry.shapes import spec_of
from tests.analyze.planning.random_bodies import FAR_TAG

RIG = """{top}
[camera]
address = "10.0.0.2"
{camera}
[camera.calibration]
width = 656
height = 492
K = [[1430, 0, 327.5], [0, 1430, 245.5], [0, 0, 1]]
T_world_camera = [[1, 0, 0, 0.03], [0, 0, 1, -0.55], [0, -1, 0, 0.08], [0, 0, 0, 1]]
{calibration}
[striker]
{striker}
[recorder]
{recorder}
[daemon]
{daemon}
"""
SECTIONS = ("top", "camera", "calibration", "striker", "recorder", "daemon")


def rig_file(path: Path, **sections: str) -> Path:
    path.write_text(RIG.format(**(dict.fromkeys(SECTIONS, "") | sections)), encoding="utf-8")
    return path


def accepts(config: StrikerConfig, speed: float) -> bool:
    """True if a striker of this configuration accepts a tip speed [m/s]."""
    return not config.tip_speeds().problem(speed)


def test_without_a_rig_file_plans_are_for_the_nominal_striker() -> None:
    nominal = StrikerModel(effective_mass_sd_kg=UNMEASURED_MASS_SD_KG)
    assert striker_model(StrikerConfig()) == nominal
    assert planned_rig(None).bench.striker == nominal


@pytest.mark.parametrize(
    ("stated", "sd_kg"),
    [
        ("", UNMEASURED_MASS_SD_KG),
        ("effective_mass_kg = 0.2", 0.05),
        ("effective_mass_sd_kg = 0.07", 0.07),
        ("effective_mass_kg = 0.2\neffective_mass_sd_kg = 0.004", 0.004),
    ],
)
def test_only_a_striker_that_nobody_measured_has_the_wide_effective_mass(
    stated: str, sd_kg: float, tmp_path: Path
) -> None:
    path = rig_file(tmp_path / "rig.toml", striker=stated)
    assert read_rig(path).striker.effective_mass_sd_kg == sd_kg
    assert planned_rig(path).bench.striker.effective_mass_sd_kg == sd_kg
    assert planned_rig(path).bench.striker.effective_mass_kg == 0.2


def test_the_limits_by_hand(tmp_path: Path) -> None:
    """Fastest tip speed by hand: 0.3 rad in 0.06 s, 5 rad/s, below the limit of 8 rad/s; times 50 mm."""
    path = rig_file(tmp_path / "rig.toml", striker="arm_length_m = 0.05\ncocked_angle_rad = -0.3")
    striker = planned_rig(path).bench.striker
    assert striker.fastest_m_s == pytest.approx(0.25)
    assert striker.slowest_m_s == pytest.approx(0.025)


@given(
    st.floats(0.01, 2.0),
    st.floats(-2.5, -0.04),
    st.floats(0.6, 24.5),
    st.floats(0.0, 1.0),
)
def test_every_speed_within_the_limits_is_accepted(
    arm: float, cocked: float, limit: float, share: float
) -> None:
    config = StrikerConfig(arm_length_m=arm, cocked_angle_rad=cocked, velocity_limit_rad_s=limit)
    model = striker_model(config)
    low, high = model.slowest_m_s, model.fastest_m_s
    assume(low < high)  # a motor of 1 A does not swing an arm of 2 m
    for speed in (
        low,
        high,
        low + share * (high - low),
        math.nextafter(low, 0),
        math.nextafter(high, math.inf),
        math.nan,
        math.inf,
    ):
        assert accepts(config, speed) == (not model.too_fast_or_slow(speed))


@pytest.fixture(scope="module")
def prepared() -> PreparedObject:
    """A box prepared for planning, independent of striker and rig."""
    spec = spec_of({"box": {"size_m": [0.08, 0.06, 0.15]}}, markers=[FAR_TAG])
    model = load_object_model(spec, None, "")
    return prepare_object(model, spec, Bench(StrikerModel(), view.default_camera(), 0.5))


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))]
)
def test_every_speed_of_a_plan_is_accepted(prepared: PreparedObject, seed: int) -> None:
    rng = np.random.default_rng((seed, 0x5A11))
    config = StrikerConfig(
        arm_length_m=rng.uniform(0.04, 0.3),
        cocked_angle_rad=-rng.uniform(0.2, 1.2),
        velocity_limit_rad_s=rng.uniform(3, 10),
        effective_mass_kg=rng.uniform(0.05, 0.5),
    )
    bench = replace(prepared.bench, striker=striker_model(config))
    mine = prepare_object(prepared.model, prepared.spec, bench)
    strikes, refused = [], ""
    try:
        strikes = plan_strikes(mine, "0" * 64, PlanRequest(6)).strikes
    except PlanError as error:
        refused = str(error)
    assert strikes or "speed" in refused
    for strike in strikes:
        speeds = strike.tip_speed_m_s
        assert all(accepts(config, speed) for speed in (speeds.min, speeds.target, speeds.max))
    papers = paper_strike_plan(mine, "0" * 64, 9)
    too_fast = {each.axis_id for each in papers.rejected if each.code == "speed"}
    for strike in papers.strikes:
        speeds = strike.tip_speed_m_s
        taken = [accepts(config, speed) for speed in (speeds.min, speeds.target, speeds.max)]
        assert all(taken) if strike.axis_id not in too_fast else not taken[1]


@pytest.mark.parametrize("section", SECTIONS)
def test_an_unknown_key_is_refused_by_both(tmp_path: Path, section: str) -> None:
    path = rig_file(tmp_path / "rig.toml", **{section: "table_fricton = 0.6"})
    with pytest.raises(ConfigError, match=r"unknown key '.*table_fricton'") as daemons:
        read_rig(path)
    with pytest.raises(PlanError) as plans:
        planned_rig(path)
    assert str(plans.value) == str(daemons.value)


@pytest.mark.parametrize(
    ("section", "line"),
    [
        ("top", "table_friction = 0"),
        ("top", "g_m_s2 = 98.1"),
        ("striker", "restitution = 1.2"),
        ("striker", "cocked_angle_rad = 0.3"),
        ("striker", "cocked_angle_rad = -3"),
        ("camera", "gain_db = 3\ngain_raw = 200"),
        ("striker", "current_limit_a = 50"),
        ("striker", "velocity_limit_rad_s = 100"),
        ("striker", "temperature_limit_c = 5000"),
        ("striker", "arming_expires_s = 1e9"),
        ("striker", "zero_position = -7"),
        ("striker", "reach_m = [0.3, 0.1]"),
        ("striker", "effective_mass_kg = nan"),
        ("camera", "frame_rate_hz = 0"),
        ("recorder", 'mode = "some"'),
    ],
)
def test_an_impossible_value_is_refused_by_both(tmp_path: Path, section: str, line: str) -> None:
    path = rig_file(tmp_path / "rig.toml", **{section: line})
    with pytest.raises(ConfigError) as daemons:
        read_rig(path)
    with pytest.raises(PlanError) as plans:
        planned_rig(path)
    assert str(plans.value) == str(daemons.value)
    assert "\n" not in str(plans.value)


@pytest.mark.parametrize(
    ("section", "line", "says"),
    [
        (
            "camera",
            'frame_rate_hz = "fast"',
            (
                "camera.frame_rate_hz: should be a number, not 'fast': write it like frame_rate_hz = 120.0 "
                "in [camera]"
            ),
        ),
        (
            "camera",
            "width = 656.5",
            "camera.width: should be a whole number, not 656.5: write it like width = 656 in [camera]",
        ),
        ("top", 'g_m_s2 = "g"', "g_m_s2: should be a number, not 'g': write it like g_m_s2 = 9.81"),
        (
            "striker",
            "port = 3",
            'striker.port: should be text in quotes, not 3: write it like port = "/dev/ttyUSB0" in [striker]',
        ),
        (
            "striker",
            'reach_m = ["low", 1]',
            "striker.reach_m.0: should be a number, not 'low': correct reach_m in [striker]",
        ),
        (
            "striker",
            "reach_m = 1",
            "striker.reach_m: should be a list, not 1: write it like reach_m = [...] in [striker]",
        ),
        (
            "daemon",
            "socket = 3",
            'daemon.socket: should be text in quotes, not 3: write it like socket = "TEXT" in [daemon]',
        ),
    ],
)
def test_a_value_of_the_wrong_kind_is_named_with_how_to_write_it(
    tmp_path: Path, section: str, line: str, says: str
) -> None:
    path = rig_file(tmp_path / "rig.toml", **{section: line})
    with pytest.raises(ConfigError) as daemons:
        read_rig(path)
    assert str(daemons.value) == f"{path}: {says}"


def test_a_relative_socket_is_refused(tmp_path: Path) -> None:
    """By it, `acquire stop` in another folder found no daemon."""
    with pytest.raises(ConfigError, match=r"daemon.socket: should be an absolute path.* not 'run/d.sock'"):
        read_rig(rig_file(tmp_path / "rig.toml", daemon='socket = "run/d.sock"'))
    path = rig_file(tmp_path / "rig.toml", daemon='socket = "/run/d.sock"')
    assert read_rig(path).daemon.socket_path() == Path("/run/d.sock")


def test_an_arm_without_a_possible_speed_is_refused(tmp_path: Path) -> None:
    path = rig_file(tmp_path / "rig.toml", striker="cocked_angle_rad = -0.02")
    with pytest.raises(PlanError, match="has no possible speed"):
        planned_rig(path)


def test_planning_needs_no_camera_address(tmp_path: Path) -> None:
    path = rig_file(tmp_path / "rig.toml", camera="frame_rate_hz = 60")
    path.write_text(path.read_text(encoding="utf-8").replace('address = "10.0.0.2"\n', ""), encoding="utf-8")
    assert planned_rig(path).bench.frame_rate == 60


def test_a_plan_for_a_board_keeps_to_the_stated_speeds(prepared: PreparedObject) -> None:
    """However fast the arm of its default length and cocked angle would be."""
    config = StrikerConfig(kind="serial", speed_range_m_s=(0.2, 0.6))
    bench = replace(prepared.bench, striker=striker_model(config))
    mine = prepare_object(prepared.model, prepared.spec, bench)
    strikes = plan_strikes(mine, "0" * 64, PlanRequest(6)).strikes
    assert strikes
    for strike in strikes:
        for speed in (strike.aim.tip_speed_m_s.min, strike.aim.tip_speed_m_s.max):
            assert config.tip_speeds().allow(speed)
            assert 200 <= round(1000 * speed) <= 600  # as it is ordered
    by_hand = StrikerConfig(kind="manual", arm_length_m=0.3)
    assert striker_model(by_hand).fastest_m_s == StrikerModel().fastest_m_s
