"""Snapshots of the console in every state that its pages show, for screenshots and for tests of the pages."""

from __future__ import annotations

import copy
import math
from typing import Any

Snapshot = dict[str, Any]

HOSTILE = '<img src=x onerror="document.title=1"> & "carton"'
"""name that would run a script if it were inserted as HTML"""
SIZE_M = (0.162, 0.110, 0.208)
"""box of the object [m]"""
COM_M = (0.0790, 0.0562, 0.0871)


def _check(*failing: str) -> dict[str, Any]:
    lines = [
        ("rig file", "rig.toml: read, 2 warnings about unused keys", ""),
        ("camera", "The Imaging Source DMK 33GX287 (1412 0871) at 192.168.7.2", ""),
        ("frames", "120 of 120 in 1.00 s, none lost", ""),
        ("camera clock", "mapping known to 4 µs", ""),
        ("light", "0.1 % of the image saturated, brightest 1 % of the pixels at 197 of 255", ""),
        ("marker", "tag 12 of 76 px, tag 15 of 71 px", ""),
        ("object at rest", "nothing has moved for a quarter of a second", ""),
        ("servo", "answers at 1 Mbaud, 12.1 V, 31 °C", ""),
        ("striker stop", "torque off 6 ms after the stop", ""),
        ("USB latency", "1 ms", ""),
        ("receive buffer", "32 MB", ""),
        ("disk space", "412 GB free", ""),
        ("disk speed", "431 MB/s, 38 MB/s needed", ""),
    ]
    found = {
        "marker": (
            "no tag of the object file in the image",
            "turn tag 12 towards the camera, or move it closer",
        ),
        "USB latency": ("16 ms", "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer"),
    }
    out = [
        {
            "name": name,
            "outcome": "fail" if name in failing else "warn" if name == "rig file" else "pass",
            "text": found[name][0] if name in failing else text,
            "remedy": found[name][1] if name in failing else remedy,
        }
        for name, text, remedy in lines
    ]
    out.append({"name": "IPv6", "outcome": "skip", "text": "the camera has an IPv4 address", "remedy": ""})
    return {"running": False, "passed": not failing, "lines": out}


def base() -> Snapshot:
    """Operator before a session, with everything in order."""
    return {
        "time_ns": 1_796_000_000_000_000_000,
        "role": "operator",
        "operator_present": True,
        "watchers": 0,
        "daemon": {"running": True, "text": "runs since 14:02", "socket": "/run/user/1000/percuss/rig.sock"},
        "check": _check(),
        "camera": {
            "model": "DMK 33GX287",
            "serial": "1412 0871",
            "fps": 119.98,
            "exposure_us": 900.0,
            "width": 656,
            "height": 492,
            "saturated_fraction": 0.0012,
            "sharpness": 412.0,
            "tag_px": 76.0,
            "frames": 48213,
            "lost": 0,
        },
        "striker": {"state": "parked", "text": "", "torque": False},
        "disk": {"free_bytes": 412_000_000_000, "minutes_left": 190.0},
        "trouble": [],
        "choices": {
            "objects": [
                {"id": "o1", "name": "carton", "file": "carton.toml"},
                {"id": "o2", "name": HOSTILE, "file": "hostile.toml"},
                {"id": "o3", "name": "spray bottle, half full", "file": "spray.toml"},
            ],
            "plans": [
                {"id": "p1", "object_id": "o1", "name": "carton-9", "strikes": 9},
                {"id": "p2", "object_id": "o1", "name": "carton-5-quick", "strikes": 5},
                {"id": "p3", "object_id": "o2", "name": HOSTILE, "strikes": 1},
            ],
        },
        "session": None,
        "prompt": None,
        "armed": None,
        "estimate": None,
        "stop": {"stopped": False, "text": "", "latency_ms": None},
    }


