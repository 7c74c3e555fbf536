"""Snapshots of the console in every state that its pages show, for screenshots and for tests of the pages."""

from __future__ import annotations

import copy
from typing import Any

from tests.acquire.console.web.pages.results import HOSTILE, estimate

Snapshot = dict[str, Any]


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
                {"id": "p1", "object_id": "o1", "name": "plans/carton-9.json", "strikes": 9},
                {"id": "p2", "object_id": "o1", "name": "carton-5-quick", "strikes": 5},
                {"id": "p3", "object_id": "o2", "name": HOSTILE, "strikes": 1},
            ],
        },
        "session": None,
        "prompt": None,
        "armed": None,
        "estimate": None,
        "stop": {"stopped": False, "text": "", "latency_ms": None, "was": ""},
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
        "plan": "carton-9.json",
        "state": state,
        "text": text,
        "strike_id": "s4",
        "attempt": 1,
        "done": done,
        "total": 9,
        "earlier": 0,
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
        "axes_px": [[150, 360], [238, 382], [82, 388], [148, 258]],
        "offset_mm": [-3.4, 1.2],
        "angle_deg": 2.8,
        "in_place": False,
        "hands_off": False,
    } | more


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
        "starting": ("place", [_with(session=session("idle", "", 0))]),
        "checking": (
            "place",
            [
                _with(session=session("placing", "", 3), prompt=prompt(), **running),
                _with(session=session("checking_pose", "", 3), **running),
            ],
        ),
        "place-far": (
            "place",
            [
                _with(
                    session=session("placing", "", 3, earlier=11),
                    prompt=prompt(offset_mm=[-147.3, 288.1], angle_deg=-59.8),
                    **running,
                )
            ],
        ),
        "counts": (
            "strike",
            [
                _with(session=session("judging", "", 4, strikes=strikes(4)), **running),
                _with(session=session("placing", "", 4, strikes=strikes(5)), prompt=prompt(), **running),
            ],
        ),
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
        "toss-again": (
            "place",
            [
                _with(
                    session=session("placing", "", 9, strike_id="", attempt=2),
                    prompt=prompt(
                        kind="toss",
                        text="Spin it about the axis through the red dots, 3 turns a second.",
                        hint="again: 0.9 turns a second, 1.5 are needed: spin it faster",
                        strike_id="t1",
                        edge="",
                        outline_px=None,
                        axes_px=None,
                        offset_mm=None,
                        angle_deg=None,
                        in_place=None,
                    ),
                    **running,
                )
            ],
        ),
        "judging-toss": ("strike", [_with(session=session("judging", "", 9, strike_id=""), **running)]),
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
                    stop={
                        "stopped": True,
                        "text": "The operator pressed stop.",
                        "latency_ms": 7.4,
                        "was": "released",
                    },
                    striker={"state": "stopped", "text": "", "torque": False},
                )
            ],
        ),
        "fault": (
            "ready",
            [
                _with(
                    session=session("finished", "", 3),
                    striker={
                        "state": "fault",
                        "text": "the servo no longer answers: check its cable and supply",
                        "torque": False,
                    },
                )
            ],
        ),
        "striking": (
            "strike",
            [
                _with(
                    session=session("striking", "", 3),
                    striker={"state": "released", "text": "", "torque": True},
                    **running,
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
