"""The console beside the capture: time from the press of stop to the resting arm, frames lost, CPU time.

The arm is stopped during cocking and swings, over HTTP as the page does it, while a camera of 120 Hz is
recorded, four browsers show events and live images, and another program computes. The arm is simulated in
this process; a stop brakes the arm with full current and then holds it (torque stays on). Prints JSON.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from acquire.daemon.client import DaemonClient
from acquire.errors import StrikerError
from tests.acquire.striker.lateness import Lateness
from tests.system.fault_rig import RATE_HZ, Daemon, FaultRig, fault_rig, wait_until

BROWSERS = 4
LINE_RATE_HZ = 365.0
"""frames of 656 x 492 per second that a gigabit cable carries"""
STILL_RAD_S = 0.1
"""angular speed below which the arm counts as resting [rad/s]"""
TIP_SPEED_M_S = 0.3


def _cpu_s(pid: int) -> float:
    """CPU time of a process so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


class Page:
    """The operator's page: one kept connection, on which it stops the striker."""

    def __init__(self, url: str) -> None:
        self.host = url.split("/")[2]
        self._connection = http.client.HTTPConnection(self.host, timeout=10)
        self._connection.request("GET", "/?" + url.split("?")[1])
        answer = self._connection.getresponse()
        answer.read()
        self.cookie = str(answer.getheader("Set-Cookie")).partition(";")[0]

    def post(self, path: str, body: object) -> None:
        headers = {
            "Cookie": self.cookie,
            "Origin": f"http://{self.host}",
            "X-Percuss": "1",
            "Content-Type": "application/json",
        }
        self._connection.request("POST", path, json.dumps(body), headers)
        answer = self._connection.getresponse()
        data = answer.read()
        assert answer.status == 200, data


def _put_arm_first() -> None:
    """Run this process's threads, the simulated arm among them, before all others: a real arm is not late."""
    for thread in Path("/proc/self/task").iterdir():
        with contextlib.suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, int(thread.name), -15)


def _move(rig: FaultRig, client: DaemonClient, what: str) -> None:
    """Let the arm move; again if a busy computer made the simulated servo miss its answers."""
    for patience in range(8, -1, -1):
        rig.plant.restore(gap=0.0)
        try:
            for verb in ("home", "arm") if what == "cocking" else ("home", "arm", "cock"):
                client.call(f"striker.{verb}")
        except StrikerError:
            if not patience:
                raise
            time.sleep(1.0)
            continue
        if what == "cocking":
            rig.in_background(client, "striker.cock")
        else:
            rig.strike_in_background(client, TIP_SPEED_M_S)
        return


def _moment(rig: FaultRig, what: str, rng: np.random.Generator) -> None:
    """Wait for a moment of the motion at which the operator presses stop."""
    sign = -1 if what == "cocking" else 1
    wait_until(lambda: sign * rig.plant.omega > 0.4, 5.0, 0.0005)
    time.sleep(float(rng.uniform(0.0, 0.06)))