_EDGES = ["bottom edge, +x side", "bottom edge, −x side", "bottom edge, +y side", "back edge, +x side"]
_VERDICTS = ["good", "good", "slid", "good", "rocked_back", "good"]
_REASONS = {
    "slid": "The edge slid 6 mm along the table before the balance point: roughen the strip.",
    "rocked_back": "It turned back at 21.4°, before the balance point: strike harder.",
}


def strikes(count: int) -> list[dict[str, Any]]:
    """The first strikes of a session, the third one useless."""
    out: list[dict[str, Any]] = []
    for i in range(count):
        verdict = _VERDICTS[i % len(_VERDICTS)]
        out.append(
            {
                "id": f"s{i // 2 + 1}.{i % 2 + 1}",
                "edge": _EDGES[i % len(_EDGES)],
                "verdict": verdict,
                "reason": _REASONS.get(verdict, ""),
                "phi_deg": None if verdict == "slid" else 36.412 - 3.1 * i,
                "phi_sd_deg": None if verdict == "slid" else 0.021 + 0.004 * i,
                "energy_ratio": 1.14 + 0.03 * i,
                "used": verdict != "slid",
                "curve": verdict != "slid",
            }
        )
    return out


def session(state: str, text: str, done: int = 0, **more: Any) -> dict[str, Any]:
    """Session of the carton in a state."""
    return {
        "id": "2026-11-29T14-05",
        "object": "carton",
        "plan": "carton-9",
        "state": state,
        "text": text,
        "strike_id": "s4",
        "attempt": 1,
        "done": done,
        "total": 9,
        "max_strikes": 12,
        "until": "com=0.5mm",
        "paused": None,
        "file": "/data/recordings/carton-2026-11-29T14-05-00.mcap",
        "began_ns": 1_796_000_000_000_000_000,
        "strikes": strikes(done + 1 if done >= 3 else done),
    } | more


def prompt(**more: Any) -> dict[str, Any]:
    """Question to place the object."""
    return {
        "id": 7,
        "kind": "place",
        "text": "Turn it 90° clockwise, seen from above; then tip it over 90°, "
        "its top going away from the striker.",
        "hint": "Tag 12 faces the camera, tag 15 is underneath, tag 14 on top.",
        "strike_id": "s4",
        "edge": "bottom edge, +x side",
        "card": "/api/card.png",
        "outline_px": [[52, 228], [258, 226], [258, 410], [236, 470], [52, 472]],
        "offset_mm": [-3.4, 1.2],
        "angle_deg": 2.8,
        "in_place": False,
        "hands_off": False,
    } | more


def estimate(strikes_used: int, **more: Any) -> dict[str, Any]:
    """Estimate after a number of good strikes; the uncertainty shrinks with it."""
    sd = 0.0031 / strikes_used**1.25
    wander = [
        math.sin(strikes_used * 2.1) * sd,
        math.cos(strikes_used * 1.3) * sd,
        math.sin(strikes_used) * sd,
    ]
    covariance = [
        [sd**2, 0.45 * sd**2, 0.0],
        [0.45 * sd**2, 1.6 * sd**2, -0.5 * sd**2],
        [0.0, -0.5 * sd**2, 3.1 * sd**2],
    ]
    x, y, z = SIZE_M
    side = [[0, 0], [1, 0], [1, 0.86], [0.82, 1], [0, 1]]
    tensor = [2.214e-3, 2.871e-3, 1.642e-3, -0.041e-3, 0.018e-3, 0.112e-3]
    half = 1.96 * math.sqrt(3.1) * sd
    return {
        "kind": "estimate",
        "strike_id": f"s{strikes_used}.1",
        "strikes": strikes_used,
        "com_m": [a + b for a, b in zip(COM_M, wander, strict=True)],
        "com_covariance_m2": covariance,
        "com_open": [],
        "com_half_width_m": half,
        "inertia_kg_m2": tensor,
        "inertia_sd_kg_m2": [abs(v) * 0.05 / strikes_used + 4e-6 for v in tensor],
        "inertia_half_width": 0.12 / strikes_used,
        "checks": [
            {
                "name": "leave one out",
                "passed": True,
                "text": "each strike is predicted by the others within 1.7 sd",
            },
            {
                "name": "agreement",
                "passed": True,
                "text": "residuals of the planes: 0.9 of their expected size",
            },
            {
                "name": "physical tensor",
                "passed": True,
                "text": "positive, and the triangle inequality holds",
            },
        ],
        "target": {"com_m": 0.0005, "inertia": None, "met": half <= 0.0005, "reachable": True, "reason": ""},
        "forecast": {"least": 2, "most": 4},
        "next": {
            "strike_id": "s7",
            "reason": "Tipping over the back edge tells most about z: ± 0.9 mm becomes ± 0.5 mm.",
        },
        "bounds_m": [[0.0, 0.0, 0.0], list(SIZE_M)],
        "hull": [
            [[a * y, b * z] for a, b in side],
            [[a * x, b * z] for a, b in side],
            [[a * x, b * y] for a, b in [[0, 0], [1, 0], [1, 1], [0, 1]]],
        ],
    } | more


