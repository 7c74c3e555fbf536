"""A rehearsal: virtual devices in one terminal, a rig's commands in others, a person who presses Enter."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.cli import main as acquire
from acquire.virtual.usb3_features import device_id, usb3_serial
from tests.loopback import loopback
from tests.places import ROOT
from tests.system.complaints import complaint, write
from tests.system.fault_rig import child

PROGRAM = [sys.executable, "-m", "acquire"]
pytestmark = pytest.mark.usefixtures("nothing_left")


@pytest.fixture
def short_folder() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="pc-"))
    yield folder
    shutil.rmtree(folder)


def started(folder: Path, *arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "acquire", *map(str, arguments)]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | {"TMPDIR": str(folder)}
    )


def run(program: str, *arguments: object, answers: str = "") -> str:
    command = [sys.executable, "-m", program, *map(str, arguments)]
    done = subprocess.run(command, input=answers, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 3), done.stderr  # 3: frames were lost on a busy computer
    return done.stdout


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_the_commands_of_a_rig_work_on_the_virtual_devices(short_folder: Path) -> None:
    thing = shutil.copy(ROOT / "docs" / "examples" / "teabox.toml", short_folder / "my box [1].toml")
    folder = short_folder / "my rig"
    rig, plan, recording = folder / "rig.toml", folder / "plan.json", folder / "s.mcap"
    virtual = started(
        short_folder, "virtual", "--object", thing, "--seed", 2, "--dir", folder, "--address", loopback(131)
    )
    assert virtual.stdout is not None
    lines = iter(virtual.stdout.readline, "")
    assert any(line.startswith("  analyze report") for line in lines)
    checked = CliRunner().invoke(acquire, ["check", str(rig), "--json"])
    failed = {
        line["name"] for line in json.loads(checked.stdout)["checks"] if line["outcome"].lower() == "fail"
    }
    assert failed <= {"frames", "disk speed", "CPU governor"}  # a busy computer, or one that saves power
    daemon = started(short_folder, "run", rig)
    assert daemon.stdout is not None
    assert daemon.stdout.readline().startswith("ready: ")
    run("analyze", "plan", thing, "--rig", rig, "--strikes", 3, "--no-cards", "-o", plan)
    run("acquire", "session", thing, plan, "--rig", rig, "-o", recording, answers="\n" * 40)
    assert json.loads(run("acquire", "status", "--rig", rig, "--json"))["recording"] is None
    assert any("the ground truth was added" in line for line in lines)
    assert "daemon stopped" in run("acquire", "stop", "--daemon", "--rig", rig)
    assert daemon.wait(30) == 0
    virtual.send_signal(signal.SIGINT)
    assert virtual.wait(30) == 0
    for process in (daemon, virtual):
        assert process.stdout is not None
        process.stdout.close()
    score = json.loads(run("analyze", "score", recording, "--json"))
    assert score["centre_of_mass_error_m"] < 0.002
    assert {path.name for path in short_folder.iterdir()} == {"my box [1].toml", "my rig"}


@pytest.mark.slow
@pytest.mark.timeout(200)
def test_a_usb_camera_is_discovered_and_checked_with_the_printed_environment(short_folder: Path) -> None:
    rig = short_folder / "rig" / "rig.toml"
    virtual = started(short_folder, "virtual", "--camera", "usb3", "--dir", rig.parent)
    assert virtual.stdout is not None
    environment = dict(os.environ)
    for line in iter(virtual.stdout.readline, ""):
        if line.startswith("  export "):
            name, _, value = line.removeprefix("  export ").strip().partition("=")
            environment[name] = value
        if line.startswith("  analyze report"):
            break
    program = [sys.executable, "-m", "acquire"]
    found = subprocess.run(
        [*program, "discover"], env=environment, capture_output=True, text=True, check=True
    )
    assert f'{device_id(usb3_serial(1))} Percuss USB3-656 (VIRTUAL-1)  kind = "usb3"' in found.stdout
    checked = subprocess.run(
        [*program, "check", str(rig), "--json"], env=environment, capture_output=True, text=True, check=False
    )
    virtual.send_signal(signal.SIGINT)
    assert virtual.wait(30) == 0
    virtual.stdout.close()
    lines = {line["name"]: line for line in json.loads(checked.stdout)["checks"]}
    failed = {name for name, line in lines.items() if line["outcome"].lower() == "fail"}
    assert failed <= {"frames", "disk speed"}  # a busy computer
    assert "start of the exposure, as stated" in lines["frame times"]["found"]


@pytest.mark.slow
@pytest.mark.timeout(200)
def test_a_make_of_camera_is_discovered_and_its_stamps_are_checked(short_folder: Path) -> None:
    rig, address = short_folder / "rig" / "rig.toml", loopback(133)
    chosen = ("--make", "blackfly-s", "--address", address)
    virtual = started(short_folder, "virtual", *chosen, "--dir", rig.parent)
    assert virtual.stdout is not None
    assert any(line.startswith("  analyze report") for line in iter(virtual.stdout.readline, ""))
    checked = CliRunner().invoke(acquire, ["check", str(rig), "--json"])
    virtual.send_signal(signal.SIGINT)
    assert virtual.wait(30) == 0
    virtual.stdout.close()
    lines = {line["name"]: line for line in json.loads(checked.stdout)["checks"]}
    assert "Blackfly S BFS-PGE-04S2M" in lines["camera"]["found"]
    assert "end of the exposure, as stated" in lines["frame times"]["found"]


def test_a_rehearsal_that_cannot_begin(tmp_path: Path) -> None:
    rig = write(tmp_path / "rig.toml", "mine")
    line = complaint(acquire, "virtual", "--dir", tmp_path)
    assert "rig.toml: exists, and was not written by `acquire virtual`: give another --dir" in line
    assert rig.read_text() == "mine"
    assert "needs a loopback address" in complaint(acquire, "virtual", "--address", "10.0.0.1")
    line = complaint(acquire, "virtual", "--object", tmp_path / "gone.toml", "--dir", tmp_path / "new")
    assert "gone.toml: no such file: check the path" in line
    assert not (tmp_path / "new").exists()
    truth = write(tmp_path / "t.toml", "[truth]\n")
    result = CliRunner().invoke(acquire, ["virtual", "--truth", str(truth)])
    assert result.exit_code == 2
    assert "the masses of the carton come from the seed" in result.stderr


def test_a_rehearsal_ends_with_its_world(short_folder: Path) -> None:
    """It went on offering a rig whose servo was gone."""
    virtual = subprocess.Popen(
        [*PROGRAM, "virtual", "--dir", str(short_folder / "rig"), "--address", loopback(132)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(short_folder)},
    )
    assert virtual.stdout is not None
    assert any(line.startswith("  analyze report") for line in iter(virtual.stdout.readline, ""))
    os.kill(child(virtual.pid, "acquire.virtual.world_process"), signal.SIGKILL)
    _, errors = virtual.communicate(timeout=30)
    assert virtual.returncode == 1
    assert errors == "acquire: the world ended unexpectedly: killed by SIGKILL: start again\n"
    assert {path.name for path in short_folder.iterdir()} == {"rig"}
