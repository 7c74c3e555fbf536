"""Made-up snapshots of every state of the console, for its pages' pictures and for tests of the routes."""

from __future__ import annotations

import math
from typing import Any

from acquire.console.web.backend import Viewer
from acquire.console.web.snapshot import Snapshot

BEGAN_NS = 1_764_400_000_000_000_000
EDGES = ("bottom edge, +x side", "bottom edge, -x side", "back edge, +y side", "left edge, -y side")
CHECKS = (
    ("rig file", "pass", 'rig.toml: "bench"', ""),
    ("daemon", "pass", "running (pid 4711): camera and servo are checked through it", ""),
    ("level", "pass", "read by a level: table tilt 0.12 +- 0.05 deg, rising towards +x (1 sigma)", ""),
    ("serial port", "pass", "/dev/ttyUSB0: may be read and written", ""),
    ("USB latency", "warn", "16 ms: strikes are timed less precisely", "echo 1 > /sys/.../latency_timer"),
    ("receive buffer", "pass", "16 MB", ""),
    ("disk space", "pass", "212 GB free, 2 h 50 min of recording", ""),
    ("servo", "pass", "XM430-W350 at 12.1 V, 31 C", ""),
    ("frames", "pass", "120.0 Hz of 120 Hz set, none lost", ""),
    ("tags", "pass", "2 tags, the smallest 61 px", ""),
)
FAILED = ("servo", "fail", "no answer on /dev/ttyUSB0", "plug in the servo's 12 V supply; check the cable")


def strike(number: int, edge: str, verdict: str = "good", reason: str = "") -> dict[str, Any]:
    """One row of the strikes' table."""
    good = verdict == "good"
    return {
        "id": f"s{number}.1",
        "edge": edge,
        "verdict": verdict,
        "reason": reason or ("tipped over" if good else "the object slid by 4 mm"),
        "phi_deg": 21.4 + 3.1 * number if good else None,
        "phi_sd_deg": 0.06 if good else None,
        "energy_ratio": 1.1 + 0.02 * number if good else 0.7,
        "used": good,
        "curve": True,
    }


def session(state: str, done: int, **more: Any) -> dict[str, Any]:
    """A session after some strikes."""
    strikes = [strike(n, EDGES[n % 4]) for n in range(1, done + 1)]
    if done > 2:
        strikes[1] = strike(2, EDGES[2], "slid")
    return {
        "id": "carton-1",
        "object": "carton",
        "plan": "carton-plan.json",
        "state": state,
        "text": "",
        "strike_id": f"s{done + 1}.1",
        "attempt": 1,
        "done": done,
        "total": 9,
        "earlier": 0,
        "max_strikes": 12,
        "until": "com=0.5mm",
        "paused": None,
        "file": "recordings/carton-1.mcap",
        "began_ns": BEGAN_NS,
        "strikes": strikes,
    } | more


def prompt(**more: Any) -> dict[str, Any]:
    """The question to place the object."""
    return {
        "id": 4,
        "kind": "place",
        "text": "Place the carton on its face p1, tag 3 towards the camera, bottom edge on the line.",
        "hint": "",
        "strike_id": "s4",
        "edge": EDGES[0],
        "card": "/api/cards/s4",
        "outline_px": [[214, 402], [216, 188], [398, 186], [402, 400]],
        "axes_px": None,
        "offset_mm": [6.2, -1.4],
        "angle_deg": 4.1,
        "in_place": False,
        "hands_off": False,
    } | more


def estimate(strikes: int) -> dict[str, Any]:
    """The estimate after some strikes."""
    sd = 0.0016 / math.sqrt(strikes)
    met = strikes >= 7
    return {
        "kind": "estimate",
        "strike_id": f"s{strikes}.1",
        "strikes": strikes,
        "com_m": [0.0312, 0.0418, 0.0655],
        "com_covariance_m2": [
            [sd**2, 0.0, 0.0],
            [0.0, (2 * sd) ** 2, 0.2 * sd**2],
            [0.0, 0.2 * sd**2, sd**2],
        ],
        "com_open": [] if strikes > 3 else [[0.0, 1.0, 0.0]],
        "com_half_width_m": 2.5 * sd,
        "inertia_kg_m2": [4.1e-4, 3.6e-4, 2.2e-4, 1e-6, -2e-6, 0.0],
        "inertia_sd_kg_m2": [9e-6, 8e-6, 7e-6, 3e-6, 3e-6, 3e-6],
        "inertia_half_width": 0.043,
        "checks": [
            {"name": "leave one out", "passed": True, "text": "largest 2.1 standard deviations"},
            {"name": "agreement", "passed": strikes != 5, "text": "chi2 per degree of freedom 1.1"},
        ],
        "target": {
            "com_m": 0.0005,
            "inertia": None,
            "met": met,
            "reachable": True,
            "reason": "" if met else "the half width is 0.9 mm, 0.5 mm was asked for",
        },
        "forecast": None if met else {"least": 2, "most": 4},
        "next": None if met else {"strike_id": "s6", "reason": "tells most about y"},
        "bounds_m": [[0.0, 0.0, 0.0], [0.07, 0.09, 0.15]],
        "hull": [
            [[0.0, 0.0], [0.09, 0.0], [0.09, 0.15], [0.0, 0.15]],
            [[0.0, 0.0], [0.07, 0.0], [0.07, 0.15], [0.0, 0.15]],
            [[0.0, 0.0], [0.07, 0.0], [0.07, 0.09], [0.0, 0.09]],
        ],
    }