def curve() -> dict[str, Any]:
    """Angle curve of one strike that tips over."""
    phi, k = 36.41, 62.0
    time_s, theta = [], []
    angle, rate = 0.0, 6.6
    for i in range(-8, 50):
        time_s.append(i / 120)
        theta.append(math.degrees(angle) + 0.12 * math.sin(i * 12.9898))
        if i >= 0:
            for _ in range(10):
                rate += -k * math.sin(math.radians(phi) - angle) / 1200
                angle = min(angle + rate / 1200, math.pi / 2)
    inside = [i for i, t in enumerate(time_s) if 0.01 < t < 0.22]
    return {
        "time_s": time_s,
        "theta_deg": theta,
        "fit_time_s": [time_s[i] for i in inside],
        "fit_deg": [theta[i] - 0.12 * math.sin((i - 8) * 12.9898) for i in inside],
        "phi_deg": phi,
        "window_s": [0.012, 0.218],
    }


def archive() -> list[dict[str, Any]]:
    """List of recordings."""
    rows = [
        ("carton", "2026-11-29T14:05:00", 9, [79.02, 56.21, 87.13], [0.11, 0.14, 0.19], [], True),
        (
            "carton",
            "2026-11-28T09:41:00",
            9,
            [79.31, 56.02, 87.52],
            [0.12, 0.16, 0.22],
            ["2 strikes repeated"],
            True,
        ),
        (HOSTILE, "2026-11-27T17:20:00", 5, [42.1, 38.8, 120.4], [0.6, 0.7, 1.9], ["z weakly known"], True),
        ("spray bottle, half full", "2026-11-27T16:02:00", 3, None, None, ["frames lost"], False),
        ("parcel", "2026-11-20T11:11:00", 7, [201.4, 149.9, 98.2], [0.8, 0.9, 1.2], [], True),
    ]
    return [
        {
            "id": f"r{i}",
            "file": f"{name[:6].strip('<')}-{date.replace(':', '-')}.mcap",
            "object": name,
            "date": date,
            "strikes": count,
            "com_mm": com,
            "com_sd_mm": sd,
            "flags": flags,
            "size_bytes": 312_000_000 + 77_000_000 * i,
            "complete": complete,
        }
        for i, (name, date, count, com, sd, flags, complete) in enumerate(rows)
    ]


def _with(**changes: Any) -> Snapshot:
    return copy.deepcopy(base()) | changes


