"""`acquire strike` on the whole virtual rig: a real daemon, the servo's protocol, the world's physics."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from tests.system.session_rig import session_rig

pytestmark = pytest.mark.slow


def strike(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "acquire", "strike", "--yes", "--json", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)


def test_strikes_and_calibration_of_the_virtual_striker() -> None:
    with session_rig() as rig:
        toml = str(rig.folder / "d.toml")
        outcome = {"contacts": 0}
        for _ in range(5):  # a host that stands still for 60 ms stops the arm, and says so
            once = strike("--rig", toml, "--speed", "0.3")
            outcome = json.loads(once.stdout)
            assert once.returncode == (0 if outcome["contacts"] == 1 else 3), once.stderr
            if outcome["contacts"] == 1:
                break
        assert outcome["contacts"] == 1
        assert abs(outcome["tip_speed_m_s"] - 0.3) < max(3 * outcome["tip_speed_sd_m_s"], 0.015)
        planned = strike(
            "--rig", toml, "--plan", str(rig.folder / "plan.json"), "--strike", "s1", "--energy", "1.1"
        )
        assert planned.returncode in {0, 3}, planned.stderr
        assert "energy ratio 1.10" in planned.stderr
        calibrated = strike("--rig", toml, "--calibrate", "--speeds", "0.15,0.3,0.5", "--repeats", "1")
        assert calibrated.returncode == 0, calibrated.stderr
        found = json.loads(calibrated.stdout)
        ratio = found["swing_ratio"]
        assert abs(ratio["mean"] - 1) < 0.03
        assert 0 < ratio["mean_sd"] < 0.03
        assert found["striker"]["restitution"] == 0.4  # nothing was struck
