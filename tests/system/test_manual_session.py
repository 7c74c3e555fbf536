"""A session without a motor: a hand strikes, and the contact time is estimated from the images."""

from __future__ import annotations

import contextlib
import json
import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from acquire.virtual.truth import merge_truth
from analyze.cli import main as analyze
from analyze.reading.recording import open_recording
from analyze.reading.truth import read_truth
from schemas.strike_plan import read_strike_plan
from tests.acquire.virtual.hand import CONTACT_S, VirtualHand
from tests.system.session_rig import SEED, session_rig

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


def test_a_session_of_three_taps_from_the_first_to_the_answer() -> None:
    with session_rig("manual") as rig:
        plan = read_strike_plan(rig.folder / "plan.json")
        impulses = {strike.id: strike.impulse_n_s.target for strike in plan.strikes}
        with contextlib.closing(VirtualHand(rig.daemon.socket, rig.world(), impulses, SEED)):
            report = rig.session(lambda text, _done, _total: rig.said.append(text))
        assert not report.aborted, rig.said
        merge_truth(report.path, Path(rig.world().truth()))
        truth = read_truth(report.path)
        with open_recording(report.path) as recording:
            assert recording.manifest.striker["kind"] == "manual"
            good = [record for record in recording.strikes if record.verdict_code == "good"]
            assert len(good) >= 3, rig.said
            for record in good:
                # The images determine the middle of the touch; the sd is that of its beginning.
                nearest = min(
                    truth.contact_time_ns.tolist(), key=lambda time: abs(time - record.contact_time_ns)
                )
                off_s, sd_s = (record.contact_time_ns - nearest) * 1e-9, record.contact_time_sd_ns * 1e-9
                assert 0.002 < sd_s < 0.003
                assert abs(off_s - CONTACT_S / 2) < 0.001
                assert abs(off_s) < 3 * sd_s
        done = CliRunner().invoke(analyze, ["estimate", str(report.path), "--json"], catch_exceptions=False)
        assert done.exit_code == 0, done.stderr
        answer = json.loads(done.stdout)
        assert math.dist(answer["centre_of_mass"]["value"], truth.body.com_object) < 0.002