def states() -> dict[str, tuple[str, list[Snapshot]]]:
    """Name of each state: the view in which it is looked at, and the snapshots that lead to it."""
    no_camera = {
        "camera": None,
        "trouble": ["camera: no answer from 192.168.7.2 for 3 s: check its cable and power"],
        "check": _check("marker"),
    }
    no_daemon = {
        "daemon": {
            "running": False,
            "text": "No daemon runs for rig.toml.",
            "socket": "/run/user/1000/percuss/rig.sock",
        },
        "camera": None,
        "striker": None,
        "disk": None,
        "check": {"running": False, "passed": None, "lines": []},
    }
    armed = {"striker": {"state": "armed", "text": "", "torque": True}}
    running = {"estimate": estimate(3)}
    ran = [_with(session=session("judging", "", n + 1), estimate=estimate(n)) for n in (2, 3, 4, 5)]
    ended = session("finished", "Finished: the target was met after 6 good strikes.", 6)
    last = {"next": None, "forecast": None, "com_half_width_m": 0.00047}
    last["target"] = {"com_m": 0.0005, "inertia": None, "met": True, "reachable": True, "reason": ""}
    return {
        "ready": ("ready", [base()]),
        "ready-unchecked": ("ready", [_with(check={"running": False, "passed": None, "lines": []})]),
        "ready-failed": ("ready", [_with(check=_check("marker", "USB latency"))]),
        "no-daemon": ("ready", [_with(**no_daemon)]),
        "no-camera": ("ready", [_with(**no_camera)]),
        "place": ("place", [_with(session=session("placing", "", 3), prompt=prompt(), **running)]),
        "place-hands": (
            "place",
            [
                _with(
                    session=session("placing", "", 3),
                    prompt=prompt(in_place=True, offset_mm=[0.4, -0.2], angle_deg=0.3),
                    **running,
                )
            ],
        ),
        "place-in": (
            "place",
            [
                _with(
                    session=session("placing", "", 3),
                    prompt=prompt(in_place=True, hands_off=True, offset_mm=[0.4, -0.2], angle_deg=0.3),
                    **running,
                )
            ],
        ),
        "place-plain": (
            "place",
            [
                _with(
                    session=session("placing", "", 0),
                    prompt=prompt(card="", outline_px=None, offset_mm=None, angle_deg=None, in_place=None),
                )
            ],
        ),
        "armed": (
            "strike",
            [_with(session=session("striking", "", 3), armed={"countdown_s": 2.1}, **armed, **running)],
        ),
        "first-armed": ("strike", [_with(session=session("arming", ""), armed={"countdown_s": None})]),
        "ended-bare": ("know", [_with(session=session("finished", "", 3))]),
        "judging": ("strike", [_with(session=session("judging", "", 3), **running)]),
        "good": (
            "strike",
            [
                _with(session=session("judging", "", 3), **running),
                _with(session=session("placing", "", 3, strikes=strikes(6)), prompt=prompt(), **running),
            ],
        ),
        "again": (
            "strike",
            [
                _with(session=session("judging", "", 2)),
                _with(session=session("placing", "", 2, strikes=strikes(3)), prompt=prompt()),
            ],
        ),
        "know": ("know", ran),
        "know-open": (
            "know",
            [
                _with(
                    session=session("judging", "", 2),
                    estimate=estimate(
                        2, com_open=[[0, 0, 1]], inertia_kg_m2=None, inertia_sd_kg_m2=None, checks=[]
                    ),
                )
            ],
        ),
        "finished": ("know", [*ran, _with(session=ended, estimate=estimate(6, **last))]),
        "aborted": (
            "know",
            [
                _with(
                    session=session("aborted", "the operator ended it after 4 strikes", 4),
                    estimate=estimate(3),
                )
            ],
        ),
        "paused": (
            "strike",
            [
                _with(session=session("striking", "", 4)),
                _with(
                    session=session(
                        "paused",
                        "",
                        4,
                        paused="The operator's browser was not connected for 3 s. Nothing was lost.",
                    )
                ),
            ],
        ),
        "stopped": (
            "strike",
            [
                _with(
                    session=session("paused", "", 4, paused="stopped by the operator"),
                    stop={"stopped": True, "text": "The operator pressed stop.", "latency_ms": 7.4},
                    striker={"state": "stopped", "text": "", "torque": False},
                )
            ],
        ),
        "watcher": (
            "place",
            [
                _with(
                    role="watcher", watchers=2, session=session("placing", "", 3), prompt=prompt(), **running
                )
            ],
        ),
        "archive": ("archive", [base()]),
    }
