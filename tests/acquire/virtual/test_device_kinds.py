"""Choice of a virtual rig's camera and striker: rig file, arguments, refusals."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.cli import main as acquire
from acquire.console.virtual_options import CAMERA_MAKES
from acquire.virtual.camera_makes import MAKES
from acquire.virtual.device_kinds import USUAL_KINDS, DeviceKinds
from acquire.virtual.devices import rig_toml
from acquire.virtual.station import calibration_sheet
from schemas.rig import RigConfig
from schemas.servo_models import MODEL_NAMES, ModelName


def rig_of(kinds: DeviceKinds, folder: Path) -> RigConfig:
    address = kinds.camera_address("127.0.0.9", folder, 1)
    text = rig_toml(calibration_sheet(1), address, "/dev/tty", folder / "d.sock", kinds)
    return RigConfig.model_validate(tomllib.loads(text))


def test_every_make_can_be_chosen() -> None:
    assert set(CAMERA_MAKES) == set(MAKES)


@pytest.mark.parametrize("make", MAKES)
def test_the_rig_file_states_the_instant_that_a_make_stamps(make: str, tmp_path: Path) -> None:
    assert rig_of(DeviceKinds(make=make), tmp_path).camera.timestamp_at == MAKES[make].stamp_at


@pytest.mark.parametrize("model", MODEL_NAMES)
def test_the_rig_file_states_the_servos_model_and_speeds_that_it_reaches(
    model: ModelName, tmp_path: Path
) -> None:
    striker = rig_of(DeviceKinds(servo=model), tmp_path).striker
    assert striker.model == model
    assert striker.tip_speeds().fastest_m_s > 0.2


def test_the_usual_rig_file_names_neither_kind_nor_model(tmp_path: Path) -> None:
    assert USUAL_KINDS.camera_lines == USUAL_KINDS.striker_lines == ""
    assert rig_of(USUAL_KINDS, tmp_path).camera.kind == "gige"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--make", "mako", "--camera", "usb3"), "--make mako is a GigE camera: leave --camera usb3 out"),
        (("--servo", "XM540-W150", "--striker", "serial"), "--servo XM540-W150 is no serial striker"),
    ],
)
def test_a_make_of_another_kind_is_refused(
    options: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    done = CliRunner().invoke(acquire, ["virtual", *options])
    assert done.exit_code == 2
    assert message in done.stderr