def measure(presses: int) -> dict[str, object]:
    """Press stop many times, and return latencies [ms], frames and CPU shares."""
    rng = np.random.default_rng(1)
    answers: list[float] = []
    rests: list[float] = []
    with fault_rig() as rig, contextlib.ExitStack() as cleanup:
        _, daemon, client = rig.recording_daemon()
        console, page = _watched_console(daemon, cleanup)
        busy = cleanup.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
        cleanup.callback(busy.kill)
        time.sleep(3.0)
        _put_arm_first()
        pids = {"console": console.pid, "daemon": daemon.pid, "capture": daemon.capture}
        before = {name: _cpu_s(pid) for name, pid in pids.items()}
        began_s, frames = time.monotonic(), client.call("status")
        lateness = cleanup.enter_context(Lateness())
        for i in range(presses):
            what = ("cocking", "swing")[i % 2]
            try:
                _move(rig, client, what)
            except StrikerError as error:  # this computer is too busy for the simulated arm
                sys.stderr.write(f"ended after {len(answers)} presses: {error}\n")
                break
            with contextlib.suppress(AssertionError):  # a press at rest counts as well
                _moment(rig, what, rng)
            pressed_ns = time.monotonic_ns()
            page.post("/api/stop", {})
            answers.append((time.monotonic_ns() - pressed_ns) * 1e-6)
            time.sleep(0.4)
            rests.append(1e3 * rig.still_after_s(pressed_ns, STILL_RAD_S))
            rig.wait_for_background()
        took_s, after = time.monotonic() - began_s, client.call("status")
        cpu = {name: round(100 * (_cpu_s(pid) - before[name]) / took_s, 1) for name, pid in pids.items()}
        client.call("recording.close")
        return {
            "presses": len(answers),
            "press_to_answer_ms": _figures(answers),
            "press_to_rest_ms": _figures(rests),
            "simulated_arm_late_ms": round(1e3 * lateness.worst_s, 1),
            "frames": after["frames"] - frames["frames"],
            "lost": after["lost"] - frames["lost"],
            "dropped": after["dropped"],
            "cpu_percent": cpu,
            "browsers": BROWSERS,
        }


def measure_line_rate(seconds: float) -> dict[str, object]:
    """Record every frame at the capacity of a gigabit cable; return frames and losses, and CPU shares."""
    with fault_rig() as rig, contextlib.ExitStack() as cleanup:
        path = rig.rig_file(recorder='mode = "continuous"\nrotate_bytes = 1073741824\nkeep_files = 2\n')
        text = path.read_text(encoding="utf-8").replace(
            f"frame_rate_hz = {RATE_HZ}", f"frame_rate_hz = {LINE_RATE_HZ}\nexposure_us = 1000"
        )
        path.write_text(text, encoding="utf-8")
        rig.camera()
        daemon = rig.daemon(path)
        client = rig.client(daemon)
        rig.open_recording(client)
        console, _ = _watched_console(daemon, cleanup)
        time.sleep(3.0)
        pids = {"console": console.pid, "daemon": daemon.pid, "capture": daemon.capture}
        before = {name: _cpu_s(pid) for name, pid in pids.items()}
        began_s, first = time.monotonic(), client.call("status")
        time.sleep(seconds)
        took_s, last = time.monotonic() - began_s, client.call("status")
        cpu = {name: round(100 * (_cpu_s(pid) - before[name]) / took_s, 1) for name, pid in pids.items()}
        client.call("recording.close")
        return {
            "seconds": round(took_s, 1),
            "frames": last["frames"] - first["frames"],
            "lost": last["lost"] - first["lost"],
            "dropped": last["dropped"] - first["dropped"],
            "cpu_percent": cpu,
            "browsers": BROWSERS,
        }


def _watched_console(daemon: Daemon, cleanup: contextlib.ExitStack) -> tuple[subprocess.Popen[str], Page]:
    """Start the console of a daemon, its operator's page and the browsers that look on."""
    command = [sys.executable, "-m", "acquire", "console", str(daemon.rig_file), "--port", "0"]
    console = cleanup.enter_context(
        subprocess.Popen([*command, "--no-browser"], stdout=subprocess.PIPE, text=True)
    )
    cleanup.callback(console.terminate)
    assert console.stdout is not None
    page = Page(console.stdout.readline().split()[-1])
    arguments = [page.host, page.cookie, str(BROWSERS)]
    looking = cleanup.enter_context(
        subprocess.Popen(
            [sys.executable, "-m", "tests.benchmarks.console_browsers", *arguments], stdin=subprocess.PIPE
        )
    )
    cleanup.callback(looking.kill)
    return console, page


def _figures(values: list[float]) -> dict[str, float]:
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(float(p50), 1), "p99": round(float(p99), 1), "worst": round(max(values), 1)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--presses", type=int, default=200)
    parser.add_argument("--line-rate", type=float, metavar="SECONDS", help="no presses: record at line rate")
    given = parser.parse_args()
    found = measure_line_rate(given.line_rate) if given.line_rate else measure(given.presses)
    sys.stdout.write(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