CAMERA = {
    "model": "Blackfly BFLY-PGE-03S2M",
    "serial": "13021234",
    "fps": 119.99,
    "exposure_us": 1500.0,
    "width": 656,
    "height": 492,
    "saturated_fraction": 0.0004,
    "sharpness": 412.0,
    "tag_px": 61.2,
    "frames": 86_412,
    "lost": 0,
}


def striker(state: str = "homed", text: str = "", *, torque: bool = True) -> dict[str, Any]:
    """The striker in a state."""
    return {"state": state, "text": text, "torque": torque}


def _base() -> dict[str, Any]:
    lines = [dict(zip(("name", "outcome", "text", "remedy"), line, strict=True)) for line in CHECKS]
    return {
        "time_ns": BEGAN_NS + 300_000_000_000,
        "role": "operator",
        "operator_present": True,
        "watchers": 1,
        "daemon": {
            "running": True,
            "text": "bench, process 4711",
            "socket": "/run/user/1000/percuss/daemon.sock",
        },
        "check": {"running": False, "passed": True, "lines": lines},
        "camera": CAMERA,
        "striker": striker(),
        "disk": {"free_bytes": 212_000_000_000, "minutes_left": 170.0},
        "trouble": [],
        "choices": {
            "objects": [
                {"id": "o1", "name": "carton", "file": "carton.toml"},
                {"id": "o2", "name": "spray <b>can</b> & cap", "file": "spray.toml"},
            ],
            "plans": [
                {"id": "p1", "object_id": "o1", "name": "carton-plan.json", "strikes": 9},
                {"id": "p2", "object_id": "o1", "name": "carton-long.json", "strikes": 15},
                {"id": "p3", "object_id": "o2", "name": "spray-plan.json", "strikes": 9},
            ],
        },
        "session": None,
        "prompt": None,
        "armed": None,
        "estimate": None,
        "stop": {"stopped": False, "text": "", "latency_ms": None, "was": ""},
    }


def _changes() -> dict[str, dict[str, Any]]:
    """Difference of each state from the base."""
    base = _base()["check"]["lines"]
    failed = [
        dict(zip(("name", "outcome", "text", "remedy"), FAILED, strict=True)) if x["name"] == "servo" else x
        for x in base
    ]
    skipped = [x | {"outcome": "skip", "text": "not checked: the camera does not answer"} for x in base[-2:]]
    green = {"offset_mm": [0.4, -0.2], "angle_deg": 0.3, "in_place": True, "hands_off": True}
    good = {"text": "tipped over", "strike_id": "s4.1"}
    return {
        "cold": {
            "daemon": {"running": False, "text": "no daemon runs for this rig", "socket": "/run/daemon.sock"},
            "check": {"running": False, "passed": None, "lines": []},
            "camera": None,
            "striker": None,
            "disk": None,
        },
        "checking": {"check": {"running": True, "passed": None, "lines": base[:5]}},
        "ready": {},
        "failed": {"check": {"running": False, "passed": False, "lines": [*failed[:-2], *skipped]}},
        "placing": {"session": session("placing", 3), "prompt": prompt(), "estimate": estimate(3)},
        "in_place": {"session": session("placing", 3), "prompt": prompt(**green), "estimate": estimate(3)},
        "again": {
            "session": session("placing", 3, attempt=2),
            "prompt": prompt(hint="again: the object slid by 4 mm"),
        },
        "checking_pose": {"session": session("checking_pose", 3), "estimate": estimate(3)},
        "arming": {
            "session": session("arming", 3),
            "striker": striker("armed"),
            "armed": {"countdown_s": 1.8},
            "estimate": estimate(3),
        },
        "striking": {
            "session": session("striking", 3),
            "striker": striker("released"),
            "armed": {"countdown_s": None},
        },
        "recording": {"session": session("recording", 3), "striker": striker("disarmed")},
        "judging": {"session": session("judging", 3), "estimate": estimate(3)},
        "judged": {
            "session": session("placing", 4, **good),
            "prompt": prompt(strike_id="s5", card="/api/cards/s5"),
            "estimate": estimate(4),
        },
        "paused": {
            "session": session("paused", 4, paused="the operator's browser was lost"),
            "operator_present": False,
            "estimate": estimate(4),
        },
        "finished": {
            "session": session("finished", 7, total=9, text="the target is met: com 0.5 mm"),
            "estimate": estimate(7),
        },
        "aborted": {
            "session": session("aborted", 2, text="stopped on request"),
            "striker": striker("disarmed", "stopped on request", torque=False),
            "stop": {"stopped": True, "text": "stopped on request", "latency_ms": 7.4, "was": "settled"},
            "estimate": estimate(2),
        },
        "stopped": {
            "striker": striker("disarmed", "stopped on request", torque=False),
            "stop": {"stopped": True, "text": "stopped on request", "latency_ms": 7.4, "was": "settled"},
        },
        "watcher": {
            "role": "watcher",
            "session": session("placing", 3),
            "prompt": prompt(),
            "estimate": estimate(3),
        },
        "trouble": {
            "trouble": ["the capture process ended (exit code -9); it was started again", "12 frames lost"],
            "camera": CAMERA
            | {"lost": 12, "fps": 97.2, "saturated_fraction": 0.08, "sharpness": 31.0, "tag_px": 21.0},
            "disk": {"free_bytes": 1_900_000_000, "minutes_left": 1.4},
            "session": session("recording", 3),
        },
    }


STATES = tuple(_changes())
"""names of the states"""


def sample(state: str, viewer: Viewer | None = None) -> Snapshot:
    """Snapshot of a state; the role is the viewer's, except in the state "watcher"."""
    seen = {} if viewer is None else {"role": viewer.role, "watchers": viewer.watchers}
    return Snapshot.model_validate(_base() | seen | _changes()[state])
